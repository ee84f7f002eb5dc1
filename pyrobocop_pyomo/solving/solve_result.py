"""What `solve` gives back: why it stopped and how good the point is are two separate answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import takewhile
from typing import Any

from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.diagnosis import Diagnosis, Finding, Severity, diagnose
from pyrobocop_pyomo.diagnosis.least_violation import LeastViolation
from pyrobocop_pyomo.discretisation import DiscretisationEstimate, DiscretisationProbe
from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.modeling.variable_values import checksum_of_model
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Multipliers
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.plotting import plot_result
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.automatic_scaling import ScalingRecord
from pyrobocop_pyomo.trajectories.trajectory import SOLVED

from .iterates import Iterate, Quality, Standing, StopReason, step_header
from .result_text import ActiveSide, PairReport, first_line, long_report, pair_reports, pair_table, short_text, verdict
from .violations import Violation


def no_model() -> None:
    """What a pickle of a result holds in place of the reference to its model."""


@dataclass(frozen=True, eq=False)
class SolveResult(Presented):
    """The answer of `solve`; the point itself is on the model, also after a failure.

    Attributes
    ----------
    name : str
        Name of the model.
    stop_reason : StopReason
        Why it stopped.
    quality : Quality
        How good the point is.
    best : Iterate
        The point on the model: which run it comes from, its recomputed residuals, its certificate.
    multipliers : Multipliers or None
        Of the pairs, in the order of `residuals`, and the kind of stationarity that they show.
    residuals : list of PairResidual
        Per pair, under its original name.
    steps : list of Iterate
        Every run of Ipopt, and every search by linear programs, in order; without values and multipliers.
    standing : Standing
        What decides between this result and another one.
    decided_pairs : int
        Pairs that bounds and fixed variables had decided before.
    solver : str
        Which Ipopt was used.
    derivatives : str
        Where its derivatives came from.
    checking_seconds : float
        Elapsed in recomputing residuals after each step.
    seconds : float
        Elapsed time in all, writing included.
    violations : tuple of Violation
        What an infeasible point does not meet: the worst of each component, the largest first.
    least_violation : LeastViolation or None
        Of an infeasible point: whether any point near it violates less, and which bounds, fixed values and rows stand
        against that; None for models that are large or have rows without derivatives.
    remarks : tuple of str
        What happened on the way that the user should know, such as an initial guess that could not be evaluated.
    doubts : tuple of Finding
        Why the point may not be what was meant although all residuals are small, such as phases that nothing joins;
        the first lines of the text say so.
    safety : SafetyReport or None
        How clear of obstacles the continuous motion is, and of the sides of regions that it is to stay in; None for
        a model without `ObstacleAvoidanceBlock` and `Containment`.
    rounds : sequence of PlanningRound
        What was done until the motion was safe.
    scenes : sequence of (array, list of BodyPath, list of Polytope)
        Of each avoidance block: times, the bodies' poses at these times, and what stands still; for pictures.
    scaling : ScalingRecord or None
        By what Ipopt saw variables, rows and the objective divided; None where it saw them as they are. All that is
        here is in the units of the model.
    probe : DiscretisationProbe or None
        From which `discretisation` is estimated.
    fingerprint : int or None
        Checksum of the values of the model when a motion was judged: with others `safe` is not known.
    model : callable
        It gives the model, as long as somebody else keeps it; see `diagnose`.
    rounding : IntegerRounding or None
        What became of integer controls: both objectives, and how far their integrals moved.
    """

    name: str
    stop_reason: StopReason
    quality: Quality
    best: Iterate
    multipliers: Multipliers | None = field(repr=False)
    residuals: list[PairResidual] = field(repr=False)
    steps: list[Iterate] = field(repr=False)
    standing: Standing = field(repr=False)
    decided_pairs: int
    solver: str
    derivatives: str
    checking_seconds: float
    seconds: float
    violations: tuple[Violation, ...] = ()
    least_violation: LeastViolation | None = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[Finding, ...] = ()
    safety: SafetyReport | None = None
    rounds: Sequence[Any] = ()
    scenes: Sequence[Any] = field(default=(), repr=False)
    scaling: ScalingRecord | None = field(default=None, repr=False)
    probe: DiscretisationProbe | None = field(default=None, repr=False)
    rounding: Any = None
    fingerprint: int | None = field(default=None, repr=False)
    model: Callable[[], Any] = field(default=no_model, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "model": no_model}

    @property
    def objective(self) -> float:
        """The user's objective, recomputed."""
        return self.best.objective

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(
            f"a result has no '{name}'. Whether it is a solution: result.solved; why it ended: result.stop_reason, "
            "print(result). The values are on the model: phase.trajectory() has them as arrays, pyo.value(...) of a "
            "variable or expression gives one."
        )

    def __getitem__(self, name: Any) -> Any:
        raise TypeError(
            f"a result holds no values by name ({name!r}); they are on the model: phase.trajectory()[{name!r}]."
        )

    def diagnose(self) -> Diagnosis:
        """What `rcp.diagnose` finds in the model at the point of this result, after what the solve has found.

        Returns
        -------
        Diagnosis
            The outcome and each violation are findings as well. Where the model is gone, or after
            unpickling, there is nothing else.
        """
        model, least = self.model(), self.least_violation
        gone = Diagnosis(self.name, (), (), ("the model, which no longer exists",))
        known = gone if model is None else diagnose(model)
        said = {f"{finding.message} {finding.remedy}" for finding in known.findings}
        remarks = (*(() if least is None else (str(least),)), *self.remarks)
        own = [] if self.solved else [Finding(Severity.ERROR, f"{verdict(self)}.", (), "")]
        for violation in self.violations:
            message, remedy = f"not met: {violation}.", "Relax it, or what drives it there."
            own.append(Finding(Severity.ERROR, message, (violation.name,), remedy))
        own += [Finding(Severity.ADVICE, remark, (), "") for remark in remarks if remark not in said]
        findings = sorted([*own, *known.findings], key=lambda finding: list(Severity).index(finding.severity))
        return replace(known, name=self.name, findings=tuple(findings))

    @property
    def discretisation(self) -> DiscretisationEstimate:
        """Errors that the mesh of the phases makes of the objective and of the motion, estimated when asked for."""
        return DiscretisationEstimate(self.objective, {}) if self.probe is None else self.probe.error()

    @property
    def errors_of_answer(self) -> DiscretisationEstimate:
        """The same where there is an answer: empty where rows are violated, and on the way to infinity."""
        judged = self.quality is not Quality.INFEASIBLE and self.stop_reason is not StopReason.DIVERGED
        return self.discretisation if judged else DiscretisationEstimate(self.objective, {})

    @property
    def constraint_violation(self) -> float:
        """Largest violation of a constraint or bound, recomputed from the model's expressions."""
        return self.best.constraint_violation

    @property
    def stationarity(self) -> float | None:
        """Residual of the first-order conditions, relative to the terms that balance; None without multipliers."""
        return self.best.stationarity

    @property
    def certificate(self) -> Certificate:
        """Whether another branch through the point descends."""
        return self.best.certificate

    @property
    def strategy(self) -> str:
        """Which strategy found the point."""
        return self.best.strategy

    @property
    def safe(self) -> bool | None:
        """Whether all clearances are proven for the whole motion, that under the plan's controls included.

        None where they are proven of the plan, and the motion under its controls is not known (``safety.not_replayed``
        says why, with ``equations=False`` that nobody asked); for a model without obstacles and regions; and where the
        model has other values of variables or parameters by now than the motion that was proven.
        """
        return None if self.has_changed else self.was_safe

    @property
    def was_safe(self) -> bool | None:
        """The same, whatever the values of the model are by now."""
        if self.safety is None or self.quality is Quality.INFEASIBLE:
            return None if self.safety is None else False
        return self.safety.safe

    @property
    def has_changed(self) -> bool:
        """Whether a motion was proven, and the model has other values by now."""
        model = self.model() if self.was_safe is not False and self.fingerprint is not None else None
        return model is not None and checksum_of_model(model) != self.fingerprint

    @property
    def largest_product(self) -> float:
        """Largest ``|a b|`` over all pairs."""
        return max((abs(pair.product) for pair in self.residuals), default=0.0)

    @property
    def largest_natural_residual(self) -> float:
        """Largest ``|min(a, b)|`` over all pairs."""
        return max((abs(pair.natural) for pair in self.residuals), default=0.0)

    @property
    def iterations(self) -> int:
        """Ipopt's iterations in all steps together."""
        return sum(step.iterations for step in self.steps)

    @property
    def solved(self) -> bool:
        """True when the point is `Quality.OPTIMAL` and, where there are obstacles, the plan is clear of them."""
        return self.quality is Quality.OPTIMAL and self.was_safe is not False

    @property
    def outcome(self) -> str:
        """What trajectories say of it: "solved", "feasible", "infeasible", "NOT SAFE" or "DOUBTFUL"."""
        if self.quality is not Quality.OPTIMAL:
            return self.quality.name.lower()
        return "NOT SAFE" if self.was_safe is False else "DOUBTFUL" if self.doubts else SOLVED

    @cached_property
    def pairs(self) -> list[PairReport]:
        """Sides, multipliers and the zero side of every pair, in the order of `residuals`."""
        return pair_reports(self.residuals, self.multipliers)

    @property
    def biactive(self) -> list[PairReport]:
        """The pairs whose sides are both zero."""
        return [pair for pair in self.pairs if pair.active is ActiveSide.BIACTIVE]

    def table(self) -> str:
        """The pairs as a table in text."""
        return pair_table(self.pairs)

    def to_pandas(self) -> Any:
        """The pairs as a data frame, indexed by name."""
        columns = ["component", "index", "first", "second", "product", "natural", "active"]
        columns += ["first_multiplier", "second_multiplier"]
        index = pandas.Index([pair.name for pair in self.pairs], name="pair", dtype=object)
        rows = [[getattr(pair, name) for name in columns] for pair in self.pairs]
        return pandas.DataFrame(rows, index, columns).assign(active=[pair.active.value for pair in self.pairs])

    def steps_table(self) -> str:
        """The runs as a table in text."""
        pairs = bool(self.residuals)
        return "\n".join([step_header(pairs=pairs), *(step.line(pairs=pairs) for step in self.steps)])

    def rounds_table(self) -> str:
        """The rounds of planning around obstacles as a table in text."""
        return "\n".join([*(first.HEADER for first in self.rounds[:1]), *map(str, self.rounds)])

    def steps_to_pandas(self) -> Any:
        """The runs as a data frame, numbered from 1."""
        columns = ["label", "delta", "mu", "status", "iterations", "seconds", "objective", "constraint_violation"]
        columns += ["largest_product", "largest_natural_residual"]
        rows = [[getattr(step, name) for name in columns] for step in self.steps]
        frame = pandas.DataFrame(rows, pandas.RangeIndex(1, len(rows) + 1, name="step"), columns)
        return frame.assign(status=["" if step.status is None else step.status.name for step in self.steps])

    def report(self, worst: int = 5) -> str:
        """All that is known: verdict, errors of the mesh, residuals, runs; of pairs, counts, certificate and the worst.

        Parameters
        ----------
        worst : int
            How many pairs to show in each list.
        """
        return long_report(self, worst)

    def plot(self, figure: Any = None) -> Any:
        """Draw what came out, and the way there; returns a figure.

        Where there are obstacles or regions: the scene, then the clearances that are required and proven over time.
        Last, and otherwise alone: objective, delta, mu and residuals over the iterations of all runs.
        """
        return plot_result(self, figure)

    def raise_for_status(self) -> None:
        """Do nothing when the point is optimal.

        Raises
        ------
        SolveFailed
            Otherwise, with what `print` shows; the result is its attribute ``result``.
        """
        if not self.solved:
            raise SolveFailed(str(self), self)

    def one_line(self) -> str:
        """Verdict, objective, effort, violation and the error of the mesh."""
        return first_line(self)

    def __str__(self) -> str:
        return short_text(self)


def with_steps_of_all(result: SolveResult, results: Sequence[SolveResult]) -> SolveResult:
    """A result with the steps of several, of which it is one, numbered anew."""
    before = sum(len(each.steps) for each in takewhile(lambda each: each is not result, results))
    every = (step for each in results for step in each.steps)
    steps = [replace(step, number=number) for number, step in enumerate(every)]
    return replace(result, steps=steps, best=replace(result.best, number=before + result.best.number))
