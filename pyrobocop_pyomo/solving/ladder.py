"""The ladder: strategy after strategy until a point is certain, and the best point of all strategies wins."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity import BarrierSchedule, Geometric, Schedule
from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library

from .assessment import PointJudge
from .attempt import FINAL_REASONS, Attempt, AttemptedPoint, StepRecorder
from .finding import Finding
from .finish import Finish
from .relaxed_model import RelaxedModel, forget_removed, relaxed_model
from .session import Session
from .settings import Settings
from .strategies import CONTINUATION, LADDER, PROJECTION, TIGHT, Strategy
from .variable_values import VariableValues

logger = logging.getLogger(__name__)

# Up to here a second solve from the user's guess costs little, and finds the better optimum now and then. Where it
# does, it is quick; where it is not, it rarely does.
CROSS_CHECKED_PAIRS = 100
# A small problem that takes longer does not get anywhere; the next strategy does.
SMALL_PROBLEM_ITERATIONS = {"barrier": 300, "tight": 100, "continuation": 200, "elastic": 100}
# Where the polish fails. Ipopt's tolerance is absolute, and would hide products of this size.
TIGHTENED = Geometric(first=1e-10, factor=1e-2, last=1e-12)
TIGHTENED_OPTIONS = {"tol": 1e-10, "s_max": 1e8}


@dataclass(eq=False)
class _Workplace:
    """A relaxed model with an open session."""

    relaxation: Any
    relaxed: RelaxedModel
    session: Session
    values: VariableValues
    start: list[float | None]


class Ladder:
    """Climbs the strategies on one model.

    Parameters
    ----------
    model : Block
    judge : PointJudge
    settings : Settings
    recorder : StepRecorder
    open_session : callable
        From a `RelaxedModel` and Ipopt's options to a `Session`.
    left : callable
        Seconds that are left, or None.

    Attributes
    ----------
    best : Finding or None
    decided : int
        Pairs that the presolve decided.
    solver, derivatives : str
        Of the session used last.
    """

    def __init__(
        self,
        model: Any,
        judge: PointJudge,
        settings: Settings,
        recorder: StepRecorder,
        open_session: Callable[[RelaxedModel, Mapping[str, Any]], Session],
        left: Callable[[], float | None],
    ) -> None:
        self._model, self._judge, self._settings, self._recorder = model, judge, settings, recorder
        self._open_session, self._left = open_session, left
        self._values = VariableValues(model)
        self._guess = self._values.read()
        self._place: _Workplace | None = None
        self._relaxed_point: AttemptedPoint
        self._by_default = True
        self._explored: set[bytes] = set()
        self._found: list[Finding] = []
        self.best: Finding | None = None
        self.decided = 0
        self.solver = self.derivatives = ""

    def climb(self, strategies: Sequence[Strategy] | None) -> Finding:
        """Go through the strategies until one gives a point that is certain, and put the best point on the model.

        Parameters
        ----------
        strategies : sequence of Strategy, optional
            By default the whole ladder.
        """
        self._by_default = strategies is None
        with contextlib.ExitStack() as stack:
            for strategy in LADDER if strategies is None else strategies:
                if self.best is not None and not self._needs(strategy):
                    continue
                self._move_to(strategy, stack)
                assert self._place is not None
                if not self._place.relaxed.pairs:
                    self._climb_to(Strategy("solve", None))
                    break
                self._climb_to(strategy)
        if self.best is None:
            raise ComplementarityError(
                f"'{self._model.name}': delta cannot follow the barrier parameter with the relaxation "
                f"{self._settings.relaxation!r}, which bounds no row by it, and the projection starts from a point "
                "that another strategy left. Use schedule=Geometric(...) or Fixed(...), or other strategies."
            )
        self._values.write(self.best.values)
        self.best.load_suffixes()
        forget_removed(self._model)
        return self.best

    def _move_to(self, strategy: Strategy, stack: contextlib.ExitStack) -> None:
        """Keep the workplace, or change it for one with the relaxation that the strategy asks for."""
        relaxation = self._settings.relaxation if strategy.relaxation is None else strategy.relaxation
        if self._place is not None and (strategy is PROJECTION or self._place.relaxation == relaxation):
            return
        stack.close()
        self._values.write(self._guess)
        self._place = stack.enter_context(self._workplace(relaxation, strategy))

    @contextlib.contextmanager
    def _workplace(self, relaxation: Any, strategy: Strategy) -> Iterator[_Workplace]:
        delta = 1e-2 if strategy.schedule is None else next(iter(strategy.schedule.steps()))
        with relaxed_model(self._model, relaxation, self._settings.grouping, delta) as relaxed:
            self.decided = len(relaxed.decisions)
            session = self._open_session(relaxed, {**strategy.options, **self._settings.options})
            self.solver, self.derivatives = session.solver, session.derivatives
            values = VariableValues(self._model)
            try:
                yield _Workplace(relaxation, relaxed, session, values, values.read())
            finally:
                session.close()

    def _climb_to(self, strategy: Strategy) -> None:
        place = self._place
        assert place is not None
        self._recorder.pairs = place.relaxed.pairs
        finding: Finding | None
        if strategy is PROJECTION:
            finding = self._projected(place)
        else:
            finding = self._attempted(strategy, place)
        if finding is None:
            return
        self._found.append(finding)
        if self.best is None or finding.is_better_than(self.best, self._settings.tolerances, self._judge.sign):
            logger.info("'%s': strategy '%s' has the best point so far", self._model.name, finding.strategy)
            self.best = finding

    def _attempted(self, strategy: Strategy, place: _Workplace) -> Finding | None:
        if isinstance(strategy.schedule, BarrierSchedule) and not place.relaxed.shifted_rows:
            return None
        if strategy.from_guess:
            place.values.write(place.start)
        finding = self._polished(place, strategy.name, strategy.schedule, self._options_of(strategy))
        if self._settings.polish and place.relaxed.shifted_rows and self._is_loose(finding):
            # Where no branch could be solved, a smaller delta makes the pairs nearly as exact as a branch would.
            tightened = self._polished(place, strategy.name, TIGHTENED, TIGHTENED_OPTIONS, warm=True)
            if tightened.is_better_than(finding, self._settings.tolerances, self._judge.sign):
                return tightened
        return finding

    def _is_loose(self, finding: Finding) -> bool:
        tolerances = self._settings.tolerances
        return (
            finding.reason not in FINAL_REASONS
            and finding.step.excess(tolerances) <= 1.0
            and finding.step.largest_natural_residual > tolerances.natural
        )

    def _polished(
        self, place: _Workplace, name: str, schedule: Schedule | None, options: Mapping[str, Any], *, warm: bool = False
    ) -> Finding:
        """Run a schedule and finish the best point of it; warm, it goes on from where the last one ended."""
        if warm:
            place.values.write(self._relaxed_point.values)
            self._relaxed_point.rewind()
        attempt = Attempt(
            place.session,
            self._recorder,
            place.values,
            self._settings.tolerances,
            self._left,
            inexact=bool(place.relaxed.shifted_rows),
        )
        best = self._relaxed_point = attempt.go(schedule, options, warm=warm)
        place.values.write(best.values)
        finding = Finding(
            name, self._values.read(), best.step, attempt.stop_reason, best.stationarity, best.load_suffixes
        )
        finish = self._finish(place)
        if finish is None or attempt.stop_reason in FINAL_REASONS:
            return finding
        return finish.improve(finding, best.multipliers(finish.written))

    def _projected(self, place: _Workplace) -> Finding | None:
        finish = self._finish(place)
        if self.best is None or finish is None:
            return None
        self._values.write(self.best.values)
        place.relaxed.start_lifted()
        return finish.project(self.best)

    def _finish(self, place: _Workplace) -> Finish | None:
        """What polishes and certifies; None where it is not wanted or cannot be done here."""
        if not self._settings.polish or not place.relaxed.lifted or find_ipopt_library() is None:
            return None
        if place.relaxed.has_penalty:
            with place.relaxed.without_penalty():
                written = place.session.written(anew=True)
        else:
            written = place.session.written()
        if written is None:
            return None
        return Finish(self._settings, place.relaxed, written, self._recorder, self._values, self._left, self._explored)

    def _options_of(self, strategy: Strategy) -> Mapping[str, Any]:
        assert self._place is not None
        limit = SMALL_PROBLEM_ITERATIONS.get(strategy.name)
        if limit is None or not self._by_default or len(self._place.relaxed.pairs) > CROSS_CHECKED_PAIRS:
            return {}
        return {"max_iter": min(limit, self._settings.options["max_iter"])}

    def _needs(self, strategy: Strategy) -> bool:
        """Whether a strategy is to be climbed to, after what the others have found."""
        assert self.best is not None
        left = self._left()
        if self.best.reason in FINAL_REASONS or (left is not None and left <= 0.0):
            return False
        if not self.best.is_certain(self._settings.tolerances, self._settings.polish):
            return True
        assert self._place is not None
        small = len(self._place.relaxed.pairs) <= CROSS_CHECKED_PAIRS
        if strategy is TIGHT:
            return small or not self._by_default
        # A certain point is a local solution. In large problems, which tend to have many, and where two solves have
        # disagreed, the slow way down from delta = 1 is worth its time: it finds the better one more often than not.
        return strategy is CONTINUATION and (not small or self._disagree()) and self._settings.polish

    def _disagree(self) -> bool:
        """Whether the strategies so far have found different solutions."""
        if any(each.outdone for each in self._found):
            return True
        tolerances = self._settings.tolerances
        found = [each.step.objective for each in self._found if each.step.excess(tolerances) <= 1.0]
        return len(found) > 1 and max(found) - min(found) > 1e-4 * max(1.0, *map(abs, found))
