"""`Standstill`: a run that goes on without going anywhere."""

from __future__ import annotations

from collections.abc import Callable

from .ipopt_outcome import IterationRecord

# So many iterations in a row stand; a step below this size, and a change of the objective, are none.
ITERATIONS, SMALLEST_STEP, SAME_OBJECTIVE, FEASIBLE = 50, 1e-9, 1e-12, 1e-8


class Standstill:
    """Tells a run to stop that no longer moves from a feasible point.

    Ipopt ends with tiny steps itself, but only where they vanish beside every variable. With a badly conditioned
    system they stay a little larger, regularised more and less by turns; or a restoration phase that was called where
    everything is feasible already has nothing to restore. Both go on until the limit of iterations.

    Parameters
    ----------
    on_iteration : callable or None
        The user's callback, asked first.

    Attributes
    ----------
    reached : bool
        Whether the run was told to stop.
    """

    def __init__(self, on_iteration: Callable[[IterationRecord], bool | None] | None = None) -> None:
        self._on_iteration, self._count = on_iteration, 0
        self._before: IterationRecord | None = None
        self.reached = False

    def __call__(self, record: IterationRecord) -> bool:
        """Whether the run may go on."""
        if self._on_iteration is not None and self._on_iteration(record) is False:
            return False
        before, self._before = self._before, record
        stands = before is not None and record.primal_infeasibility <= FEASIBLE and _stands(before, record)
        self._count = self._count + 1 if stands else 0
        self.reached = self._count >= ITERATIONS
        return not self.reached


def _stands(before: IterationRecord, now: IterationRecord) -> bool:
    if now.restoration:
        return before.restoration and before.primal_infeasibility <= FEASIBLE
    return (
        now.mu == before.mu
        and now.step_norm <= SMALLEST_STEP
        and abs(now.objective - before.objective) <= SAME_OBJECTIVE * max(1.0, abs(now.objective))
    )
