"""What is tried when no feasible plan was found: one step after the other, from the initial guess or the last point.

Normals on a wrong side or in contradiction, a plane for too long an interval, or an initial guess deep inside
an obstacle end in a point of local infeasibility. None of the steps below is trusted by itself: all end with the full
clearance and hard planes.

Starts that know one kind of model stand in folders of `contrib`. A folder with a module `start_provider` is found by
its name, so that nothing here imports one, and its starts are gone where the folder is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pkgutil import iter_modules
from typing import Any, NamedTuple, Protocol

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData, avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.rerouting import overlaps_deeply, reroute, runs_into_several
from pyrobocop_pyomo.obstacles.separation_rows import normal_of
from pyrobocop_pyomo.obstacles.tightening import split_violated
from pyrobocop_pyomo.solving.iterates import StopReason
from pyrobocop_pyomo.solving.second_tries import ITERATIONS_OF_ONE, SIDE_ITERATIONS
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .planning_point import PlanningPoint

CONTRIB = "pyrobocop_pyomo.contrib"
# Clearances that a provider's path keeps: a second path, farther from everything, is another start.
PATH_CLEARANCES = (1.0, 2.0)
_REGISTERED: list[StartProvider] = []
# Degrees by which the way past an obstacle is turned: to its other side, then across.
TURNS = (180.0, 90.0, -90.0)
# What violates its rows by no more is about to get there, and may go on.
NEARLY_FEASIBLE = 1e-2


class Recovery:
    """Starts to plan from, one after the other.

    Parameters
    ----------
    model : Block
        Its values are the user's initial guess.
    planning : SafePlanning

    Attributes
    ----------
    why_no_path : str
        Why there is no start at all; empty where that is not known.
    is_for_a_start : bool
        Whether another mesh comes next: where the guess was led around all obstacles, that mesh is the better try than
        a long search for another start.
    """

    def __init__(self, model: Any, planning: Any) -> None:
        self._model, self._planning = model, planning
        self._blocks, self._regions = avoidance_blocks(model), containments(model)
        self._initial = PlanningPoint(model)
        self._directions = {block: dict(block.record.directions) for block in self._blocks}
        self._was_cut_short = False
        self.why_no_path, self.is_for_a_start = "", False

    def steps(self) -> Iterator[Callable[[], SolveResult]]:
        """What solves from each start, after `start`; the caller stops asking when a plan is good enough."""
        provided = fitting_providers(self._model)
        may_be_led_around = all(fit.may_be_led_around for _, fit in provided)
        in_the_way = may_be_led_around and any(map(runs_into_several, self._blocks))
        is_led_around = in_the_way and self._has_a_way_around(freely=True)
        if is_led_around:
            yield partial(self._from_here, "led around all obstacles")
        starts = self._proposed([provider for provider, _ in provided])
        comes_first = not is_led_around and any(fit.comes_first for _, fit in provided)
        if comes_first:
            yield from islice(starts, 1)
        others = any(block.separations for block in self._blocks)
        # What converges from a good start takes few; from a bad one thousands are spent on restoring feasibility. Where
        # a search knows a better start, a guess that overlaps deeply gets the fewest; the rest comes at the end.
        is_bad = not may_be_led_around and any(map(overlaps_deeply, self._blocks))
        enough = SIDE_ITERATIONS if is_bad else ITERATIONS_OF_ONE
        yield partial(self._from_initial_guess, enough if others else None, is_at_start=not (in_the_way or comes_first))
        # Where no separation takes part, obstacles are not what makes the rest infeasible.
        if not any(block.separations for block in self._blocks):
            return
        if self.is_for_a_start and is_led_around and provided:
            return
        if self.why_no_path and not self._was_cut_short:
            return
        if not may_be_led_around:
            yield from starts
        if not is_led_around and self._has_a_way_around():
            yield partial(self._from_here, "led around all obstacles")
        yield from starts
        yield self._new_planes
        for turn in TURNS:
            yield partial(self._other_side, turn)
        if self._was_cut_short:
            yield self._from_initial_guess

    def _proposed(self, providers: Sequence[StartProvider]) -> Iterator[Callable[[], SolveResult]]:
        """What solves from the starts that providers put on the model; the values are those of before in between."""
        for provider in providers:
            proposals = provider.propose(self._model, self._planning.deadline)
            while True:
                last = PlanningPoint(self._model)
                self._initial.restore()
                try:
                    purpose = next(proposals)
                except (StopIteration, InitialGuessError) as end:
                    last.restore()
                    self.why_no_path = self.why_no_path or str(end)
                    break
                yield partial(self._from_here, purpose)

    def start(self, directions: Mapping[ObstacleAvoidanceBlockData, Any] | None = None) -> None:
        """Back to the initial guess, with separations that start there."""
        self._initial.restore()
        self.initialize_separations(
            {block: self._directions[block] | (directions or {}).get(block, {}) for block in self._blocks}
        )

    def initialize_separations(self, directions: Mapping[ObstacleAvoidanceBlockData, Any] | None = None) -> None:
        """Separations and regions for the values on the model, without what another motion asked for."""
        for region in self._regions:
            region.margin.store_values(dict.fromkeys(region.times, 0.0))
        for block in self._blocks:
            block.margin.store_values(dict.fromkeys(block.separations, 0.0))
            block.initialize(directions=(directions or {}).get(block))

    def _from_initial_guess(self, most_iterations: int | None = None, *, is_at_start: bool = False) -> SolveResult:
        if not is_at_start:
            self.start()
        again = ", to the end" if self._was_cut_short else ""
        result = self._planning.solve(f"from the initial guess{again}", most_iterations=most_iterations)
        self._was_cut_short = result.stop_reason is StopReason.ITERATION_LIMIT
        if self._was_cut_short and most_iterations is not None and result.constraint_violation <= NEARLY_FEASIBLE:
            result = self._planning.solve("on from there", again=True, most_iterations=ITERATIONS_OF_ONE)
        return result

    def _has_a_way_around(self, *, freely: bool = False) -> bool:
        """Whether the initial guess can be led around all obstacles at once; it is on the model then.

        The guess says how fast it goes and where it starts and ends. Where it runs into everything (`freely`), the best
        motion without obstacles says so better, if that is found at once.
        """
        last = PlanningPoint(self._model)
        self._initial.restore()
        if freely:
            self._planning.solve_without_obstacles()
        rerouted = [bool(reroute(block)) for block in self._blocks]
        if not any(rerouted):
            # The next step goes on from there.
            last.restore()
        return any(rerouted)

    def _from_here(self, purpose: str) -> SolveResult:
        """From the values on the model."""
        self.initialize_separations()
        # A start that is clear of everything needs no detour over the middle of all bounds.
        clear = not any(block.record.overlapping for block in self._blocks)
        return self._planning.solve(purpose, again=clear, most_iterations=ITERATIONS_OF_ONE)

    def _new_planes(self) -> SolveResult:
        for block in self._blocks:
            split_violated(block)
            block.initialize()
        return self._planning.solve("new planes, at the last point", most_iterations=ITERATIONS_OF_ONE)

    def _other_side(self, turn: float) -> SolveResult:
        """Let the two bodies with the largest violation pass each other on another side."""
        block, pair, direction = self._most_in_the_way()
        self.start({block: {pair: _turned(direction, turn)}})
        purpose = f"'{pair[0]}' past '{pair[1]}', {turn:.0f} degrees round"
        return self._planning.solve(purpose, most_iterations=ITERATIONS_OF_ONE)

    def _most_in_the_way(self) -> tuple[ObstacleAvoidanceBlockData, tuple[str, str], Array]:
        """The block and bodies of the separation with the largest violation, and its normal at the initial guess."""
        gaps = {
            (block, index): gap - value(block.required[index])
            for block in self._blocks
            for index, gap in block.separation_gaps().items()
        }
        block, (first, second, start) = min(gaps, key=gaps.__getitem__)
        normal = normal_of(block, (first, second, start))
        self.start()
        # The broad phase may leave out at the initial guess what is in the way now.
        if (first, second, start) in block.separations:
            normal = normal_of(block, (first, second, start))
        parts = block.record.scene.parts
        return block, (parts[first].body, parts[second].body), normal


def _turned(direction: Array, degrees: float) -> Array:
    """A direction turned in the plane of its two largest components."""
    i, j = np.sort(np.argsort(-np.abs(direction), kind="stable")[:2])
    angle = np.deg2rad(degrees)
    turned = direction.copy()
    turned[i] = np.cos(angle) * direction[i] - np.sin(angle) * direction[j]
    turned[j] = np.sin(angle) * direction[i] + np.cos(angle) * direction[j]
    return turned


# --------------------------------------------------- starts that know one kind of model: paths of cars, or of arms


class Fit(NamedTuple):
    """How starts of one kind stand to those that a plan has anyway.

    Attributes
    ----------
    comes_first : bool
        The initial guess is so far off that solving from it would be in vain.
    may_be_led_around : bool
        Whether the guess is a start too when a path on a grid leads it around obstacles.
    obeys_equations : bool
        The starts are motions that the model can make; providers that only know its shapes are not asked then.
    """

    comes_first: bool = False
    may_be_led_around: bool = True
    obeys_equations: bool = False


class StartProvider(Protocol):
    """Knows starts for models of one kind."""

    def fits(self, model: Any) -> Fit | None:
        """How its starts fit a model, whose values are the user's initial guess; None for models of other kinds."""

    def propose(self, model: Any, deadline: Deadline) -> Iterator[str]:
        """Put one start after another on the model, and say in words what each is.

        Each is made from the user's initial guess, which is on the model whenever this goes on. Where there is no start
        at all, and no plan either, an InitialGuessError says why.
        """


def register_starts(provider: StartProvider) -> None:
    """Let plans start from what a provider proposes."""
    _REGISTERED.append(provider)


@cache
def _loaded() -> None:
    """Import what registers itself."""
    contrib = find_spec(CONTRIB)
    for folder in iter_modules(contrib.submodule_search_locations if contrib is not None else ()):
        if folder.ispkg and find_spec(f"{CONTRIB}.{folder.name}.start_provider") is not None:
            import_module(f"{CONTRIB}.{folder.name}.start_provider")


def fitting_providers(model: Any) -> list[tuple[StartProvider, Fit]]:
    """The providers that know starts for a model."""
    _loaded()
    found = [(provider, provider.fits(model)) for provider in _REGISTERED]
    fitting = [(provider, fit) for provider, fit in found if fit is not None]
    return [(provider, fit) for provider, fit in fitting if fit.obeys_equations] or fitting
