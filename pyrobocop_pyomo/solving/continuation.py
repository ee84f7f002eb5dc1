"""A continuation: runs of Ipopt for one delta after the other, each checked, the best one kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.complementarity import BarrierSchedule, Schedule
from pyrobocop_pyomo.modeling.variable_values import VariableValues

from .ipopt_options import WARM_ITERATIONS, IpoptOptions, inexact, warm_continuation
from .iterate_log import IterateLog
from .iterates import Iterate, StopReason
from .session import Session
from .settings import Settings
from .violations import growing_variables

# From here on a polish may lead to the exact branch; above, the nearest branch is often another one.
POLISHED_EARLY = 1e-4
# So often on the way down is a step halved, in powers of ten, before the next one is taken without multipliers.
SHORTENED_STEPS = 4
# After so many failures in a row the steps between are left out: with less room they fail as well.
FAILED_STEPS = 2


class Continuation:
    """Runs a schedule, and remembers the best point.

    Parameters
    ----------
    session : Session
    log : IterateLog
    values : VariableValues
        What a point is made of.
    settings : Settings
    sign : float
        1 where the objective is minimised, -1 where it is maximised.
    options : IpoptOptions
    exact : bool
        Whether runs before the last have to be solved to the end: where multipliers decide how the relaxation goes on.

    Attributes
    ----------
    last : Iterate
        Where the last run ended.
    best : Iterate
    """

    best: Iterate
    last: Iterate

    def __init__(
        self,
        session: Session,
        log: IterateLog,
        values: VariableValues,
        settings: Settings,
        sign: float,
        options: IpoptOptions,
        *,
        exact: bool,
    ) -> None:
        self._session, self._log, self._values = session, log, values
        self._settings, self._sign, self._options, self._exact = settings, sign, options, exact
        self._on_the_way: dict[int, Iterate] = {}  # alive, so that no other object gets the same identity

    def run(
        self,
        schedule: Schedule | None,
        *,
        start: Iterate | None = None,
        purpose: Mapping[str, Any] | None = None,
        label: str = "solve",
        leads_no_further: Callable[[Iterate], bool] = lambda iterate: False,
        is_enough: Callable[[Iterate], bool] = lambda iterate: False,
    ) -> Iterate:
        """Run the schedule and return the best point, which need not be the one on the model.

        Parameters
        ----------
        schedule : Schedule or None
            None stands for one run of a model without pairs.
        start : Iterate, optional
            To start from, warm in primal and dual values; otherwise from the point on the model.
        purpose : mapping, optional
            Ipopt's options for all runs of a shrinking schedule.
        label : str
            Of the one run of a model without pairs.
        leads_no_further : callable
            Whether to end a shrinking schedule at a point, though it is not the last one.
        is_enough : callable
            Whether a polish of the last solution leads to the end; called once, where the step after it failed.
        """
        if schedule is None:
            self._take(replace(self._session.run(None, self._options.resolve(), self._settings.deadline), label=label))
        elif isinstance(schedule, BarrierSchedule):
            self._follow(schedule)
        else:
            self._shrink(schedule, start, purpose or {}, leads_no_further, is_enough)
            self._check_best()
        return self.best

    def _check_best(self) -> None:
        """Check the best point by the user's expressions, where that was put off."""
        if id(self.best) in self._on_the_way:
            self._values.write(self.best.values)
            self.best = self._log.checked(self.best)

    def _follow(self, schedule: BarrierSchedule) -> None:
        for iterate in self._session.follow(schedule, self._options, self._settings.deadline):
            self._take(iterate)
        # The rows may have moved in the very last iterations; products above their final bound say so.
        final = list(schedule.steps())[-1]
        if self.last.converged and self.last.largest_product > 10 * final:
            self._run(final, self.last, {})

    def _shrink(
        self,
        schedule: Schedule,
        start: Iterate | None,
        purpose: Mapping[str, Any],
        leads_no_further: Callable[[Iterate], bool],
        is_enough: Callable[[Iterate], bool],
    ) -> None:
        """Solve for one delta after the other; where a step is too long, take a shorter one from the last solution."""
        wanted = list(schedule.steps())[::-1]
        final = wanted[0]
        if start is not None:
            self._values.write(start.values)
        shortened, failed, polished = 0, 0, False
        while wanted:
            delta = wanted.pop()
            on_the_way = {} if self._exact or delta == final else inexact(delta)
            iterate = self._run(delta, start, {**on_the_way, **purpose}, on_the_way=delta != final)
            if iterate.stop_reason.is_final or (iterate.converged and iterate.largest_natural_residual <= 1e-9):
                return
            if iterate.converged:
                if leads_no_further(iterate):
                    return
                start, failed = iterate, 0
                continue
            if start is not None and not polished and (start.delta or 1.0) <= POLISHED_EARLY:
                polished = True
                if is_enough(start):
                    return
            if start is not None and _is_shorter(start, delta) and shortened < SHORTENED_STEPS:
                assert start.delta is not None
                wanted += [delta, (delta * start.delta) ** 0.5]
                self._values.write(start.values)
                shortened += 1
            elif self.best.diverged:
                return  # there is no point to go on from
            else:
                # A failed run leaves multipliers that are worth nothing, and often a point that is.
                start, purpose, failed = None, {"max_iter": WARM_ITERATIONS, **purpose}, failed + 1
                if failed >= FAILED_STEPS:
                    wanted = wanted[:1]
                self._values.write(self.best.values)

    def _run(
        self, delta: float, start: Iterate | None, purpose: Mapping[str, Any], *, on_the_way: bool = False
    ) -> Iterate:
        warm = {} if start is None else warm_continuation(delta)
        return self._take(
            self._session.run(delta, self._options.resolve(warm, purpose), self._settings.deadline, start),
            start=start,
            on_the_way=on_the_way,
        )

    def _take(self, iterate: Iterate, *, start: Iterate | None = None, on_the_way: bool = False) -> Iterate:
        if iterate.stop_reason is StopReason.TIME_LIMIT and not self._settings.deadline.has_passed:
            iterate = replace(iterate, stop_reason=StopReason.ITERATION_LIMIT)  # the user's of one run, not the solve's
        if iterate.stop_reason in (StopReason.ITERATION_LIMIT, StopReason.FAILED) and growing_variables(self._values):
            # More iterations would only take it further: Ipopt itself calls that diverging much later.
            iterate = replace(iterate, stop_reason=StopReason.DIVERGED)
        # What did not converge may be the last point that there is, and is checked in full.
        on_the_way = on_the_way and iterate.converged and math.isfinite(iterate.constraint_violation)
        if start is not None and iterate.iterations == 0 and iterate.converged:
            # It was a solution before: the same point, which was checked already.
            self._values.write(start.values)
            iterate = self._log.add(iterate, at=start)
        else:
            iterate = self._log.add(iterate, on_the_way=on_the_way)
        self.last = iterate = replace(iterate, values=self._values.read())
        if on_the_way:
            self._on_the_way[id(iterate)] = iterate
        if not hasattr(self, "best") or self._is_better(iterate):
            self.best = iterate
        return iterate

    def _is_better(self, iterate: Iterate) -> bool:
        """Whether it is no worse than the best; what grows without end leads nowhere, even if it is feasible."""
        if iterate.diverged != self.best.diverged:
            return self.best.diverged
        return not self.best.is_better_than(iterate, self._settings.tolerances, self._sign)


def _is_shorter(start: Iterate, delta: float) -> bool:
    """Whether there is a delta between that of the last solution and the next one that is worth trying."""
    # Four times halved, in powers of ten, a step of 0.1 is one of 0.87.
    return start.delta is not None and start.delta > 1.1 * delta
