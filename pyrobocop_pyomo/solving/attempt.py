"""One attempt at a solution: a schedule of runs, each judged by its own residuals, the best one remembered."""

from __future__ import annotations

import logging
import time
from typing import Any

from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import FollowBarrier, Geometric, PairResidual, Schedule, pair_residuals
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus

from .assessment import PointJudge
from .progress import Progress
from .session import Run, Session
from .solve_result import Quality, Step, StopReason

logger = logging.getLogger(__name__)

# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
DEFAULT_SCHEDULE = FollowBarrier(factor=2.0)
FALLBACK_SCHEDULE = Geometric(first=1.0, factor=0.1, last=1e-8)

_STOP_REASONS = {
    IpoptStatus.INTERRUPTED: StopReason.INTERRUPTED,
    IpoptStatus.STOPPED: StopReason.INTERRUPTED,
    IpoptStatus.ITERATION_LIMIT: StopReason.ITERATION_LIMIT,
    IpoptStatus.TIME_LIMIT: StopReason.TIME_LIMIT,
    IpoptStatus.INFEASIBLE: StopReason.INFEASIBLE,
}
_FINAL = (StopReason.INTERRUPTED, StopReason.TIME_LIMIT)


class Attempt:
    """Runs a schedule, judges each step by its own residuals, and remembers the best point."""

    def __init__(
        self,
        model: Any,
        judge: PointJudge,
        pairs: list[Any],
        session: Session,
        bar: Progress,
        feasibility_tolerance: float,
        complementarity_tolerance: float,
    ) -> None:
        self._variables = [v for v in model.component_data_objects(Var, active=True) if not v.fixed]
        self._start = [v.value for v in self._variables]
        self._judge, self._pairs, self._session, self._bar = judge, pairs, session, bar
        self._tolerances = feasibility_tolerance, complementarity_tolerance
        self.steps: list[Step] = []
        self.best = -1
        self._best_values: list[float | None] = self._start
        self.stop_reason = StopReason.FINISHED
        self.stationarity: float | None = None
        self.judging_seconds = 0.0

    def go(self, schedule: Schedule | None, shiftable: bool, started: float, time_limit: float | None) -> None:
        """Run the schedule; without one, the default and, if that ends badly, the fallback."""

        def left() -> float | None:
            return None if time_limit is None else time_limit - (time.perf_counter() - started)

        if not self._pairs:
            self._take(self._session.run(None, time_limit=left()))
            return
        if schedule is None:
            first = DEFAULT_SCHEDULE if shiftable else FALLBACK_SCHEDULE
            self._follow(first, left)
            if shiftable and not self._acceptable(self.steps[self.best]) and self.stop_reason not in _FINAL:
                logger.info(
                    "no acceptable point with delta following mu; continuing from the guess with %s", FALLBACK_SCHEDULE
                )
                self._put(self._start)
                self._follow(FALLBACK_SCHEDULE, left)
        else:
            self._follow(schedule, left)

    def _follow(self, schedule: Schedule, left: Any) -> None:
        if isinstance(schedule, FollowBarrier):
            for run in self._session.follow(schedule, time_limit=left()):
                self._take(run)
            step = self.steps[-1]
            # The rows may have moved in the very last iterations; products above their final bound say so.
            if step.status.solved and step.largest_product > 10 * schedule.floor:
                self._take(self._session.run(schedule.floor, warm=True, time_limit=left()))
            return
        warm = False
        for delta in schedule.steps():
            step = self._take(self._session.run(delta, warm=warm, time_limit=left()))
            if self.stop_reason in _FINAL:
                return
            # A failed run leaves multipliers that are worth nothing, and often a point that is.
            warm = step.status.solved or step.status is IpoptStatus.TINY_STEP
            if not warm:
                self.restore_best()
            if step.status.solved and step.largest_natural_residual <= 1e-9:
                return

    def _take(self, run: Run) -> Step:
        started = time.perf_counter()
        residuals = self.residuals()
        step = Step(
            label=run.label,
            delta=run.delta,
            mu=run.mu,
            status=run.status,
            iterations=run.iterations,
            seconds=run.seconds,
            objective=self._judge.objective(),
            constraint_violation=max(self._judge.violation(), *(each.infeasibility for each in residuals), 0.0),
            largest_product=max((abs(each.product) for each in residuals), default=0.0),
            largest_natural_residual=max((abs(each.natural) for each in residuals), default=0.0),
            path=run.path,
        )
        self.judging_seconds += time.perf_counter() - started
        self.steps.append(step)
        self._bar.line(str(step))
        logger.info("%s", step)
        self.stop_reason = _stop_reason(step)
        if self.best < 0 or self._rank(step) <= self._rank(self.steps[self.best]):
            self.best = len(self.steps) - 1
            self._best_values = [v.value for v in self._variables]
            self.stationarity = self._session.stationarity()
        return step

    def _rank(self, step: Step) -> tuple[float, bool]:
        """Smaller is better: how far the residuals exceed the tolerances (1 if not at all), then convergence."""
        feasibility, complementarity = self._tolerances
        excess = max(step.constraint_violation / feasibility, step.largest_product / complementarity, 1.0)
        return (excess if excess == excess else float("inf"), not step.status.solved)

    def _acceptable(self, step: Step) -> bool:
        return self._rank(step) == (1.0, False)

    @property
    def best_is_last(self) -> bool:
        """Whether the session still holds the multipliers of the best point."""
        return self.best == len(self.steps) - 1

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return pair_residuals(self._pairs)

    def restore_best(self) -> None:
        """Put the best point on the model."""
        self._put(self._best_values)

    def _put(self, values: list[float | None]) -> None:
        for variable, number in zip(self._variables, values, strict=True):
            variable.set_value(number, skip_validation=True)

    def quality(self) -> Quality:
        """How good the best point is."""
        step = self.steps[self.best]
        if self._rank(step)[0] > 1.0:
            return Quality.INFEASIBLE
        shown = step.status.solved or step.status is IpoptStatus.TINY_STEP
        if self.stationarity is not None:
            shown = shown and self.stationarity <= 1e-5
        return Quality.OPTIMAL if shown else Quality.FEASIBLE


def _stop_reason(step: Step) -> StopReason:
    if step.status.solved or step.status is IpoptStatus.TINY_STEP:
        return StopReason.FINISHED
    return _STOP_REASONS.get(step.status, StopReason.FAILED)
