"""Runs of strategies: from a start that has values, by a backend that can evaluate the model, and what follows each."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import BarrierSchedule, without_penalty
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.variable_values import Values
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.programs.scaled_program import ScaledProgram
from pyrobocop_pyomo.programs.scales import Scales

from .continuation import Continuation
from .curvature import direction_of_descent
from .found_points import CROSS_CHECKED_PAIRS
from .ipopt_options import ITERATIONS_OF_ONE, NEARLY_THERE, IpoptOptions
from .iterates import Iterate, StopReason
from .polish import Polish
from .session import Session
from .settings import Settings
from .solve_result import SolveResult
from .solve_state import SolveState
from .solved_copies import SolvedCopies
from .starts import put_start
from .strategies import BEYOND_SADDLE, SIMULATED, SOLVE, StartingPoint, Strategy
from .workplaces import Workplace

logger = logging.getLogger(__name__)

# What a unit of violation costs with elastic rows, in slopes of the objective: above what multipliers may be expected
# to be.
PENALTY = 1e3
# A run that goes on from a saddle starts so far from it, in sizes of the variables.
STEP_FROM_SADDLE = 0.1


class Runner(SolveState):
    """Runs strategies of one solve.

    Parameters
    ----------
    model : Block
    settings : Settings
    solve_copy : callable
        ``solve_copy(copy, settings)`` solves another model.
    """

    def __init__(self, model: Any, settings: Settings, solve_copy: Callable[[Any, Settings], SolveResult]) -> None:
        super().__init__(model, settings)
        self._copies = SolvedCopies(self, solve_copy)

    def run(self, strategy: Strategy) -> Iterate | None:
        """Run a strategy on the first backend that can evaluate the model where it leads.

        Returns
        -------
        Iterate or None
            None where the strategy has nothing to work on here.
        """
        # What only explores is not worth another backend.
        explores = not self.has_pairs and self.found.is_certified(self.found.best)
        try:
            iterate = self._run_here(strategy)
            if iterate is None or iterate.converged or explores:
                return iterate
            # The executable does not say why it could not begin.
            if iterate.iterations == 0 and not iterate.stop_reason.is_final and self.guess.move():
                self.places.restart()
                return self.run(strategy)
        except EvaluationError as error:
            return None if explores else self._run_elsewhere(strategy, str(error))
        if iterate.status is not IpoptStatus.INVALID_NUMBER or not self.places.has_other_backends:
            return iterate
        self.keep(iterate)
        return self._run_elsewhere(strategy, iterate.status.value)

    def keep(self, iterate: Iterate) -> None:
        """Remember what was found, and where a function had no value on the way."""
        self.found.keep(iterate)
        if self.places.place is not None:
            self.guess.note(iterate, self.places.place.session)

    def explore(self) -> None:
        """Look for better optima beyond the best point, if that is certified and there is time for it."""
        best, place = self.found.best, self.places.place
        if place is None or best is None or self.found.cut is not None or best.certificate is not Certificate.PROVEN:
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
            self.found.cut = StopReason.INTERRUPTED
        except EvaluationError as error:
            logger.info("exploration ends: %s", error)

    def _run_here(self, strategy: Strategy) -> Iterate | None:
        place = self.places.move_to(strategy)
        self.log.check_pairs(place.relaxed.pairs)
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

    def _run_elsewhere(self, strategy: Strategy, why: str) -> Iterate | None:
        """Another backend may know the derivatives at this point; where there is none, the point itself is reported."""
        logger.info("'%s': strategy '%s', %s: %s", self.model.name, strategy.name, self.places.backend.value, why)
        if self.places.has_other_backends:
            self.places.use_other_backend()
            return self.run(strategy)
        if self.found.best is not None:
            return None
        self.guess.write()
        run = self.log.add(Iterate.of_run("no derivatives", IpoptStatus.INVALID_NUMBER))
        return replace(run, strategy=strategy.name, values=self.guess.values)

    def _run_without_pairs(self, place: Workplace, strategy: Strategy) -> Iterate | None:
        """Run a strategy, and go on from where it ends at a saddle; None where it has no start, or no program."""
        if strategy.start is StartingPoint.ABSOLUTE_VALUES:
            place.values.write(place.start)
            return self._copies.with_absolute_values_split()
        iterate = self._run_from_start(place, strategy)
        return None if iterate is None else self._beyond_saddles(place, iterate)

    def _beyond_saddles(self, place: Workplace, iterate: Iterate) -> Iterate:
        """The point on the model, or a better one that runs lead to from it where it is stationary and no minimum."""
        known = self.found.best
        if known is not None and not self.found.is_better(iterate, known):
            return iterate  # whatever it is
        starts = self._starts_beyond(place, iterate)
        if not starts:
            return iterate
        saddle = replace(iterate, certificate=Certificate.DESCENT)
        if known is not None and not self.found.is_better(saddle, known):
            return saddle
        if not self.found.is_certified(known):
            self.keep(saddle)
        for start in starts:
            place.values.write(start)
            try:
                lower = self._run_polished(place, BEYOND_SADDLE, BEYOND_SADDLE.name)
            except EvaluationError:
                continue
            lower = self._beyond_saddles(place, lower)
            if lower.stop_reason.is_final or self.found.is_better(lower, saddle):
                return lower
        return saddle

    def _starts_beyond(self, place: Workplace, iterate: Iterate) -> list[Values]:
        """Starts on both sides of the point on the model, if it is stationary and no minimum; otherwise none."""
        compiled = place.session.compiled() if self.found.is_certified(iterate) else None
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
        if strategy.name != SOLVE.name and strategy.start is not StartingPoint.REACHED:
            place.values.write(place.start)
            if not self._put_start(place, strategy):
                return None
        if strategy.elastic_rows:
            return self._run_elastic(place, strategy)
        if strategy.name == SOLVE.name and self.settings.strategies is None and self.settings.second_tries:
            simulated = self._run_simulated_first(place)
            if simulated is not None and (self.found.is_certified(simulated) or simulated.stop_reason.is_final):
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
        strategy = replace(SIMULATED, options={"max_iter": ITERATIONS_OF_ONE, **SIMULATED.options})
        return self._run_polished(place, strategy, SIMULATED.name)

    def _put_start(self, place: Workplace, strategy: Strategy) -> bool:
        if strategy.start is StartingPoint.COARSE_MESH:
            return self._copies.start_on_fewer_elements()
        if strategy.start not in (StartingPoint.BEST, StartingPoint.MIRRORED, StartingPoint.OTHER_OPTIMUM):
            return put_start(self.model, strategy)
        best = self.found.best
        if best is None or best.values is None:
            return False
        place.values.write(best.values)
        if strategy.start is StartingPoint.OTHER_OPTIMUM:
            return self._copies.start_at_other_optimum(self.exploration.work_within(0, self.log.iterations))
        return strategy.start is StartingPoint.BEST or put_start(self.model, strategy)

    def _run_elastic(self, place: Workplace, strategy: Strategy) -> Iterate | None:
        """Let rows be violated at a price; from where that ends, go on with the rows as they are."""
        session = place.session.with_elastic_rows(PENALTY)
        if session is None:
            return None
        elastic = self._continuation(place, strategy, session).run(None, label=strategy.name)
        if not elastic.excess(self.settings.tolerances) <= 1.0 and elastic.converged:
            elastic = replace(elastic, stop_reason=StopReason.INFEASIBLE)
        iterate = replace(elastic, strategy=strategy.name)
        if self.found.is_certified(iterate) or iterate.stop_reason.is_final:
            return iterate
        self.keep(iterate)
        on = replace(strategy, options={**NEARLY_THERE, **strategy.options})
        return self._run_polished(place, on, "solve from there")

    def _run_polished(self, place: Workplace, strategy: Strategy, label: str = "solve") -> Iterate:
        """Run the strategy's schedule and polish the best point of it."""
        found, continuation = self.found, self._continuation(place, strategy)
        relaxed = continuation.run(strategy.schedule, label=label, leads_no_further=found.leads_no_further)
        if found.leads_no_further(continuation.last):
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
            self.found.cut = continuation.last.stop_reason
            return iterate
        polish, compiled = self._polish(place)
        if polish is None or compiled is None:
            return iterate
        try:
            return polish.improve(iterate, place.session.primal_dual(relaxed, compiled))
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
        return Polish(settings, place.relaxed, compiled, self.log, self.values, self.exploration), compiled

    def _note_end(self, polish: Polish) -> None:
        for diverged in polish.diverged:
            self.found.note_diverged(diverged)
        if polish.interrupted:
            self.found.cut = StopReason.INTERRUPTED

    def _options(self, place: Workplace, strategy: Strategy) -> IpoptOptions:
        options: Mapping[str, Any] = strategy.options
        small = len(place.relaxed.pairs) <= CROSS_CHECKED_PAIRS
        share = strategy.small_problem_iterations if small else strategy.large_problem_iterations
        if self.settings.strategies is None and share is not None:
            # A problem that takes longer rarely gets anywhere; the next strategy does.
            options = {"max_iter": share, **options}
        return place.options(self.settings).with_strategy(options, strategy.most_iterations)
