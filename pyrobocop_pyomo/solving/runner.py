"""Runs of strategies: from a start that has values, by a backend that can evaluate the model, and what follows each."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.base import TransformationFactory
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.complementarity import BarrierSchedule, Schedule, active_sources, pairs_of, without_penalty
from pyrobocop_pyomo.diagnosis.statements import absolute_values_in
from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError
from pyrobocop_pyomo.ipopt.backends import find_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.programs.nonlinear_program import Scales
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram

from .curvature import direction_of_descent
from .ipopt_options import ITERATIONS_OF_ONE, inexact, warm_continuation
from .iterates import Iterate, StopReason
from .polish import Polish
from .record import Record
from .session import Session
from .solve_result import SolveResult
from .solver_sessions import InitialGuess, SolverSession, SolverSessions
from .starts import EXPLORED_ELEMENTS, coarser_copy, put_start, take_values_of_copy
from .strategies import BEYOND_SADDLE, FROM_THE_BEST, OTHER_OPTIMUM, SOLVE, Settings, StartingPoint, Strategy
from .violations import diverging_variables

logger = logging.getLogger(__name__)

# What finds the user's own point, or the solution nearest to it.
START = Strategy("initial guess")
# What a unit of violation costs with elastic rows, in slopes of the objective: above what multipliers may be expected
# to be.
PENALTY = 1e3
# A run that goes on from a saddle starts so far from it, in sizes of the variables.
STEP_FROM_SADDLE = 0.1
# So often on the way down is a step halved, in powers of ten, before the next one is taken without multipliers.
SHORTENED_STEPS = 4


class Continuation:
    """Runs a schedule, and remembers the best point.

    Parameters
    ----------
    runner : Runner
    opened : SolverSession
    session : Session
        The open one, or another one of the same model.
    strategy : Strategy

    Attributes
    ----------
    last : Iterate
        Where the last run ended.
    best : Iterate
    """

    best: Iterate
    last: Iterate

    def __init__(self, runner: Runner, opened: SolverSession, session: Session, strategy: Strategy) -> None:
        self._record, self._deadline = runner.record, runner.settings.deadline
        self._session, self._values = session, opened.values
        self._options = opened.options(runner.settings).with_strategy(strategy.options, strategy.most_iterations)
        # Where multipliers decide how the relaxation goes on, all runs have to be solved to the end.
        self._exact = not opened.relaxed.shifted_rows

    def run(self, schedule: Schedule | None, label: str) -> Iterate:
        """Run the schedule from the point on the model, and return the best one, which need not be there then.

        Parameters
        ----------
        schedule : Schedule or None
            None stands for one run of a model without pairs.
        label : str
            Of the one run of a model without pairs.
        """
        if schedule is None:
            self._take(replace(self._session.run(None, self._options.resolve(), self._deadline), label=label))
        elif isinstance(schedule, BarrierSchedule):
            self._follow(schedule)
        else:
            self._shrink(list(schedule.steps()))
        return self.best

    def _follow(self, schedule: BarrierSchedule) -> None:
        for iterate in self._session.follow(schedule, self._options, self._deadline):
            self._take(iterate)
        # The rows may have moved in the very last iterations; products above their final bound say so.
        final = list(schedule.steps())[-1]
        if self.last.converged and self.last.largest_product > 10 * final:
            self._run(final, self.last, {})

    def _shrink(self, steps: Sequence[float]) -> None:
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
                if self._record.has_no_better_limit(iterate):
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
        return self._take(self._session.run(delta, options, self._deadline, start))

    def _take(self, iterate: Iterate) -> Iterate:
        if iterate.stop_reason is StopReason.TIME_LIMIT and not self._deadline.has_passed:
            iterate = replace(iterate, stop_reason=StopReason.ITERATION_LIMIT)  # the user's of one run, not the solve's
        if iterate.stop_reason in (StopReason.ITERATION_LIMIT, StopReason.FAILED) and diverging_variables(self._values):
            # More iterations would only take it further: Ipopt itself calls that diverging much later.
            iterate = replace(iterate, stop_reason=StopReason.DIVERGED)
        self.last = iterate = replace(self._record.add(iterate), values=self._values.read())
        if not hasattr(self, "best") or self._is_better(iterate):
            self.best = iterate
        return iterate

    def _is_better(self, iterate: Iterate) -> bool:
        """Whether it is no worse than the best; what grows without end leads nowhere, even if it is feasible."""
        if iterate.diverged != self.best.diverged:
            return self.best.diverged
        return not self._record.is_better(self.best, iterate)


def _take_suffixes(model: Any, copy: Any) -> None:
    """What the solve of a copy has written to its suffixes, for the components that the model has too."""
    for suffix in model.component_objects(Suffix, active=True):
        for part, number in copy.find_component(suffix).items():
            own = None if part is None else model.find_component(part)
            if suffix.import_enabled() and own is not None:
                suffix[own] = number


class Runner:
    """Runs strategies of one solve: the model, how it is solved, and what has been found so far.

    Parameters
    ----------
    model : Block
    settings : Settings
    solve_copy : callable
        ``solve_copy(copy, settings)`` solves another model.

    Attributes
    ----------
    has_pairs : bool
        Whether the user has stated any, and not all of them are settled by bounds and fixed variables.
    record : Record
    values : VariableValues
        The user's free variables.
    guess : InitialGuess
    sessions : SolverSessions
    """

    def __init__(self, model: Any, settings: Settings, solve_copy: Callable[[Any, Settings], SolveResult]) -> None:
        self.model, self.settings = model, settings
        self.has_pairs = bool(active_sources(model) or pairs_of(model))
        self.values = VariableValues.of_free(model)
        self.record = Record(model, settings, len(self.values.variables))
        self.guess = InitialGuess(model, self.values)
        self.sessions = SolverSessions(model, settings, self.guess)
        self._solve_copy = solve_copy

    def run(self, strategy: Strategy) -> Iterate | None:
        """Run a strategy, from elsewhere where it cannot begin at the initial guess.

        Returns
        -------
        Iterate or None
            None where the strategy has nothing to work on here.
        """
        try:
            iterate = self._run_here(strategy)
        except EvaluationError as error:
            logger.info("'%s': strategy '%s': %s", self.model.name, strategy.name, error)
            if self.record.best is not None:
                return None
            self.values.write(self.guess.values)  # the user's point itself, as there is no other one
            run = self.record.add(Iterate.of_run("no derivatives", IpoptStatus.INVALID_NUMBER))
            return replace(run, strategy=strategy.name, values=self.guess.values)
        # The executable does not say why it could not begin.
        could_begin = iterate is None or iterate.converged or iterate.iterations > 0 or iterate.stop_reason.is_final
        if not could_begin and self.guess.move():
            self.sessions.close()
            return self.run(strategy)
        return iterate

    def keep(self, iterate: Iterate) -> None:
        """Remember the iterate, and where a function had no value on the way."""
        if iterate.stop_reason.is_final and self.record.cut is None:
            self.record.cut = iterate.stop_reason
        self.record.keep(iterate)
        compiled = None if self.sessions.current is None else self.sessions.current.session.compiled()
        if compiled is not None and iterate.undefined_at is not None and not iterate.converged:
            self.guess.undefined = compiled, iterate.undefined_at

    def go_back_to_start(self) -> None:
        """Polish the point that all strategies started from, where rows and pairs hold there and none led to a better.

        They go through relaxed points, and an interior-point method leaves a start that lies on bounds.
        """
        opened, best = self.sessions.current, self.record.best
        if opened is None or not opened.relaxed.has_pairs_alone or best is None or self.record.has_to_stop():
            return
        self._put_start(opened, START)
        start = self.record.checked(Iterate(START.name, strategy=START.name, stop_reason=StopReason.ITERATION_LIMIT))
        standing = start.standing(self.settings.tolerances, self.record.check.sign)
        if standing.feasible and standing.exact and self.record.is_better(start, best):
            start = replace(self.record.add(start), values=self.values.read())
            polish = self._polish(opened)
            self.keep(start if polish is None else polish.improve(start, opened.session))

    def explore(self) -> None:
        """Look for better optima beyond the best point, if that is certified and there is time for it."""
        best, opened = self.record.best, self.sessions.current
        if opened is None or best is None or not (opened.relaxed.has_pairs_alone and self.record.left_to_explore()[1]):
            return
        with self.keep_best_when_stopped("exploration"):
            polish = self._polish(opened)
            if polish is not None:
                self.values.write(best.values)
                opened.relaxed.start_lifted()
                explored = polish.explore(best)
                if explored is not best:
                    self.keep(explored)

    @contextlib.contextmanager
    def keep_best_when_stopped(self, doing: str) -> Iterator[None]:
        """Once there is a point, what looks for a better one or for more of it may be interrupted, or fail."""
        try:
            yield
        except KeyboardInterrupt:
            if self.record.best is None:
                raise
            self.record.cut = StopReason.INTERRUPTED
        except PyRobocopError as error:
            if self.record.best is None:
                raise
            level = logging.INFO if self.record.is_certified(self.record.best) else logging.WARNING
            logger.log(level, "'%s': %s failed: %s", self.model.name, doing, error)

    def _run_here(self, strategy: Strategy) -> Iterate | None:
        is_copied = strategy.start is StartingPoint.ABSOLUTE_VALUES
        # There may be none, or the model is part of another one.
        if is_copied and (self.model.model() is not self.model or not any(absolute_values_in(self.model))):
            return None
        opened = self.sessions.move_to(strategy)
        self.record.check_pairs(opened.relaxed.pairs)
        if is_copied:
            return self._with_absolute_values_split(strategy)
        if self.has_pairs and not opened.relaxed.pairs:
            self.has_pairs, strategy = False, SOLVE
        if self.has_pairs and isinstance(strategy.schedule, BarrierSchedule) and not opened.relaxed.shifted_rows:
            return None
        if not self._put_start(opened, strategy):
            return None
        iterate = self._run_polished(opened, strategy)
        return iterate if iterate is None or self.has_pairs else self._beyond_saddles(opened, iterate)

    def _put_start(self, opened: SolverSession, strategy: Strategy) -> bool:
        """Put the start of a strategy on the model; False where there is none."""
        start, best = strategy.start, self.record.best
        if start is StartingPoint.REACHED:
            return True
        opened.values.write(opened.start)
        if start in FROM_THE_BEST:
            if best is None or best.values is None:
                return False
            self.values.write(best.values)
        # Before anything was tried, it is a better start only where equations depend on each other at the guess.
        is_early = start is StartingPoint.SIMULATED and best is None and self.settings.strategies is None
        if is_early and not opened.session.missing_rank():
            return False
        is_put = self.put_other_optimum() if start is StartingPoint.OTHER_OPTIMUM else put_start(self.model, strategy)
        if start is not StartingPoint.INITIAL_GUESS:
            opened.relaxed.start_lifted()
        return is_put

    def _run_polished(self, opened: SolverSession, strategy: Strategy) -> Iterate | None:
        """Run the strategy's schedule from the point on the model, and polish the best point of it."""
        session = opened.session.with_elastic_rows(PENALTY) if strategy.elastic_rows else opened.session
        if session is None:
            return None
        continuation = Continuation(self, opened, session, strategy)
        relaxed = continuation.run(strategy.schedule if self.has_pairs else None, strategy.name)
        opened.values.write(relaxed.values)
        iterate = replace(relaxed, strategy=strategy.name, values=self.values.read())
        if strategy.elastic_rows and iterate.converged and not iterate.excess(self.settings.tolerances) <= 1.0:
            return replace(iterate, stop_reason=StopReason.INFEASIBLE)
        if continuation.last.stop_reason.is_final:
            self.record.cut = continuation.last.stop_reason
        if iterate.diverged or self.record.cut is not None or self.record.has_no_better_limit(continuation.last):
            return iterate
        polish = self._polish(opened)
        if polish is None:
            return iterate
        improved = polish.improve(iterate, opened.session)
        if polish.has_diverged and not self.record.is_certified(improved):
            return replace(improved, stop_reason=StopReason.DIVERGED)  # it was on the same way
        return improved

    def _polish(self, opened: SolverSession) -> Polish | None:
        """The polish of an open solver session; None where it is not wanted or cannot be done."""
        if not self.settings.polish or not opened.relaxed.lifted or find_ipopt_library() is None:
            return None
        if opened.relaxed.has_penalty:
            with without_penalty(self.model):
                compiled = opened.session.compiled(anew=True)
        else:
            compiled = opened.session.compiled()
        if compiled is None:
            return None
        settings = replace(self.settings, options=opened.options(self.settings))
        return Polish(settings, opened.relaxed, compiled, self.record, self.values)

    def _beyond_saddles(self, opened: SolverSession, iterate: Iterate) -> Iterate:
        """The point on the model, or a better one that runs lead to from it where it is stationary and no minimum."""
        while starts := self._starts_beyond(opened, iterate):
            saddle = iterate = replace(iterate, certificate=Certificate.DESCENT)
            if not self.record.is_better(saddle, self.record.best):
                break
            self.keep(saddle)
            for start in starts:
                opened.values.write(start)
                lower = self._run_polished(opened, BEYOND_SADDLE) or saddle
                is_lower = self.record.is_better(replace(lower, certificate=Certificate.DESCENT), saddle)
                if is_lower or lower.stop_reason.is_final:
                    iterate = lower
                    break
        return iterate

    def _starts_beyond(self, opened: SolverSession, iterate: Iterate) -> list[Values]:
        """Starts on both sides of the point on the model, if it is the best, stationary and no minimum."""
        compiled, is_best = opened.session.compiled(), self.record.is_better(iterate, self.record.best)
        if compiled is None or not (is_best and self.record.is_certified(iterate)):
            return []
        nlp, point, scaling = compiled.nlp, opened.session.primal_dual(iterate, compiled), opened.session.scaling
        scales = Scales(np.ones(nlp.n), np.ones(nlp.m), 1.0) if scaling is None else scaling.scales
        try:
            direction = direction_of_descent(ScaledProgram(nlp, scales), scales.scaled(point))
        except EvaluationError:
            direction = None
        if direction is None:
            return []
        step = STEP_FROM_SADDLE * direction * scales.x
        starts = []
        for x in (point.x + step, point.x - step):
            compiled.load_point(np.clip(x, nlp.x_lower, nlp.x_upper))
            starts.append(opened.values.read())
        return starts

    def put_other_optimum(self) -> bool:
        """Try other starts on a copy with fewer elements; where they lead to a better answer, put it on the model.

        The copy is solved from the answer on the model first: fewer elements may flatter the objective.

        Returns
        -------
        bool
            Whether there is a better answer. False where less time is left than has passed.
        """
        left = self.settings.deadline.left
        # Making a copy is not cut off. There is an answer already: its solve tells what another one would take.
        if left is not None and left < time.perf_counter() - self.record.started:
            return False
        copy = coarser_copy(self.model, EXPLORED_ELEMENTS)
        if copy is None:
            return False
        result = self._solution_of(copy, OTHER_OPTIMUM)
        # Of two solutions the copy has kept the better one.
        if result is None or self.record.cut is not None or not result.solved or result.best.number == 0:
            return False
        take_values_of_copy(self.model, copy)
        return True

    def _with_absolute_values_split(self, strategy: Strategy) -> Iterate | None:
        """Solve a copy with its absolute values in two parts; its answer is one of the model, and is checked there."""
        self.sessions.close()  # the copy is made of the model as it was stated
        self.values.write(self.guess.start)
        split = TransformationFactory("pyrobocop.absolute_values_to_complementarity")
        copy = split.create_using(self.model)
        result = self._solution_of(copy, strategy)
        if result is None:
            return None
        take_values_of_copy(self.model, copy)
        answer = replace(result.best, label=strategy.name, iterations=0, seconds=0.0, delta=None)
        if not self.has_pairs and answer.certificate is Certificate.PROVEN:
            answer = replace(answer, certificate=Certificate.UNKNOWN)  # which is of pairs, and the model has none
        return replace(
            self.record.add(answer),
            strategy=strategy.name,
            values=self.values.read(),
            load_suffixes=partial(_take_suffixes, self.model, copy),
        )

    def _solution_of(self, copy: Any, strategy: Strategy) -> SolveResult | None:
        """Solve a copy, and log its runs as runs of a strategy; None where it cannot be solved at all."""
        options = self.settings.options.with_default({"max_iter": ITERATIONS_OF_ONE})
        settings = replace(self.settings, options=options, strategies=None, progress=Progress(False))
        try:
            result = self._solve_copy(copy, settings)
        except PyRobocopError as error:
            logger.info("'%s': no answer of the copy for '%s': %s", self.model.name, strategy.name, error)
            return None
        for step in result.steps:
            self.record.steps.append(replace(step, label=strategy.name, number=len(self.record.steps)))
        if result.stop_reason.is_final:
            self.record.cut = result.stop_reason
        return result
