"""`Iterate`: a point that a run of Ipopt ended at, with all that is known of it, and which of two is the better one."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any

from pyrobocop_pyomo.discretisation import RowMultipliers
from pyrobocop_pyomo.errors import KeywordError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.keywords import check_keywords
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Multipliers
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.presentation import Presented

_OF_PAIRS = ", and every pair is complementary"
# What a log keeps no iterate with, and a pickle cannot hold.
_HEAVY = ("values", "multipliers", "undefined_at", "load_suffixes", "row_multipliers", "classify")


class Quality(enum.Enum):
    """How good the returned point is, by residuals that were recomputed, the best first; the value is a sentence."""

    OPTIMAL = f"Feasible and stationary{_OF_PAIRS}, within the tolerances."
    FEASIBLE = f"Feasible{_OF_PAIRS}, but the point is not shown to be optimal."
    INFEASIBLE = "Constraints or complementarity are violated beyond the tolerances."


class StopReason(enum.Enum):
    """Why the procedure ended; the value is a sentence."""

    FINISHED = "The procedure ran to its end."
    ITERATION_LIMIT = (
        "Ipopt reached its iteration limit. Raise it with options={'max_iter': ...}, or try another initial guess."
    )
    TIME_LIMIT = (
        "The time limit was reached. Raise time_limit, or solve an easier model first, on fewer elements or without "
        "contact or obstacles: phase.initialize(easier.trajectory()) makes its answer the initial guess."
    )
    INTERRUPTED = "Ctrl-C or the stop button interrupted the procedure."
    INFEASIBLE = (
        "Ipopt converged to a point of local infeasibility. Relax bounds, fixed values or constraints, or try another "
        "initial guess."
    )
    DIVERGED = (
        "Variables grow without end: the objective may have no optimum. Bound what grows, or give it a cost; check the "
        "sign of the objective."
    )
    FAILED = "Ipopt failed. Try another initial guess, or tee=True to see its log."

    @property
    def what(self) -> str:
        """What happened: the first sentence of the value."""
        return f"{self.value.rstrip('.').partition('. ')[0]}."

    @property
    def remedy(self) -> str:
        """What helps: the value without its first sentence."""
        return self.value.partition(". ")[2]

    @property
    def is_final(self) -> bool:
        """Whether nothing more may be tried: there is no time left, or somebody interrupted."""
        return self in (StopReason.TIME_LIMIT, StopReason.INTERRUPTED)


STOP_REASONS = {
    IpoptStatus.INTERRUPTED: StopReason.INTERRUPTED,
    IpoptStatus.STOPPED: StopReason.INTERRUPTED,
    IpoptStatus.ITERATION_LIMIT: StopReason.ITERATION_LIMIT,
    IpoptStatus.TIME_LIMIT: StopReason.TIME_LIMIT,
    IpoptStatus.INFEASIBLE: StopReason.INFEASIBLE,
    IpoptStatus.DIVERGING: StopReason.DIVERGED,
}


@dataclass(frozen=True)
class Tolerances:
    """When a point counts as acceptable.

    Attributes
    ----------
    feasibility : float
        Largest violation of a constraint, a bound or a side; relative to the largest term that it adds up at the point,
        where that is above 1.
    complementarity : float
        Largest product ``a b`` of a pair; of sides whose sizes are below 1, relative to these.
    natural : float
        Largest ``|min(a, b)|`` of a pair that counts as exactly complementary; each side relative to its size likewise.
    stationarity : float
        Largest residual of first-order conditions, relative to what has to balance in them.
    """

    feasibility: float = MET
    complementarity: float = 1e-7
    natural: float = MET
    stationarity: float = 1e-5


def checked_tolerances(stated: Mapping[str, float] | None) -> Tolerances:
    """The tolerances that a caller stated by name.

    Raises
    ------
    ValueError
        When one of them is no number above 0.
    KeywordError
        When there is none of this name.
    """
    stated = dict(stated or {})
    known = [each.name for each in fields(Tolerances)]
    check_keywords("tolerances=", stated, known, KeywordError, {"product": "complementarity"})
    for name, tolerance in stated.items():
        if not isinstance(tolerance, Real) or not float(tolerance) > 0.0:
            raise ValueError(f"tolerances: '{name}' is {tolerance!r}; expected a number above 0, such as 1e-6.")
    return Tolerances(**stated)


@dataclass(frozen=True)
class Standing:
    """What decides which of two points is the better one, for runs, solves, starts, sequences and rounds alike.

    Attributes
    ----------
    excess : float
        How far residuals exceed their tolerances; 1 where none does.
    bounded : bool
        Whether it is no point of a run whose variables grow without end.
    shortfall : float
        By how much a motion misses its clearance; 0 where it is proven safe or there is nothing to keep clear of.
    cost : float
        The objective, of a minimisation.
    exact : bool
        Whether every pair is complementary by its natural residual, not only by its product.
    optimal, certified : bool
        Whether the point is shown to be stationary, and proven to be B-stationary.
    """

    excess: float
    bounded: bool = True
    shortfall: float = 0.0
    cost: float = 0.0
    exact: bool = True
    optimal: bool = False
    certified: bool = False

    @property
    def feasible(self) -> bool:
        """Whether all residuals are within their tolerances."""
        return self.excess <= 1.0

    def is_better_than(self, other: Standing) -> bool:
        """Feasible first, then bounded, safe, exactly complementary, then the objective, then what is shown and proven.

        Differences of the objective that are within a solver's tolerance do not decide, nor do those by which a point
        that is not shown to be stationary may fall below one that is. A pair that is met only loosely flatters the
        objective, and nobody knows by how much: an exact point is better whatever it costs.
        """
        if not (self.feasible and other.feasible):
            return self.excess < other.excess
        if self.bounded != other.bounded:
            return self.bounded
        if self.shortfall != other.shortfall:
            return self.shortfall < other.shortfall
        if self.exact != other.exact:
            return self.exact
        gain = (other.cost - self.cost) / max(1.0, abs(self.cost), abs(other.cost))
        if abs(gain) > (1e-6 if self.optimal == other.optimal else 1e-4):
            return gain > 0.0
        return (self.certified, self.optimal) > (other.certified, other.optimal)


def _nothing() -> None:
    """Multipliers that nobody kept fill no suffix, and cannot be classified."""


@dataclass(frozen=True, eq=False)
class Iterate(Presented):
    """A point that a run of Ipopt, or a linear program of the search for descent, ended at.

    Attributes
    ----------
    label : str
        What kind of run it was.
    delta : float or None
        The bound of the products at its end; None for a problem without pairs.
    mu : float or None
        Ipopt's barrier parameter at its end, where it is known.
    status : IpoptStatus or None
        None for a linear program.
    iterations : int
    seconds : float
        Elapsed.
    objective : float
        The user's objective.
    constraint_violation, largest_product, largest_natural_residual : float
        Recomputed from the user's model, whatever Ipopt says.
    relative_violation : float or None
        The largest violation where that of a row or a bound whose largest term at the point is above 1 is divided by
        it: what is compared with the tolerance; None before that is checked.
    relative_product, relative_natural_residual : float or None
        The same where each side is divided by its size, if that is below 1; None where one side of each pair was held
        at zero, as in a polish.
    options : mapping
        Ipopt's options of the run, resolved.
    path : sequence of (mu, delta)
        Per iteration, where delta followed mu inside the run.
    strategy : str
        Which strategy it belongs to.
    number : int
        Its place in the log of all runs, from 0; -1 before it is logged.
    stop_reason : StopReason
        Why the run ended.
    stationarity : float or None
        What the point and its multipliers leave of the first-order conditions, relative to what has to balance in
        them; None where multipliers are not at hand.
    certificate : Certificate
        Whether another branch through the point descends.
    values : list of float, optional
        Of the model's free variables.
    multipliers : object, optional
        What its session needs to start from here.
    undefined_at : float array or None
        Of the program's variables: the last point of the run at which a function or a derivative had no value.
    load_suffixes : callable
        Fills the user's suffixes with its multipliers.
    row_multipliers : callable
        Gives the multipliers of the user's rows and bounds; None where there are none.
    classify : callable
        Looks for the multipliers of the pairs; None where there are none to be found.
    """

    label: str
    delta: float | None = None
    mu: float | None = None
    status: IpoptStatus | None = None
    iterations: int = 0
    seconds: float = 0.0
    objective: float = float("nan")
    constraint_violation: float = float("inf")
    largest_product: float = float("inf")
    largest_natural_residual: float = float("inf")
    relative_violation: float | None = None
    relative_product: float | None = None
    relative_natural_residual: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict, repr=False)
    path: Sequence[tuple[float, float]] = field(default=(), repr=False)
    strategy: str = ""
    number: int = -1
    stop_reason: StopReason = StopReason.FINISHED
    stationarity: float | None = None
    certificate: Certificate = Certificate.UNKNOWN
    values: Any = field(default=None, repr=False)
    multipliers: Any = field(default=None, repr=False)
    undefined_at: Any = field(default=None, repr=False)
    load_suffixes: Callable[[], None] = field(default=_nothing, repr=False)
    row_multipliers: Callable[[], RowMultipliers | None] = field(default=_nothing, repr=False)
    classify: Callable[[], Multipliers | None] = field(default=_nothing, repr=False)

    @classmethod
    def of_run(cls, label: str, status: IpoptStatus, **facts: Any) -> Iterate:
        """The end of a run of Ipopt, not checked yet."""
        reason = StopReason.FINISHED if status.converged else STOP_REASONS.get(status, StopReason.FAILED)
        return cls(label=label, status=status, stop_reason=reason, **facts)

    @property
    def converged(self) -> bool:
        """Whether Ipopt reached its tolerances, or as near to them as its numbers allow."""
        return self.stop_reason is StopReason.FINISHED

    @property
    def diverged(self) -> bool:
        """Whether its variables were on their way to infinity: no point to go on from."""
        return self.stop_reason is StopReason.DIVERGED

    def excess(self, tolerances: Tolerances) -> float:
        """How far the residuals exceed the tolerances; 1 if they do not."""
        # Numbers that have grown without end violate a row by no more than the size of its terms: relative violations
        # say what is met, and not what is nearer to it.
        relative = self.constraint_violation if self.relative_violation is None else self.relative_violation
        violation = relative if relative <= tolerances.feasibility else self.constraint_violation
        product = self.largest_product if self.relative_product is None else self.relative_product
        found = max(violation / tolerances.feasibility, product / tolerances.complementarity, 1.0)
        return found if found == found else float("inf")

    def is_exact(self, tolerances: Tolerances) -> bool:
        """Whether every pair is complementary by its natural residual."""
        relative = self.relative_natural_residual
        return (self.largest_natural_residual if relative is None else relative) <= tolerances.natural

    def quality(self, tolerances: Tolerances) -> Quality:
        """How good the point is."""
        if not self.excess(tolerances) <= 1.0:
            return Quality.INFEASIBLE
        is_stationary = self.stationarity is None or self.stationarity <= tolerances.stationarity
        shown = self.converged and is_stationary and self.certificate is not Certificate.DESCENT
        return Quality.OPTIMAL if shown else Quality.FEASIBLE

    def standing(self, tolerances: Tolerances, sign: float) -> Standing:
        """What decides between this iterate and another one.

        Parameters
        ----------
        tolerances : Tolerances
        sign : float
            1 where the objective is minimised, -1 where it is maximised.
        """
        return Standing(
            excess=self.excess(tolerances),
            bounded=not self.diverged,
            cost=sign * self.objective,
            exact=self.is_exact(tolerances),
            optimal=self.quality(tolerances) is Quality.OPTIMAL,
            certified=self.certificate is Certificate.PROVEN,
        )

    def record(self) -> Iterate:
        """The same without values and multipliers: what a log keeps of it, and a pickle can hold."""
        return replace(self, **{name: getattr(Iterate, name) for name in _HEAVY})

    def line(self, *, pairs: bool) -> str:
        """A line of a table of runs, with what concerns pairs or without; see `step_header`."""
        delta = "-" if self.delta is None else f"{self.delta:.1e}"
        status = "-" if self.status is None else self.status.name
        product = f"{self.largest_product:>9.1e} " if pairs else ""
        return (
            f"{self.label:<22} {f'{delta:>8} ' if pairs else ''}{self.iterations:>6} {self.objective:>14.7g} "
            f"{self.constraint_violation:>9.1e} {product}{self.seconds:>8.2f}  {status}"
        )

    def __str__(self) -> str:
        return self.line(pairs=self.delta is not None)


def step_header(*, pairs: bool) -> str:
    """The header of the lines of `Iterate.line`."""
    delta, product = (f"{'delta':>8} ", f"{'max a*b':>9} ") if pairs else ("", "")
    return f"{'step':<22} {delta}{'iter':>6} {'objective':>14} {'violation':>9} {product}{'seconds':>8}  status"
