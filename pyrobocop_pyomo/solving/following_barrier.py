"""delta follows the barrier parameter inside a run of Ipopt."""

from __future__ import annotations

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.programs.nonlinear_program import ShiftedRows

from .session import OnIteration


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
