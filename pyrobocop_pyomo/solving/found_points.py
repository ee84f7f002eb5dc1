"""The points that the strategies of one solve ended at: which is the best, and whether it is enough."""

from __future__ import annotations

import logging

from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .iterates import Iterate, StopReason
from .settings import Settings
from .strategies import BARRIER_TO_THE_END, CONTINUATION, ELASTIC, OTHER_STARTS, Strategy

logger = logging.getLogger(__name__)

# Up to here further solves from the user's initial guess cost little.
CROSS_CHECKED_PAIRS = 100
# Objectives that differ by less, relative to their size, are those of one solution.
SAME_OBJECTIVE = 1e-4


class FoundPoints:
    """What decides how a solve goes on.

    Parameters
    ----------
    settings : Settings
    sign : float
        1 where the objective is minimised, -1 where it is maximised.

    Attributes
    ----------
    best : Iterate or None
    unbounded : Iterate or None
        A point that shows that there is no optimum: variables grow without end, and the objective falls.
    cut : StopReason or None
        What ended the solve from outside: the clock, or Ctrl-C.
    """

    def __init__(self, settings: Settings, sign: float) -> None:
        self._settings, self._sign = settings, sign
        self._all: list[Iterate] = []
        self._diverged: list[Iterate] = []
        self.best: Iterate | None = None
        self.cut: StopReason | None = None

    @property
    def first(self) -> Iterate | None:
        """Where the first run ended: from the user's initial guess, unless that has no value."""
        return self._all[0] if self._all else None

    def keep(self, iterate: Iterate) -> None:
        """Remember a point, and whether it is the best."""
        self._all.append(iterate)
        self.note_diverged(iterate)
        # By so little the products that are left flatter an objective.
        flattered = iterate.delta is not None and self.leads_no_further(iterate)
        if self.best is None or (self.is_better(iterate, self.best) and not flattered):
            logger.info("strategy '%s' has the best point so far", iterate.strategy)
            self.best = iterate

    def note_diverged(self, iterate: Iterate) -> None:
        """Remember a point of a run whose variables grow without end; another one is forgotten."""
        if iterate.diverged and iterate.values is not None:
            self._diverged.append(iterate)

    @property
    def unbounded(self) -> Iterate | None:
        """The lowest of the points whose rows and pairs hold, if it is far below the best point; None for none."""
        lowest = min(filter(self._holds, self._diverged), key=self._cost, default=None)
        if lowest is None or self.best is None:
            return lowest
        best = self._cost(self.best)
        below = self._cost(lowest) < best - max(1.0, abs(best))
        return lowest if below or self.best.diverged or not self.best.excess(self._settings.tolerances) <= 1.0 else None

    def _cost(self, iterate: Iterate) -> float:
        return self._sign * iterate.objective

    def _holds(self, diverged: Iterate) -> bool:
        """Whether rows and pairs hold as well as rounding lets them, beside values of this size."""
        size = max((abs(number) for number in diverged.values if number is not None), default=0.0)
        violation = max(diverged.constraint_violation, diverged.largest_natural_residual)
        return violation <= max(self._settings.tolerances.feasibility, NEGLIGIBLE * size)

    def is_better(self, first: Iterate, second: Iterate) -> bool:
        """Whether the first of two points is the better one."""
        one, other = (iterate.standing(self._settings.tolerances, self._sign) for iterate in (first, second))
        return one.is_better_than(other)

    def is_certified(self, iterate: Iterate | None) -> bool:
        """Whether there is such a point, and no further strategy is needed after it."""
        return iterate is not None and iterate.is_certified(self._settings.tolerances, self._settings.polish)

    def are_enough(self) -> bool:
        """Whether there is a solution, or no time to look for one; the latter is noted."""
        if self.cut is None and self._settings.deadline.has_passed and not self.is_certified(self.best):
            self.cut = StopReason.TIME_LIMIT
        return self.cut is not None or self.is_certified(self.best)

    def are_cut(self) -> bool:
        """Whether there is no time left, or somebody interrupted."""
        return self.cut is not None or self._settings.deadline.has_passed

    def leads_no_further(self, relaxed: Iterate) -> bool:
        """Whether smaller products and a polish of a relaxed point hardly lead to a better point than a certified one.

        The products that are left flatter its objective: with them it falls, and does not rise.
        """
        best = self.best
        if best is None or not self.is_certified(best):
            return False
        loss = self._sign * (relaxed.objective - best.objective)
        feasible = relaxed.converged and relaxed.constraint_violation <= self._settings.tolerances.feasibility
        return feasible and loss >= -SAME_OBJECTIVE * max(1.0, abs(best.objective))

    def need(self, strategy: Strategy, pairs: int) -> bool:
        """Whether a strategy is to be run, after what the others have found in a model with so many pairs."""
        if self.best is None:
            return True
        if self.unbounded is not None and not self.best.diverged:
            return False
        settings = self._settings
        if settings.deadline.has_passed:
            if not self.is_certified(self.best):
                self.cut = StopReason.TIME_LIMIT
            return False
        if settings.strategies is None and strategy in OTHER_STARTS:
            return not self.best.excess(settings.tolerances) <= 1.0
        small = pairs <= CROSS_CHECKED_PAIRS
        if not self.is_certified(self.best):
            return strategy is not BARRIER_TO_THE_END or self._was_cut_short()
        # A certified point is a local solution: another way down finds a better one now and then, and ends at once
        # where its relaxed points are no better.
        return settings.polish and (strategy is CONTINUATION or (small and strategy is ELASTIC))

    def _was_cut_short(self) -> bool:
        """Whether the first strategy used all of its share of iterations."""
        return self.first is not None and self.first.stop_reason is StopReason.ITERATION_LIMIT
