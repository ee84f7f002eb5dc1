"""Runs of strategies: from a start that has values, by a backend that can evaluate the model, and what follows each."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.base import TransformationFactory
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.complementarity import BarrierSchedule, Schedule, active_sources, pairs_of, without_penalty
from pyrobocop_pyomo.diagnosis.statements import absolute_values_in
from pyrobocop_pyomo.errors import EvaluationError, PyRobocopError
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint, Scales
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram

from .curvature import direction_of_descent
from .initial_guess import InitialGuess
from .ipopt_options import ITERATIONS_OF_ONE, NEARLY_THERE, IpoptOptions, inexact, warm_continuation
from .iterates import Iterate, Quality, StopReason
from .polish import Polish
from .progress import Progress
from .record import SAME_OBJECTIVE, Record
from .session import Session
from .settings import Settings
from .solve_result import SolveResult
from .starts import EXPLORED_ELEMENTS, coarser_copy, elements_of, elements_of_copy, put_start, take_values_of_copy
from .strategies import (
    ABSOLUTE_VALUES,
    BEYOND_SADDLE,
    OTHER_OPTIMUM,
    SIMULATED,
    SOLVE,
    StartingPoint,
    Strategy,
)
from .violations import growing_variables
from .workplaces import Workplace, Workplaces

logger = logging.getLogger(__name__)

# The strategy that found an answer which is the user's own point, or the solution nearest to it.
START = "initial guess"
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

    def __init__(self, runner: Runner, place: Workplace, session: Session, options: IpoptOptions) -> None:
        self._record, self._deadline = runner.record, runner.settings.deadline
        self._session, self._values, self._options = session, place.values, options
        # Where multipliers decide how the relaxation goes on, all runs have to be solved to the end.
        self._exact = not place.relaxed.shifted_rows

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
                if self._record.leads_no_further(iterate):
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
        if iterate.stop_reason in (StopReason.ITERATION_LIMIT, StopReason.FAILED) and growing_variables(self._values):
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
        Whether the user has stated any.
    record : Record
    values : VariableValues
        The user's free variables.
    guess : InitialGuess
    places : Workplaces
    has_linear_rows : bool or None
        Whether all rows are linear but for the pairs; None before the first polish, which looks.
    tried : set of str
        Names of the strategies that have run.
    """

    def __init__(self, model: Any, settings: Settings, solve_copy: Callable[[Any, Settings], SolveResult]) -> None:
        self.model, self.settings = model, settings
        self.record = Record(model, settings)
        self.has_pairs = bool(active_sources(model) or pairs_of(model))
        self.values = VariableValues.of_free(model)
        self.guess = InitialGuess(model, self.values)
        self.places = Workplaces(model, settings, self.guess)
        self.has_linear_rows: bool | None = None
        self.tried: set[str] = set()
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
            return self._without_derivatives(strategy, str(error))
        if iterate is None or iterate.converged:
            return iterate
        # The executable does not say why it could not begin.
        if iterate.iterations == 0 and not iterate.stop_reason.is_final and self.guess.move():
            self.places.restart()
            return self.run(strategy)
        return iterate

    def keep(self, iterate: Iterate) -> None:
        """Remember what was found, and where a function had no value on the way."""
        self.record.keep(iterate)
        if self.places.place is not None:
            self.guess.note(iterate, self.places.place.session)

    def go_back_to_start(self) -> None:
        """Polish the point that all strategies started from, where rows and pairs hold there and none led to a better.

        They go through relaxed points, and an interior-point method leaves a start that lies on bounds.
        """
        place, best = self.places.place, self.record.best
        if place is None or not place.relaxed.pairs or best is None or self.record.is_cut():
            return
        if place.relaxed.crossed:
            return  # products of sides of different pairs are more than the pairs say
        place.values.write(place.start)
        place.relaxed.start_lifted()
        start = self.record.checked(Iterate(START, strategy=START, stop_reason=StopReason.ITERATION_LIMIT))
        tolerances = self.settings.tolerances
        is_met = start.excess(tolerances) <= 1.0 and start.is_exact(tolerances)
        if not is_met or not self.record.is_better(start, best):
            return
        start = replace(self.record.add(start), values=self.values.read())
        polished, _ = self._polished(place, start, lambda compiled: PrimalDualPoint(compiled.current_point()))
        self.keep(polished)

    def explore(self) -> None:
        """Look for better optima beyond the best point, if that is certified and there is time for it."""
        best, place = self.record.best, self.places.place
        if place is None or best is None or self.record.cut is not None or best.certificate is not Certificate.PROVEN:
            return
        try:
            polish, _ = self._polish(place)
            if polish is None:
                return
            self.values.write(best.values)
            place.relaxed.start_lifted()
            explored = polish.explore(best)
            self._note_end(polish)
            if explored is not best:
                self.keep(explored)
        except KeyboardInterrupt:
            self.record.cut = StopReason.INTERRUPTED
        except EvaluationError as error:
            logger.info("exploration ends: %s", error)

    def _run_here(self, strategy: Strategy) -> Iterate | None:
        place = self.places.move_to(strategy)
        self.record.check_pairs(place.relaxed.pairs)
        if not place.relaxed.pairs:
            # The presolve may have settled all of them: then strategies for pairs are one solve.
            return self._run_without_pairs(place, SOLVE if self.has_pairs else strategy)
        if isinstance(strategy.schedule, BarrierSchedule) and not place.relaxed.shifted_rows:
            return None
        place.values.write(place.start)
        if strategy.start is not StartingPoint.INITIAL_GUESS:
            if not put_start(self.model, strategy):
                return None
            place.relaxed.start_lifted()
        return self._run_polished(place, strategy)

    def _without_derivatives(self, strategy: Strategy, why: str) -> Iterate | None:
        """The user's point itself, where there is no other one."""
        logger.info("'%s': strategy '%s': %s", self.model.name, strategy.name, why)
        if self.record.best is not None:
            return None
        self.guess.write()
        run = self.record.add(Iterate.of_run("no derivatives", IpoptStatus.INVALID_NUMBER))
        return replace(run, strategy=strategy.name, values=self.guess.values)

    def _run_without_pairs(self, place: Workplace, strategy: Strategy) -> Iterate | None:
        """Run a strategy, and go on from where it ends at a saddle; None where it has no start, or no program."""
        if strategy.start is StartingPoint.ABSOLUTE_VALUES:
            place.values.write(place.start)
            return self.with_absolute_values_split()
        iterate = self._run_from_start(place, strategy)
        return None if iterate is None else self._beyond_saddles(place, iterate)

    def _beyond_saddles(self, place: Workplace, iterate: Iterate) -> Iterate:
        """The point on the model, or a better one that runs lead to from it where it is stationary and no minimum."""
        known = self.record.best
        if known is not None and not self.record.is_better(iterate, known):
            return iterate  # whatever it is
        starts = self._starts_beyond(place, iterate)
        if not starts:
            return iterate
        saddle = replace(iterate, certificate=Certificate.DESCENT)
        if known is not None and not self.record.is_better(saddle, known):
            return saddle
        if not self.record.is_certified(known):
            self.keep(saddle)
        for start in starts:
            place.values.write(start)
            try:
                lower = self._run_polished(place, BEYOND_SADDLE, BEYOND_SADDLE.name)
            except EvaluationError:
                continue
            lower = self._beyond_saddles(place, lower)
            if lower.stop_reason.is_final or self.record.is_better(lower, saddle):
                return lower
        return saddle

    def _starts_beyond(self, place: Workplace, iterate: Iterate) -> list[Values]:
        """Starts on both sides of the point on the model, if it is stationary and no minimum; otherwise none."""
        compiled = place.session.compiled() if self.record.is_certified(iterate) else None
        if compiled is None:
            return []
        nlp, point, scaling = compiled.nlp, place.session.primal_dual(iterate, compiled), place.session.scaling
        scales = Scales(np.ones(nlp.n), np.ones(nlp.m), 1.0) if scaling is None else scaling.scales
        try:
            direction = direction_of_descent(ScaledProgram(nlp, scales), scales.scaled(point))
        except EvaluationError:
            return []
        if direction is None:
            return []
        step = STEP_FROM_SADDLE * direction * scales.x
        starts = []
        for x in (point.x + step, point.x - step):
            compiled.load_point(np.clip(x, nlp.x_lower, nlp.x_upper))
            starts.append(place.values.read())
        return starts

    def _run_from_start(self, place: Workplace, strategy: Strategy) -> Iterate | None:
        if strategy.start is not StartingPoint.REACHED:
            place.values.write(place.start)
            if not self._put_start(place, strategy):
                return None
        if strategy.elastic_rows:
            return self._run_elastic(place, strategy)
        if strategy.name == SOLVE.name and self.settings.strategies is None and self.settings.second_tries:
            simulated = self._run_simulated_first(place)
            if simulated is not None and (self.record.is_certified(simulated) or simulated.stop_reason.is_final):
                return simulated
            if simulated is not None:
                self.keep(simulated)
                place.values.write(place.start)
        return self._run_polished(place, strategy, strategy.name)

    def _run_simulated_first(self, place: Workplace) -> Iterate | None:
        """Where equations depend on each other at the initial guess, start from the motion under its controls."""
        dependent = place.session.missing_rank()
        if not dependent or not put_start(self.model, SIMULATED):
            return None
        logger.info("'%s': %d equations are dependent at the initial guess", self.model.name, dependent)
        self.tried.add(SIMULATED.name)
        return self._run_polished(place, replace(SIMULATED, options={"max_iter": ITERATIONS_OF_ONE}), SIMULATED.name)

    def _put_start(self, place: Workplace, strategy: Strategy) -> bool:
        if strategy.start not in (StartingPoint.BEST, StartingPoint.MIRRORED, StartingPoint.OTHER_OPTIMUM):
            return put_start(self.model, strategy)
        best = self.record.best
        if best is None or best.values is None:
            return False
        place.values.write(best.values)
        if strategy.start is StartingPoint.OTHER_OPTIMUM:
            work = self.record.exploration.work_within(0, self.record.iterations)
            return self.start_at_other_optimum(work)
        return strategy.start is StartingPoint.BEST or put_start(self.model, strategy)

    def _run_elastic(self, place: Workplace, strategy: Strategy) -> Iterate | None:
        """Let rows be violated at a price; from where that ends, go on with the rows as they are."""
        session = place.session.with_elastic_rows(PENALTY)
        if session is None:
            return None
        elastic = self._continuation(place, strategy, session).run(None, strategy.name)
        if not elastic.excess(self.settings.tolerances) <= 1.0 and elastic.converged:
            elastic = replace(elastic, stop_reason=StopReason.INFEASIBLE)
        iterate = replace(elastic, strategy=strategy.name)
        if self.record.is_certified(iterate) or iterate.stop_reason.is_final:
            return iterate
        self.keep(iterate)
        on = replace(strategy, options={**NEARLY_THERE, **strategy.options})
        return self._run_polished(place, on, "solve from there")

    def _run_polished(self, place: Workplace, strategy: Strategy, label: str = "solve") -> Iterate:
        """Run the strategy's schedule and polish the best point of it."""
        continuation = self._continuation(place, strategy)
        relaxed = continuation.run(strategy.schedule if place.relaxed.pairs else None, label)
        if self.record.leads_no_further(continuation.last):
            place.values.write(relaxed.values)
            return replace(relaxed, strategy=strategy.name, values=self.values.read())
        return self._improved(place, strategy, relaxed, continuation)

    def _continuation(self, place: Workplace, strategy: Strategy, session: Session | None = None) -> Continuation:
        """A strategy's runs from the point on the model, by the session of the workplace or by another one."""
        return Continuation(self, place, session or place.session, self._options(place, strategy))

    def _improved(self, place: Workplace, strategy: Strategy, relaxed: Iterate, continuation: Continuation) -> Iterate:
        """What a polish makes of the best relaxed point, in terms of the user's variables."""
        place.values.write(relaxed.values)
        iterate = replace(relaxed, strategy=strategy.name, values=self.values.read())
        if relaxed.diverged:
            return iterate
        if continuation.last.stop_reason.is_final:
            self.record.cut = continuation.last.stop_reason
            return iterate
        improved, diverged = self._polished(place, iterate, partial(place.session.primal_dual, relaxed))
        if diverged and not self.record.is_certified(improved):
            return replace(improved, stop_reason=StopReason.DIVERGED)  # it was on the same way
        return improved

    def _polished(
        self, place: Workplace, iterate: Iterate, point_in: Callable[[CompiledModel], PrimalDualPoint]
    ) -> tuple[Iterate, bool]:
        """What a polish makes of an iterate, and whether variables grew without end on one of its branches.

        Parameters
        ----------
        place : Workplace
        iterate : Iterate
            On the model.
        point_in : callable
            The same in the order of a compiled model.
        """
        polish, compiled = self._polish(place)
        if polish is None or compiled is None:
            return iterate, False
        try:
            return polish.improve(iterate, point_in(compiled)), bool(polish.diverged)
        finally:
            self._note_end(polish)

    def _polish(self, place: Workplace) -> tuple[Polish | None, Any]:
        """What polishes and certifies, with its compiled model; None where it is not wanted or cannot be done here."""
        if not self.settings.polish or not place.relaxed.lifted or find_ipopt_library() is None:
            return None, None
        if place.relaxed.has_penalty:
            with without_penalty(self.model):
                compiled = place.session.compiled(anew=True)
        else:
            compiled = place.session.compiled()
        if compiled is None:
            return None, None
        settings = replace(self.settings, options=place.options(self.settings))
        return Polish(settings, place.relaxed, compiled, self.record, self.values), compiled

    def _note_end(self, polish: Polish) -> None:
        if self.has_linear_rows is None:
            self.has_linear_rows = polish.has_linear_rows
        for diverged in polish.diverged:
            self.record.note_diverged(diverged)
        if polish.interrupted:
            self.record.cut = StopReason.INTERRUPTED

    def _options(self, place: Workplace, strategy: Strategy) -> IpoptOptions:
        return place.options(self.settings).with_strategy(strategy.options, strategy.most_iterations)

    def has_fewer_elements(self) -> bool:
        """Whether other starts are tried on fewer elements: where these are enough to tell optima of the problem."""
        return bool(elements_of_copy(self.model, EXPLORED_ELEMENTS))

    def start_at_other_optimum(self, work: float) -> bool:
        """Try other starts on a copy with fewer elements; where they lead to a better answer, put it on the model.

        The copy is solved from the answer on the model first: fewer elements may flatter the objective.

        Parameters
        ----------
        work : float
            Iterations that it may take, of the model's size.

        Returns
        -------
        bool
            Whether there is a better answer. False where less time is left than has passed.
        """
        left = self.settings.deadline.left
        # Making a copy is not cut off. There is an answer already: its solve tells what another one would take.
        if left is not None and left < time.perf_counter() - self.record.exploration.started:
            return False
        copy = coarser_copy(self.model, EXPLORED_ELEMENTS)
        if copy is None:
            return False
        share = elements_of(copy) / elements_of(self.model)
        result = self._answer(copy, OTHER_OPTIMUM, exploration=None, explored_work=work / share)
        if result is None or self.record.cut is not None:
            return False
        first = result.steps[0]
        gain = abs(first.objective - result.objective) > SAME_OBJECTIVE * max(1.0, abs(first.objective))
        # Of two solutions the copy has kept the better one.
        if result.quality is not Quality.OPTIMAL or result.best.number == 0 or not (gain or not first.converged):
            return False
        take_values_of_copy(self.model, copy)
        return True

    def with_absolute_values_split(self) -> Iterate | None:
        """Solve a copy with its absolute values in two parts; its answer is one of the model, and is checked there.

        Returns
        -------
        Iterate or None
            None where there are no absolute values, or the model is part of another one.
        """
        if self.model.model() is not self.model or not any(absolute_values_in(self.model)):
            return None
        split = TransformationFactory("pyrobocop.absolute_values_to_complementarity")
        copy = split.create_using(self.model)
        result = self._answer(copy, ABSOLUTE_VALUES)
        if result is None:
            return None
        take_values_of_copy(self.model, copy)
        best = replace(
            result.best,
            label=ABSOLUTE_VALUES.name,
            strategy=ABSOLUTE_VALUES.name,
            number=len(self.record.steps) - len(result.steps) + result.best.number,
            delta=None,
            values=self.values.read(),
            load_suffixes=lambda: _take_suffixes(self.model, copy),
        )
        if not self.record.pairs and best.certificate is Certificate.PROVEN:
            best = replace(best, certificate=Certificate.UNKNOWN)  # which is of pairs, and the model has none
        best = self.record.checked(best)
        self.settings.progress.line(best.line(pairs=bool(self.record.pairs)))
        return best

    def _answer(self, copy: Any, strategy: Strategy, **changes: Any) -> SolveResult | None:
        """Solve a copy, and log its runs as those of a strategy; None where it cannot be solved at all."""
        options = self.settings.options.with_default({"max_iter": ITERATIONS_OF_ONE})
        settings = replace(self.settings, options=options, strategies=None, progress=Progress(False), **changes)
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
