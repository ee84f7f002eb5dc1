"""A relaxed model under solution: one run of Ipopt after another, each from a point that is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint, ShiftedRows

from .automatic_scaling import AutomaticScaling
from .ipopt_options import IpoptOptions
from .iterates import Iterate

OnIteration = Callable[[IterationRecord], Any]


class Session(Protocol):
    """Two ways to do the same: in process, or through the executable.

    The iterates that it returns are not checked yet by what the user stated, and their point is on the model.

    Attributes
    ----------
    solver, derivatives : str
        Which Ipopt, and which derivatives, for people to read.
    scaling : AutomaticScaling or None
        What the program of the last run was divided by for Ipopt: sizes at the point where it started. Nothing of it is
        left in what comes back.
    """

    solver: str
    derivatives: str
    scaling: AutomaticScaling | None

    def run(
        self, delta: float | None, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None = None
    ) -> Iterate:
        """Solve with a fixed delta from the point on the model, with the multipliers of `start` where it is given."""
        ...

    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """Solve with delta following the barrier parameter, from the point on the model."""
        ...

    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """The relaxed model as numbers, at the last delta; None where nothing here can take its derivatives.

        It may have been compiled before, unless it is requested as it is now.
        """
        ...

    def missing_rank(self) -> int:
        """Equations that are dependent at the point on the model, to first order; 0 where that is not known."""
        ...

    def with_elastic_rows(self, price: float) -> Session | None:
        """A session of the same model whose rows may be violated; None where there is no such program.

        Parameters
        ----------
        price : float
            Of a violation of the size of its row, in sizes of the objective; without sizes, of a unit in its slopes.
        """
        ...

    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """The point on the model with the multipliers of an iterate of this session, in the order of `compiled`."""
        ...

    def close(self) -> None:
        """Take everything off the model that the session put there."""
        ...


class DeltaFollowsBarrier:
    """Moves the shifted rows after each iteration, as the schedule says; a callback of `run_ipopt`.

    Parameters
    ----------
    nlp : ShiftedRows
    schedule : BarrierSchedule
    mu : float
        First barrier parameter.
    on_iteration : callable, optional
        Called as well.

    Attributes
    ----------
    path : list of (float, float)
        Barrier parameter and delta of each iteration.
    """

    def __init__(
        self, nlp: ShiftedRows, schedule: BarrierSchedule, mu: float, on_iteration: OnIteration | None = None
    ) -> None:
        self._nlp, self._schedule, self._on_iteration = nlp, schedule, on_iteration
        self.path: list[tuple[float, float]] = []
        self.delta = nlp.delta = schedule.delta_for(mu)

    def __call__(self, record: IterationRecord) -> bool | None:
        """Move the rows, and pass the record on."""
        # Called between iterations: the next trial point is the first to see the new bound. The values that Ipopt
        # keeps of the current point are those under the old one, so delta lags mu by one iteration.
        self.path.append((record.mu, self.delta))
        self.delta = self._nlp.delta = self._schedule.delta_for(record.mu)
        return None if self._on_iteration is None else self._on_iteration(record)
