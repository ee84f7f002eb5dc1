"""One strategy, wherever it can be run: from a start that has values, by a backend that can evaluate the model."""

from __future__ import annotations

import logging
from dataclasses import replace

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus

from .iterates import Iterate
from .plain_runs import PlainRuns
from .polished_runs import PolishedRuns
from .solve_state import SolveState
from .solved_copies import SolvedCopies
from .starts import put_start
from .strategies import SOLVE, StartingPoint, Strategy

logger = logging.getLogger(__name__)


class StrategyRuns:
    """Runs strategies of one solve.

    Parameters
    ----------
    state : SolveState
    copies : SolvedCopies
    """

    def __init__(self, state: SolveState, copies: SolvedCopies) -> None:
        self._model, self._log, self._found = state.model, state.log, state.found
        self._guess, self._places, self._has_pairs = state.guess, state.places, state.has_pairs
        self._polished = PolishedRuns(state)
        self._plain = PlainRuns(state, self._polished, copies)

    def run(self, strategy: Strategy) -> Iterate | None:
        """Run a strategy on the first backend that can evaluate the model where it leads.

        Returns
        -------
        Iterate or None
            None where the strategy has nothing to work on here.
        """
        # What only explores is not worth another backend.
        explores = not self._has_pairs and self._found.is_certified(self._found.best)
        try:
            iterate = self._run_here(strategy)
            if iterate is None or iterate.converged or explores:
                return iterate
            # The executable does not say why it could not begin.
            if iterate.iterations == 0 and not iterate.stop_reason.is_final and self._guess.move():
                self._places.restart()
                return self.run(strategy)
        except EvaluationError as error:
            return None if explores else self._run_elsewhere(strategy, str(error))
        if iterate.status is not IpoptStatus.INVALID_NUMBER or not self._places.has_other_backends:
            return iterate
        self.keep(iterate)
        return self._run_elsewhere(strategy, iterate.status.value)

    def keep(self, iterate: Iterate) -> None:
        """Remember what was found, and where a function had no value on the way."""
        self._found.keep(iterate)
        if self._places.place is not None:
            self._guess.note(iterate, self._places.place.session)

    def explore(self) -> None:
        """Look for better optima beyond the best point, if that is certified and there is time for it."""
        explored = None if self._places.place is None else self._polished.explore(self._places.place)
        if explored is not None:
            self.keep(explored)

    def _run_here(self, strategy: Strategy) -> Iterate | None:
        place = self._places.move_to(strategy)
        self._log.pairs = place.relaxed.pairs
        if not place.relaxed.pairs:
            # The presolve may have settled all of them: then strategies for pairs are one solve.
            return self._plain.run(place, SOLVE if self._has_pairs else strategy, self.keep)
        if strategy.schedule is None:  # the projection
            return self._polished.project(place)
        if isinstance(strategy.schedule, BarrierSchedule) and not place.relaxed.shifted_rows:
            return None
        if strategy.from_initial_guess:
            place.values.write(place.start)
        if strategy.start is not StartingPoint.INITIAL_GUESS:
            if not put_start(self._model, strategy):
                return None
            place.relaxed.start_lifted()
        return self._polished.run(place, strategy)

    def _run_elsewhere(self, strategy: Strategy, why: str) -> Iterate | None:
        """Another backend may know the derivatives at this point; where there is none, the point itself is reported."""
        logger.info("'%s': strategy '%s', %s: %s", self._model.name, strategy.name, self._places.backend.value, why)
        if self._places.has_other_backends:
            self._places.use_other_backend()
            return self.run(strategy)
        if self._found.best is not None:
            return None
        self._guess.write()
        status = IpoptStatus.INVALID_NUMBER
        run = Iterate.of_run("no derivatives", status, delta=None, mu=None, iterations=0, seconds=0.0)
        return replace(self._log.add(run), strategy=strategy.name, values=self._guess.values)
