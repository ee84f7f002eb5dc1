"""A continuation: runs of Ipopt for one delta after the other, each checked, the best one kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.complementarity import BarrierSchedule, Schedule

from .ipopt_options import ITERATIONS_OF_ONE, IpoptOptions, inexact, warm_continuation
from .iterates import Iterate, StopReason
from .session import Session
from .solve_state import SolveState
from .violations import growing_variables
from .workplaces import Workplace

# So often on the way down is a step halved, in powers of ten, before the next one is taken without multipliers.
SHORTENED_STEPS = 4


class Continuation:
    """Runs a schedule, and remembers the best point.

    Parameters
    ----------
    state : SolveState
    place : Workplace
    session : Session
        That of the workplace, or another one of the same model.
    options : IpoptOptions

    Attributes
    ----------
    last : Iterate
        Where the last run ended.
    best : Iterate
    """

    best: Iterate
    last: Iterate

    def __init__(self, state: SolveState, place: Workplace, session: Session, options: IpoptOptions) -> None:
        self._log, self._settings, self._found = state.log, state.settings, state.found
        self._session, self._values, self._options = session, place.values, options
        # Where multipliers decide how the relaxation goes on, all runs have to be solved to the end.
        self._exact = not place.relaxed.shifted_rows

    def run(
        self,
        schedule: Schedule | None,
        *,
        label: str = "solve",
        leads_no_further: Callable[[Iterate], bool] = lambda iterate: False,
    ) -> Iterate:
        """Run the schedule from the point on the model, and return the best one, which need not be there then.

        Parameters
        ----------
        schedule : Schedule or None
            None stands for one run of a model without pairs.
        label : str
            Of the one run of a model without pairs.
        leads_no_further : callable
            Whether to end a shrinking schedule at a point, though it is not the last one.
        """
        if schedule is None:
            self._take(replace(self._session.run(None, self._options.resolve(), self._settings.deadline), label=label))
        elif isinstance(schedule, BarrierSchedule):
            self._follow(schedule)
        else:
            self._shrink(list(schedule.steps()), leads_no_further)
        return self.best

    def _follow(self, schedule: BarrierSchedule) -> None:
        for iterate in self._session.follow(schedule, self._options, self._settings.deadline):
            self._take(iterate)
        # The rows may have moved in the very last iterations; products above their final bound say so.
        final = list(schedule.steps())[-1]
        if self.last.converged and self.last.largest_product > 10 * final:
            self._run(final, self.last, {})

    def _shrink(self, steps: Sequence[float], leads_no_further: Callable[[Iterate], bool]) -> None:
        """Solve for one delta after the other; where a step is too long, take a shorter one from the last solution."""
        wanted, shortened = list(steps)[::-1], 0
        start: Iterate | None = None
        purpose: dict[str, Any] = {}
        while wanted:
            delta = wanted.pop()
            on_the_way = {} if self._exact or delta == steps[-1] else inexact(delta)
            iterate = self._run(delta, start, {**on_the_way, **purpose})
            if iterate.stop_reason.is_final or (iterate.converged and iterate.largest_natural_residual <= 1e-9):
                return
            if iterate.converged:
                if leads_no_further(iterate):
                    return
                start = iterate
            elif start is not None and start.delta is not None and start.delta > delta and shortened < SHORTENED_STEPS:
                wanted += [delta, (delta * start.delta) ** 0.5]
                self._values.write(start.values)
                shortened += 1
            elif self.best.diverged:
                return  # there is no point to go on from
            else:
                # A failed run leaves multipliers that are worth nothing, and often a point that is.
                start, purpose = None, {"max_iter": ITERATIONS_OF_ONE}
                self._values.write(self.best.values)

    def _run(self, delta: float, start: Iterate | None, purpose: Mapping[str, Any]) -> Iterate:
        warm = {} if start is None else warm_continuation(delta)
        options = self._options.resolve(warm, purpose)
        return self._take(self._session.run(delta, options, self._settings.deadline, start))

    def _take(self, iterate: Iterate) -> Iterate:
        if iterate.stop_reason is StopReason.TIME_LIMIT and not self._settings.deadline.has_passed:
            iterate = replace(iterate, stop_reason=StopReason.ITERATION_LIMIT)  # the user's of one run, not the solve's
        if iterate.stop_reason in (StopReason.ITERATION_LIMIT, StopReason.FAILED) and growing_variables(self._values):
            # More iterations would only take it further: Ipopt itself calls that diverging much later.
            iterate = replace(iterate, stop_reason=StopReason.DIVERGED)
        self.last = iterate = replace(self._log.add(iterate), values=self._values.read())
        if not hasattr(self, "best") or self._is_better(iterate):
            self.best = iterate
        return iterate

    def _is_better(self, iterate: Iterate) -> bool:
        """Whether it is no worse than the best; what grows without end leads nowhere, even if it is feasible."""
        if iterate.diverged != self.best.diverged:
            return self.best.diverged
        return not self._found.is_better(self.best, iterate)
