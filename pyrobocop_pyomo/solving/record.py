"""`Record`: all iterates of one solve, the best of them, and the effort."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.complementarity import CanonicalPair, PairResidual
from pyrobocop_pyomo.complementarity.pairs import part_of_side
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate, ExploredBranches
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.programs.row_values import RowValues

from .iterates import Iterate, Quality, StopReason
from .model_check import ModelCheck, SideSizes
from .strategies import CROSS_CHECKED_PAIRS, End, Settings, StartingPoint, Strategy
from .violations import Violation, violations_of_pairs

logger = logging.getLogger(__name__)

# Objectives that differ by less, relative to their size, belong to one solution.
SAME_OBJECTIVE = 1e-4
# By default exploration may take as long as the rest of the solve with up to `CROSS_CHECKED_PAIRS` pairs. The
# more pairs, the less a look beyond the nearest solution pays: at twice as many there is none, unless it is requested.
# It may take this long in any case: where a solve ends after tenths of a second, its answer is not to depend
# on which of them the machine was busy in.
EXPLORED_SECONDS = 0.3
# By default it may take as many iterations of Ipopt as the rest of the solve took, linear programs counted as parts of
# one, but so many in any case: unlike seconds, these are the same on every machine.
EXPLORED_WORK = 300
# Without pairs: so many iterations and a share of those so far, on the user's mesh. From so many variables on, where
# iterations take most of the time, fewer, but not less than a part.
PLAIN_WORK, PLAIN_WORK_SHARE = 80, 0.4
SMALL_PROGRAM, LEAST_PART = 500, 0.25


def plain_work(variables: int, iterations: int) -> float:
    """Iterations that other starts of a model without pairs may take by default.

    Parameters
    ----------
    variables : int
    iterations : int
        Of Ipopt, so far.
    """
    part = max(LEAST_PART, min(1.0, SMALL_PROGRAM / max(1, variables)))
    return part * (PLAIN_WORK + PLAIN_WORK_SHARE * iterations)


class Record:
    """The runs of one solve, the best of the points that they ended at, and what ends the solve.

    Parameters
    ----------
    model : Block
        As the user stated it.
    settings : Settings
    variables : int
        That are free.

    Attributes
    ----------
    check : ModelCheck
    pairs : sequence of CanonicalPair
        To be checked.
    steps : list of Iterate
        Every run, without values and multipliers.
    seconds : float
        Elapsed in checking.
    started : float
        By the clock.
    explored_seconds : float
        Elapsed in exploring.
    explored_work : float
        Iterations of Ipopt and linear programs of exploring.
    explored_branches : ExploredBranches
        What need not be tried again.
    first : Iterate or None
        Where the first strategy ended, from the user's initial guess, unless that has no value.
    best : Iterate or None
    cut : StopReason or None
        What ended the solve from outside: the clock, or Ctrl-C.
    """

    def __init__(self, model: Any, settings: Settings, variables: int) -> None:
        self._settings, self._variables = settings, variables
        self.started = time.perf_counter()
        self.explored_seconds = self.explored_work = 0.0
        self._explored_iterations, self.explored_branches = 0, ExploredBranches()
        self.check = ModelCheck(model)
        self.pairs: Sequence[CanonicalPair] = ()
        self._sizes = SideSizes((), np.empty((0, 2)))
        self._side_values: RowValues | None = None
        self.steps: list[Iterate] = []
        self.seconds = 0.0
        self._diverged: list[Iterate] = []
        self.first: Iterate | None = None
        self.best: Iterate | None = None
        self.cut: StopReason | None = None

    @property
    def iterations(self) -> int:
        """Iterations of Ipopt, in all runs so far."""
        return sum(step.iterations for step in self.steps)

    # ---------------------------------------------------------------- runs

    def check_pairs(self, pairs: Sequence[CanonicalPair]) -> None:
        """Take the pairs that are to be checked from now on; their start is on the model."""
        known = len(self.pairs) == len(pairs)  # again, by another relaxation
        if pairs is not self.pairs:
            self.pairs, self._side_values = pairs, None
        if not known:
            self._sizes = SideSizes(pairs, self._sides())

    def add(self, iterate: Iterate, *, exact: bool = False) -> Iterate:
        """Check the point on the model, and log the run that ended there.

        Parameters
        ----------
        iterate : Iterate
            Not checked yet.
        exact : bool
            Whether one side of each pair was held at zero, whatever rounding leaves of it.
        """
        iterate = replace(self.checked(iterate, exact=exact), number=len(self.steps))
        self.steps.append(iterate.record())
        line = iterate.line(pairs=bool(self.pairs))
        self._settings.progress.line(line)
        logger.info("%s", line)
        return iterate

    def checked(self, iterate: Iterate, *, exact: bool = False) -> Iterate:
        """The iterate with the residuals of the point on the model; see `add`."""
        started = time.perf_counter()
        sides = self._sides()
        violation, relative = self.check.violations(self._settings.tolerances.feasibility)
        if np.isnan(sides).any():  # an expression without a value is infinitely far from what is required of it
            sides = np.full_like(sides, -np.inf)
        least_side = float(-sides.min(initial=0.0))
        checked = replace(
            iterate,
            objective=self.check.objective(),
            constraint_violation=max(violation, least_side),
            relative_violation=max(relative, least_side),
            largest_product=_largest_product(sides),
            largest_natural_residual=_largest_natural_residual(sides),
        )
        if not exact:
            relative_sides = sides / self._sizes.at(sides)
            checked = replace(
                checked,
                relative_product=_largest_product(relative_sides),
                relative_natural_residual=_largest_natural_residual(relative_sides),
            )
        self.seconds += time.perf_counter() - started
        return checked

    def _sides(self) -> NDArray[np.float64]:
        """Values of both sides of each pair, shape (pairs, 2)."""
        pairs = self.pairs
        if self._side_values is None:
            self._side_values = RowValues([side for pair in pairs for side in (pair.a, pair.b)])
        parts = [part for pair in pairs for part in (pair.a_part, pair.b_part)]
        return np.array(list(map(part_of_side, self._side_values.values(), parts)), dtype=float).reshape(-1, 2)

    def unmet(self) -> list[Violation]:
        """Rows, bounds and pairs that are not met at the model's current values, sides relative to their sizes."""
        sizes, tolerances = self._sizes.at(self._sides()), self._settings.tolerances
        of_pairs = violations_of_pairs(self.residuals(), tolerances, sizes.prod(axis=1).tolist())
        return [*self.check.violated(tolerances), *of_pairs]

    def pairs_with_small_sides(self) -> list[CanonicalPair]:
        """Pairs that are met only if what their sides have left is zero and not small."""
        found = self._sizes.are_too_small(self._sides(), self._settings.tolerances.natural)
        return [self.pairs[place] for place in np.flatnonzero(found).tolist()]

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return [PairResidual(pair.name, *sides) for pair, sides in zip(self.pairs, self._sides().tolist(), strict=True)]

    @contextlib.contextmanager
    def counted_as_exploring(self) -> Iterator[None]:
        """Count the runs that are done meanwhile as exploring."""
        started, before = time.perf_counter(), self.iterations
        try:
            yield
        finally:
            self.explored_seconds += time.perf_counter() - started
            self.explored_work += self.iterations - before
            self._explored_iterations += self.iterations - before

    def left_to_explore(self) -> tuple[float, float]:
        """Seconds, and iterations of Ipopt, that exploring beyond the best point may take from now on.

        Zeros where one of them is used up, or there is no certified point, with pairs a proven one.
        """
        best, factor, iterations = self.best, self._settings.exploration, self.iterations - self._explored_iterations
        if best is None or self.has_to_stop() or not self.is_certified(best):
            return 0.0, 0.0
        if self.pairs and best.certificate is not Certificate.PROVEN:
            return 0.0, 0.0
        seconds, work = time.perf_counter() - self.started - self.explored_seconds, np.inf
        if factor is not None:
            seconds *= factor
        elif self.pairs:
            share = min(1.0, max(0.0, 2.0 - len(self.pairs) / CROSS_CHECKED_PAIRS))
            seconds, work = share * max(EXPLORED_SECONDS, seconds), share * max(EXPLORED_WORK, iterations)
        else:
            seconds, work = np.inf, plain_work(self._variables, iterations)
        left = seconds - self.explored_seconds, work - self.explored_work
        return left if left[0] > 0.0 and left[1] >= 1.0 else (0.0, 0.0)

    # ---------------------------------------------------------------- the best of the points

    def keep(self, iterate: Iterate) -> None:
        """Remember a point where a strategy ended, and whether it is the best."""
        self.first = self.first or iterate
        self.remember_diverged(iterate)
        # By so little the products that are left flatter an objective.
        flattered = iterate.delta is not None and self.has_no_better_limit(iterate)
        is_lost = flattered or (self.is_certified(self.best) and not self.is_certified(iterate))
        if self.is_better(iterate, self.best) and not is_lost:
            logger.info("strategy '%s' has the best point so far", iterate.strategy)
            self.best = iterate

    def remember_diverged(self, iterate: Iterate) -> None:
        """Remember a point of a run whose variables grow without end; another one is forgotten."""
        if iterate.diverged and iterate.values is not None and self._holds(iterate):
            self._diverged.append(iterate)

    @property
    def unbounded(self) -> Iterate | None:
        """A point that shows that there is no optimum; None for none.

        Of the points whose rows and pairs hold while variables grow without end, the lowest one, if it is far below the
        best point.
        """
        lowest = min(self._diverged, key=lambda diverged: self.check.sign * diverged.objective, default=None)
        if lowest is None or self.best is None:
            return lowest
        best = self.best.objective
        is_below = self.check.sign * (lowest.objective - best) < -max(1.0, abs(best))
        is_met = self.best.excess(self._settings.tolerances) <= 1.0
        return lowest if is_below or self.best.diverged or not is_met else None

    def _holds(self, diverged: Iterate) -> bool:
        """Whether rows and pairs hold as well as rounding lets them, beside values of this size."""
        size = max((abs(number) for number in diverged.values if number is not None), default=0.0)
        violation = max(diverged.constraint_violation, diverged.largest_natural_residual)
        return violation <= max(self._settings.tolerances.feasibility, NEGLIGIBLE * size)

    def is_better(self, first: Iterate, second: Iterate | None) -> bool:
        """Whether the first of two points is the better one, or the only one."""
        if second is None:
            return True
        one, other = (iterate.standing(self._settings.tolerances, self.check.sign) for iterate in (first, second))
        return one.is_better_than(other)

    def is_certified(self, iterate: Iterate | None) -> bool:
        """Whether there is such a point and it needs no further strategy: optimal and, unless unpolished, exact."""
        tolerances = self._settings.tolerances
        if iterate is None or iterate.quality(tolerances) is not Quality.OPTIMAL:
            return False
        return not self._settings.polish or iterate.is_exact(tolerances)

    def has_no_better_limit(self, relaxed: Iterate) -> bool:
        """Whether smaller products and a polish of a relaxed point hardly lead to a better point than a certified one.

        The products that are left flatter its objective: with them it falls, and does not rise.
        """
        best = self.best
        if best is None or not self.is_certified(best):
            return False
        loss = self.check.sign * (relaxed.objective - best.objective)
        feasible = relaxed.converged and relaxed.constraint_violation <= self._settings.tolerances.feasibility
        return feasible and loss >= -SAME_OBJECTIVE * max(1.0, abs(best.objective))

    # ---------------------------------------------------------------- how the solve goes on

    def has_to_stop(self) -> bool:
        """Whether there is no time left, or somebody interrupted; without a solution, a time limit is noted."""
        if self.cut is None and self._settings.deadline.has_passed and not self.is_certified(self.best):
            self.cut = StopReason.TIME_LIMIT
        return self.cut is not None or self._settings.deadline.has_passed

    def has_to_run(self, strategy: Strategy, *, is_chosen: bool = False) -> bool:
        """Whether a strategy is to be run, after what the others have found.

        Parameters
        ----------
        strategy : Strategy
        is_chosen : bool
            Whether the caller has named it: then it follows wherever there is no solution.
        """
        best = self.best
        if best is None:
            return True
        if self.has_to_stop() or (self.unbounded is not None and not best.diverged):
            return False
        if self.is_certified(best):
            # It is a local solution: another way down finds a better one now and then, and ends at once where its
            # relaxed points are no better. Other starts have a budget, and follow later.
            is_way_down = Quality.OPTIMAL in strategy.follows and strategy.start is StartingPoint.INITIAL_GUESS
            few = strategy.most_pairs is None or len(self.pairs) <= strategy.most_pairs
            return self._settings.polish and few and is_way_down
        return is_chosen or bool(strategy.follows & self._ends(best))

    def _ends(self, best: Iterate) -> set[End]:
        """What there is instead of a solution, in the terms of `Strategy.follows`."""
        tolerances, first = self._settings.tolerances, self.first
        if self.pairs:
            return {Quality.FEASIBLE if best.excess(tolerances) <= 1.0 else Quality.INFEASIBLE}
        assert first is not None
        if first.certificate is Certificate.DESCENT:
            return set()  # the same starts lead to the same saddle, and what follows one was tried
        if first.status is IpoptStatus.ITERATION_LIMIT and "max_iter" in self._settings.options.user:
            return set()
        stuck = not first.diverged and first.excess(tolerances) <= 1.0
        return {first.stop_reason, *([Quality.FEASIBLE] if stuck else [])}


def _largest_product(sides: NDArray[np.float64]) -> float:
    return float(np.abs(sides.prod(axis=1)).max(initial=0.0))


def _largest_natural_residual(sides: NDArray[np.float64]) -> float:
    return float(np.abs(sides.min(axis=1)).max(initial=0.0))
