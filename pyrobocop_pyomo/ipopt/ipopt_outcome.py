"""What a run of Ipopt in process gives back."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint


class IpoptStatus(enum.Enum):
    """Why Ipopt stopped; the value is a sentence, beside it the codes of Ipopt's ApplicationReturnStatus."""

    codes: tuple[int, ...]

    def __new__(cls, sentence: str, *codes: int) -> IpoptStatus:
        """A status by its sentence and the return codes that it stands for."""
        member = object.__new__(cls)
        member._value_, member.codes = sentence, codes
        return member

    SOLVED = "Ipopt found a point that satisfies its tolerances.", 0
    ACCEPTABLE = "Ipopt found a point that satisfies its acceptable tolerances, looser than asked for.", 1
    FEASIBLE_POINT = "Ipopt found a feasible point of a square problem.", 6
    INFEASIBLE = "Ipopt converged to a point of local infeasibility.", 2
    TINY_STEP = "Ipopt's search direction became too small; the point may still be a solution.", 3
    DIVERGING = "Ipopt's iterates diverge; the problem may be unbounded.", 4
    INTERRUPTED = "Ctrl-C interrupted Ipopt."
    STOPPED = "The iteration callback stopped Ipopt.", 5
    ITERATION_LIMIT = "Ipopt reached its iteration limit.", -1
    TIME_LIMIT = "Ipopt reached its time limit.", -4, -5
    RESTORATION_FAILED = "Ipopt's restoration phase failed.", -2
    STEP_FAILED = "Ipopt could not compute a step.", -3
    TOO_FEW_FREEDOMS = "The problem has more equations than free variables.", -10
    INVALID_PROBLEM = "Ipopt refused the problem as inconsistent, for example for crossed bounds.", -11
    INVALID_OPTION = "Ipopt refused its options as inconsistent.", -12
    INVALID_NUMBER = "A function or derivative was not finite where Ipopt could not avoid the point.", -13
    OUT_OF_MEMORY = "Ipopt ran out of memory.", -102
    INTERNAL_ERROR = "Ipopt failed internally."

    @classmethod
    def of_code(cls, code: int) -> IpoptStatus:
        """What a return code says. 5, a stop that the caller requested, may have been Ctrl-C."""
        return next((status for status in cls if code in status.codes), cls.INTERNAL_ERROR)

    @property
    def solved(self) -> bool:
        """Whether Ipopt reports success."""
        return self in (IpoptStatus.SOLVED, IpoptStatus.ACCEPTABLE, IpoptStatus.FEASIBLE_POINT)

    @property
    def converged(self) -> bool:
        """Whether Ipopt reached its tolerances, or as near to them as its numbers allow."""
        return self.solved or self is IpoptStatus.TINY_STEP


class IterationRecord(NamedTuple):
    """One iteration as Ipopt reports it."""

    iteration: int
    restoration: bool
    objective: float
    primal_infeasibility: float
    dual_infeasibility: float
    mu: float
    step_norm: float
    regularization: float
    dual_step: float
    primal_step: float
    line_search_trials: int


@dataclass(frozen=True, eq=False)
class IpoptOutcome:
    """The last point of a run and how Ipopt came there.

    Multipliers are in Ipopt's signs, see `PrimalDualPoint`.

    Attributes
    ----------
    status : IpoptStatus
        Why it stopped.
    x, g : float array
        Last point and the values of the rows there. It exists for every status, also after an interruption.
    objective : float
        Value of the minimised objective there.
    g_multipliers, lower_multipliers, upper_multipliers : float array
        Multipliers of the rows and of the variables' bounds.
    iterations : int
        Number of iterations.
    records : list of IterationRecord
        One per iteration, the first point included.
    seconds : float
        Elapsed.
    log : str
        What Ipopt printed, when it was asked to print.
    undefined_at : float array or None
        The last point at which a function or a derivative had no finite value; None where all had.
    linear_solver : str
        ``"ldl"`` where it was the one of this package; empty where Ipopt's options decided.
    fell_back : bool
        The linear solver of this package failed, and MUMPS ran from the same start: all else but times is of that run.
    """

    status: IpoptStatus
    x: FloatArray
    objective: float
    g: FloatArray
    g_multipliers: FloatArray
    lower_multipliers: FloatArray
    upper_multipliers: FloatArray
    iterations: int
    records: list[IterationRecord]
    seconds: float
    log: str = ""
    undefined_at: FloatArray | None = None
    linear_solver: str = ""
    fell_back: bool = False

    @property
    def point(self) -> PrimalDualPoint:
        """The last point with its multipliers."""
        return PrimalDualPoint(self.x, self.g_multipliers, self.lower_multipliers, self.upper_multipliers)

    @property
    def mu(self) -> float | None:
        """The barrier parameter of the last iteration."""
        return self.records[-1].mu if self.records else None
