"""A relaxed model under solution: one run of Ipopt after another, each starting from the last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus, IterationRecord
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

# What lets Ipopt start where the last run ended instead of pushing the point back into the interior.
WARM_START_OPTIONS = {
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_bound_frac": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
    "warm_start_slack_bound_frac": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
}

DEFAULT_MU = 0.1  # Ipopt's own first barrier parameter


@dataclass(frozen=True)
class Run:
    """What one run of Ipopt did; its point is on the model."""

    label: str
    delta: float | None
    mu: float | None
    status: IpoptStatus
    iterations: int
    seconds: float
    path: list[tuple[float, float]] = field(default_factory=list)


class Session(Protocol):
    """Two ways to do the same: in process, or through the executable.

    Attributes
    ----------
    solver, derivatives : str
        Which Ipopt, and which derivatives, for people to read.
    """

    solver: str
    derivatives: str

    def run(
        self,
        delta: float | None,
        *,
        warm: bool = False,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> Run:
        """Solve with a fixed delta, from the current point or warm from the last run; options of this run win."""
        ...

    def follow(
        self, schedule: BarrierSchedule, *, time_limit: float | None = None, options: Mapping[str, Any] | None = None
    ) -> Iterator[Run]:
        """Solve with delta following the barrier parameter, from the current point."""
        ...

    def written(self, *, anew: bool = False) -> CompiledModel | None:
        """The relaxed model as numbers, at the last delta; None where nothing here can take its derivatives.

        It may have been written before, unless it is asked for as it is now.
        """
        ...

    def multipliers(self, written: CompiledModel) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Multipliers of rows, lower and upper bounds after the last run, in the order of `written`."""
        ...

    def stationarity(self) -> float | None:
        """Size of the Lagrangian's gradient at the last point, relative to the multipliers; None if unknown."""
        ...

    def rewinder(self) -> Callable[[], None]:
        """What lets the next warm run start with the multipliers that are the last ones now."""
        ...

    def suffix_loader(self) -> Callable[[], None]:
        """What fills the suffixes that the user declared for import from the last run; to be called after `close`."""
        ...

    def close(self) -> None:
        """Take everything off the model that the session put there."""
        ...


OnIteration = Callable[[IterationRecord], Any]
