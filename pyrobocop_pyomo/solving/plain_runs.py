"""Strategies for models without pairs: another start, elastic rows, fewer elements first; and on from saddles."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.variable_values import Values
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.programs.scaled_program import ScaledProgram

from .curvature import direction_of_descent
from .ipopt_options import NEARLY_THERE, TIGHTER_TOLERANCES
from .iterates import Iterate, StopReason
from .polished_runs import PolishedRuns
from .second_tries import ITERATIONS_OF_ONE
from .solve_state import SolveState
from .solved_copies import SolvedCopies
from .starts import put_motion, put_start
from .strategies import BEYOND_SADDLE, SIMULATED, SOLVE, StartingPoint, Strategy
from .workplaces import Workplace

logger = logging.getLogger(__name__)

# What a unit of violation costs with elastic rows, in slopes of the objective: above what multipliers may be expected
# to be.
PENALTY = 1e3
# Starts from where little is left to do.
NEAR_A_SOLUTION = (
    StartingPoint.COARSE_MESH,
    StartingPoint.OTHER_OPTIMUM,
    StartingPoint.BEST,
    StartingPoint.REACHED,
)
# A run that goes on from a saddle starts so far from it, in sizes of the variables; so many saddles are left.
STEP_FROM_SADDLE, MOST_SADDLES = 0.1, 5


class PlainRuns:
    """Runs for one solve.

    Parameters
    ----------
    state : SolveState
    runs : PolishedRuns
    copies : SolvedCopies
    """

    def __init__(self, state: SolveState, runs: PolishedRuns, copies: SolvedCopies) -> None:
        self._model, self._settings, self._log, self._found = state.model, state.settings, state.log, state.found
        self._runs, self._copies, self._exploration = runs, copies, state.exploration

    def run(self, place: Workplace, strategy: Strategy, keep: Callable[[Iterate], None]) -> Iterate | None:
        """Run a strategy, and go on from where it ends at a saddle; None where it has no start, or no program.

        Parameters
        ----------
        place : Workplace
        strategy : Strategy
        keep : callable
            Is given a point on the way that another run starts from.
        """
        if strategy.start is StartingPoint.ABSOLUTE_VALUES:
            place.values.write(place.start)
            return self._copies.with_absolute_values_split()
        iterate = self._run(place, strategy, keep)
        return None if iterate is None else self._beyond_saddles(place, iterate, keep, MOST_SADDLES)

    def _beyond_saddles(
        self, place: Workplace, iterate: Iterate, keep: Callable[[Iterate], None], left: int
    ) -> Iterate:
        """The point on the model, or a better one that runs lead to from it where it is stationary and no minimum."""
        known = self._found.best
        if known is not None and not self._found.is_better(iterate, known):
            return iterate  # whatever it is
        starts = self._starts_beyond(place, iterate)
        if not starts:
            return iterate
        saddle = replace(iterate, certificate=Certificate.DESCENT)
        if left == 0 or (known is not None and not self._found.is_better(saddle, known)):
            return saddle
        if not self._found.is_certified(known):
            keep(saddle)
        for start in starts:
            place.values.write(start)
            try:
                lower = self._runs.run(place, BEYOND_SADDLE, BEYOND_SADDLE.name)
            except EvaluationError:
                continue
            lower = self._beyond_saddles(place, lower, keep, left - 1)
            if lower.stop_reason.is_final or self._found.is_better(lower, saddle):
                return lower
        return saddle

    def _starts_beyond(self, place: Workplace, iterate: Iterate) -> list[Values]:
        """Starts on both sides of the point on the model, if it is stationary and no minimum; otherwise none."""
        compiled = place.session.compiled() if self._found.is_certified(iterate) else None
        if compiled is None:
            return []
        nlp, point, scaling = compiled.nlp, place.session.primal_dual(iterate, compiled), place.session.scaling
        try:
            if scaling is None:
                direction = direction_of_descent(nlp, point)
            else:
                direction = direction_of_descent(ScaledProgram(nlp, scaling.scales), scaling.scales.scaled(point))
        except EvaluationError:
            return []
        if direction is None:
            return []
        step = STEP_FROM_SADDLE * direction * (1.0 if scaling is None else scaling.scales.x)
        starts = []
        for x in (point.x + step, point.x - step):
            compiled.load_point(np.clip(x, nlp.x_lower, nlp.x_upper))
            starts.append(place.values.read())
        return starts

    def _run(self, place: Workplace, strategy: Strategy, keep: Callable[[Iterate], None]) -> Iterate | None:
        if strategy.name != SOLVE.name and strategy.start is not StartingPoint.REACHED:
            place.values.write(place.start)
            if not self._put_start(place, strategy):
                return None
        if strategy.start in NEAR_A_SOLUTION:
            tolerances = TIGHTER_TOLERANCES if strategy.start is StartingPoint.BEST else {}
            strategy = replace(strategy, options={**NEARLY_THERE, **tolerances, **strategy.options})
        if strategy.elastic_rows:
            return self._run_elastic(place, strategy, keep)
        if strategy.name == SOLVE.name and self._settings.strategies is None and self._settings.second_tries:
            simulated = self._run_simulated_first(place)
            if simulated is not None and (self._found.is_certified(simulated) or simulated.stop_reason.is_final):
                return simulated
            if simulated is not None:
                keep(simulated)
                place.values.write(place.start)
        return self._runs.run(place, strategy, strategy.name)

    def _run_simulated_first(self, place: Workplace) -> Iterate | None:
        """Where equations depend on each other at the initial guess, start from the motion under its controls."""
        dependent = place.session.missing_rank()
        if not dependent or not put_motion(self._model):
            return None
        logger.info("'%s': %d equations are dependent at the initial guess", self._model.name, dependent)
        strategy = replace(SIMULATED, options={"max_iter": ITERATIONS_OF_ONE, **SIMULATED.options})
        return self._runs.run(place, strategy, SIMULATED.name)

    def _put_start(self, place: Workplace, strategy: Strategy) -> bool:
        if strategy.start is StartingPoint.COARSE_MESH:
            return self._copies.start_on_fewer_elements()
        if strategy.start not in (StartingPoint.BEST, StartingPoint.MIRRORED, StartingPoint.OTHER_OPTIMUM):
            return put_start(self._model, strategy)
        best = self._found.best
        if best is None or best.values is None:
            return False
        place.values.write(best.values)
        if strategy.start is StartingPoint.OTHER_OPTIMUM:
            return self._copies.start_at_other_optimum(self._exploration.work_within(0, self._log.iterations))
        return strategy.start is StartingPoint.BEST or put_start(self._model, strategy)

    def _run_elastic(self, place: Workplace, strategy: Strategy, keep: Callable[[Iterate], None]) -> Iterate | None:
        """Let rows be violated at a price; from where that ends, go on with the rows as they are."""
        session = place.session.with_elastic_rows(PENALTY)
        if session is None:
            return None
        elastic = self._runs.continuation(place, strategy, session).run(None, label=strategy.name)
        if not elastic.excess(self._settings.tolerances) <= 1.0 and elastic.converged:
            elastic = replace(elastic, stop_reason=StopReason.INFEASIBLE)
        iterate = replace(elastic, strategy=strategy.name)
        if self._found.is_certified(iterate) or iterate.stop_reason.is_final:
            return iterate
        keep(iterate)
        on = replace(strategy, options={**NEARLY_THERE, **strategy.options})
        return self._runs.run(place, on, "solve from there")
