"""What a run of Ipopt in process gives back."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint


class IpoptStatus(enum.Enum):
    """Why Ipopt stopped; the value is a sentence."""

    SOLVED = "Ipopt found a point that satisfies its tolerances."
    ACCEPTABLE = "Ipopt found a point that satisfies its acceptable tolerances, looser than asked for."
    FEASIBLE_POINT = "Ipopt found a feasible point of a square problem."
    INFEASIBLE = "Ipopt converged to a point of local infeasibility."
    TINY_STEP = "Ipopt's search direction became too small; the point may still be a solution."
    DIVERGING = "Ipopt's iterates diverge; the problem may be unbounded."
    INTERRUPTED = "Ctrl-C interrupted Ipopt."
    STOPPED = "The iteration callback stopped Ipopt."
    ITERATION_LIMIT = "Ipopt reached its iteration limit."
    TIME_LIMIT = "Ipopt reached its time limit."
    RESTORATION_FAILED = "Ipopt's restoration phase failed."
    STEP_FAILED = "Ipopt could not compute a step."
    TOO_FEW_FREEDOMS = "The problem has more equations than free variables."
    INVALID_PROBLEM = "Ipopt refused the problem as inconsistent, for example for crossed bounds."
    INVALID_OPTION = "Ipopt refused its options as inconsistent."
    INVALID_NUMBER = "A function or derivative was not finite where Ipopt could not avoid the point."
    OUT_OF_MEMORY = "Ipopt ran out of memory."
    INTERNAL_ERROR = "Ipopt failed internally."

    @property
    def solved(self) -> bool:
        """Whether Ipopt reports success."""
        return self in (IpoptStatus.SOLVED, IpoptStatus.ACCEPTABLE, IpoptStatus.FEASIBLE_POINT)


# Ipopt's ApplicationReturnStatus; 5, a stop that the caller requested, is told apart by who requested it.
STATUS_OF_RETURN_CODE = {
    0: IpoptStatus.SOLVED,
    1: IpoptStatus.ACCEPTABLE,
    2: IpoptStatus.INFEASIBLE,
    3: IpoptStatus.TINY_STEP,
    4: IpoptStatus.DIVERGING,
    5: IpoptStatus.STOPPED,
    6: IpoptStatus.FEASIBLE_POINT,
    -1: IpoptStatus.ITERATION_LIMIT,
    -2: IpoptStatus.RESTORATION_FAILED,
    -3: IpoptStatus.STEP_FAILED,
    -4: IpoptStatus.TIME_LIMIT,
    -5: IpoptStatus.TIME_LIMIT,
    -10: IpoptStatus.TOO_FEW_FREEDOMS,
    -11: IpoptStatus.INVALID_PROBLEM,
    -12: IpoptStatus.INVALID_OPTION,
    -13: IpoptStatus.INVALID_NUMBER,
    -102: IpoptStatus.OUT_OF_MEMORY,
}


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
    seconds, evaluation_seconds : float
        Elapsed time in total, and the part of it inside the functions and derivatives.
    cpu_seconds : float
        Processor time in total, over all threads of this process.
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
    cpu_seconds: float
    evaluation_seconds: float
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
