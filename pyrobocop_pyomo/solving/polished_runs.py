"""A strategy's schedule in a workplace, and the polish of where it ended."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.complementarity import Geometric
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library
from pyrobocop_pyomo.mpcc.active_set import Certificate

from .continuation import POLISHED_EARLY, Continuation
from .found_points import CROSS_CHECKED_PAIRS
from .ipopt_options import TIGHTENED, IpoptOptions
from .iterates import Iterate, StopReason
from .polish import Polish
from .session import Session
from .solve_state import SolveState
from .strategies import Strategy
from .workplaces import Workplace

logger = logging.getLogger(__name__)

# Where the polish fails: a smaller delta makes the pairs nearly as exact as a branch would.
TIGHTENED_SCHEDULE = Geometric(first=1e-10, factor=1e-2, last=1e-12)


class PolishedRuns:
    """Runs in one workplace or another, for one solve.

    Parameters
    ----------
    state : SolveState
    """

    def __init__(self, state: SolveState) -> None:
        self._settings, self._log, self._values, self._found = state.settings, state.log, state.values, state.found
        self._sign, self._exploration = state.check.sign, state.exploration

    def run(self, place: Workplace, strategy: Strategy, label: str = "solve") -> Iterate:
        """Run the strategy's schedule and polish the best point of it."""
        found, continuation = self._found, self.continuation(place, strategy)
        early: list[Iterate] = []

        def is_enough(relaxed: Iterate) -> bool:
            early.append(self._improved(place, strategy, relaxed, continuation))
            return found.is_certified(early[-1])

        relaxed = continuation.run(
            strategy.schedule, label=label, leads_no_further=found.leads_no_further, is_enough=is_enough
        )
        if early and found.is_certified(early[-1]):
            return early[-1]
        if found.leads_no_further(continuation.last):
            place.values.write(relaxed.values)
            return replace(relaxed, strategy=strategy.name, values=self._values.read())
        iterate = self._improved(place, strategy, relaxed, continuation)
        if not (self._settings.polish and place.relaxed.shifted_rows and found.is_loose(iterate)):
            return iterate
        continuation = self.continuation(place, strategy)
        tightened = continuation.run(TIGHTENED_SCHEDULE, start=relaxed, purpose=TIGHTENED)
        tightened = self._improved(place, strategy, tightened, continuation)
        return tightened if found.is_better(tightened, iterate) else iterate

    def continuation(self, place: Workplace, strategy: Strategy, session: Session | None = None) -> Continuation:
        """A strategy's runs from the point on the model, by the session of the workplace or by another one."""
        return Continuation(
            session or place.session,
            self._log,
            place.values,
            self._settings,
            self._sign,
            self._options(place, strategy),
            exact=not place.relaxed.shifted_rows,
        )

    def project(self, place: Workplace) -> Iterate | None:
        """Look for a feasible branch near the best point; None where nothing can be polished."""
        best, (polish, _) = self._found.best, self._polish(place)
        if best is None or best.diverged or polish is None:
            return None
        self._values.write(best.values)
        place.relaxed.start_lifted()
        try:
            return polish.project(best)
        finally:
            self._note_end(polish)

    def explore(self, place: Workplace) -> Iterate | None:
        """A better optimum beyond the best point; None where that is not certified, or nothing better was found."""
        best = self._found.best
        if best is None or self._found.cut is not None or best.certificate is not Certificate.PROVEN:
            return None
        try:
            polish, _ = self._polish(place)
            if polish is None:
                return None
            self._values.write(best.values)
            place.relaxed.start_lifted()
            explored = polish.explore(best)
            self._note_end(polish)
            return None if explored is best else explored
        except KeyboardInterrupt:
            self._found.cut = StopReason.INTERRUPTED
        except EvaluationError as error:
            logger.info("exploration ends: %s", error)
        return None

    def _improved(self, place: Workplace, strategy: Strategy, relaxed: Iterate, continuation: Continuation) -> Iterate:
        """What a polish makes of the best relaxed point, in terms of the user's variables."""
        place.values.write(relaxed.values)
        iterate = replace(relaxed, strategy=strategy.name, values=self._values.read())
        if relaxed.diverged:
            return iterate
        if continuation.last.stop_reason.is_final:
            self._found.cut = continuation.last.stop_reason
            return iterate
        if not relaxed.converged and relaxed.largest_product > POLISHED_EARLY:
            return iterate  # its nearest branch is hardly that of a solution
        polish, compiled = self._polish(place)
        if polish is None or compiled is None:
            return iterate
        try:
            return polish.improve(iterate, place.session.primal_dual(relaxed, compiled))
        finally:
            self._note_end(polish)

    def _polish(self, place: Workplace) -> tuple[Polish | None, Any]:
        """What polishes and certifies, with its compiled model; None where it is not wanted or cannot be done here."""
        if not self._settings.polish or not place.relaxed.lifted or find_ipopt_library() is None:
            return None, None
        if place.relaxed.has_penalty:
            with place.relaxed.without_penalty():
                compiled = place.session.compiled(anew=True)
        else:
            compiled = place.session.compiled()
        if compiled is None:
            return None, None
        settings = replace(self._settings, options=place.options(self._settings))
        return Polish(settings, place.relaxed, compiled, self._log, self._values, self._exploration), compiled

    def _note_end(self, polish: Polish) -> None:
        for diverged in polish.diverged:
            self._found.note_diverged(diverged)
        if polish.interrupted:
            self._found.cut = StopReason.INTERRUPTED

    def _options(self, place: Workplace, strategy: Strategy) -> IpoptOptions:
        options: Mapping[str, Any] = strategy.options
        small = len(place.relaxed.pairs) <= CROSS_CHECKED_PAIRS
        share = strategy.small_problem_iterations if small else strategy.large_problem_iterations
        if self._settings.strategies is None and share is not None:
            # A problem that takes longer rarely gets anywhere; the next strategy does.
            options = {"max_iter": share, **options}
        return place.options(self._settings).with_strategy(options, strategy.most_iterations)
