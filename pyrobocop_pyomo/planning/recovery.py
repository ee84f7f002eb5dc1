"""What is tried when no feasible plan was found: one step after the other, from the initial guess or the last point.

Normals on a wrong side or in contradiction, a plane for too long an interval, or an initial guess deep inside
an obstacle end in a point of local infeasibility. None of the steps below is trusted by itself: all end with the full
clearance and hard planes.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.configuration_space import ConfigurationSpace
from pyrobocop_pyomo.obstacles.rerouting import can_be_rerouted, can_turn_at_both_ends, reroute, runs_into_several
from pyrobocop_pyomo.obstacles.sampled_path import sampled_path
from pyrobocop_pyomo.obstacles.tightening import split_violated
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .planning_point import PlanningPoint
from .recognised_car import recognised_car

logger = logging.getLogger(__name__)

CLEARANCE_FACTORS = (0.2, 0.5, 1.0)
# In units of the objective, per length that a plane gives way.
SOFTNESS_WEIGHT = 100.0
# Degrees by which the way past an obstacle is turned: to its other side, then across.
TURNS = (180.0, 90.0, -90.0)
# Iterations of Ipopt from one start while there are others to try. What converges from a good start takes fewer; from
# a bad one thousands are spent on restoring feasibility. The initial guess gets the rest at the end.
MOST_ITERATIONS = 500
# The same for the initial guess of a car, where a search knows a better start; and where that guess overlaps deeply,
# by this share of the body.
MOST_ITERATIONS_OF_A_CAR, MOST_ITERATIONS_IN_OVERLAP = 400, 60
DEEP = 0.1
# What violates its rows by no more is about to get there, and may go on.
NEARLY_FEASIBLE = 1e-2
# Clearances that a path of a car keeps: a second path, farther from everything, is another start.
PATH_CLEARANCES = (1.0, 2.0)
# Random configurations of an arm, for each path.
SAMPLES = 4000


class Solves(Protocol):
    """What a recovery needs of the planning that it is part of."""

    def solve(
        self, purpose: str, *, again: bool = False, relaxed: bool = False, most_iterations: int | None = None
    ) -> SolveResult:
        """Solve the model as it stands."""

    def solve_without_obstacles(self) -> bool:
        """Put the best motion without obstacles on the model, where it is found at once; else nothing changes."""

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""

    def seconds_left(self) -> float:
        """Until the time limit; infinite without one."""


class Recovery:
    """Starts to plan from, one after the other.

    Parameters
    ----------
    model : Block
        Its values are the user's initial guess.
    blocks : list of ObstacleAvoidanceBlockData
    regions : list of ContainmentData
    planning : Solves

    Attributes
    ----------
    why_no_path : str
        Why the first search among random configurations found none; empty where all did, or there was none.
    is_for_a_start : bool
        Whether another mesh comes next: where the guess of a car was led around all obstacles, that mesh is the better
        try than the search for its path, which is long.
    """

    def __init__(
        self, model: Any, blocks: list[ObstacleAvoidanceBlockData], regions: list[ContainmentData], planning: Solves
    ) -> None:
        self._model, self._blocks, self._regions, self._planning = model, blocks, regions, planning
        self._initial = PlanningPoint(model)
        self._directions = {block: dict(block.record.directions) for block in blocks}
        self._was_cut_short = False
        self.why_no_path, self.is_for_a_start = "", False

    def steps(self) -> Iterator[Callable[[], SolveResult]]:
        """What solves from each start, after `start`; the caller stops asking when a plan is good enough."""
        cars = [(block, car) for block in self._blocks if (car := recognised_car(block)) is not None]
        # The path of a car comes close to obstacles, and is a good start nevertheless.
        pulls = any(car.trailer is not None for _, car in cars)
        no_manoeuvres = not cars or (
            not pulls and self._overlaps_deeply() and all(map(can_turn_at_both_ends, self._blocks))
        )
        in_the_way = no_manoeuvres and any(map(runs_into_several, self._blocks))
        is_led_around = in_the_way and self._has_a_way_around(freely=True)
        if is_led_around:
            yield partial(self._from_here, "led around all obstacles")
        # Where an arm starts deep inside an obstacle, or ends where it must not, most of its rounds would be in vain.
        is_far_off = not cars and not is_led_around and self._is_far_off()
        first, *more = enumerate(PATH_CLEARANCES)
        if is_far_off and self._leads_along_samples(*first):
            yield partial(self._from_here, "along random configurations")
        others = any(block.separations for block in self._blocks)
        enough = MOST_ITERATIONS_OF_A_CAR if cars else MOST_ITERATIONS
        yield partial(self._from_initial_guess, enough if others else None, is_at_start=not (in_the_way or is_far_off))
        # Where no separation takes part, obstacles are not what makes the rest infeasible.
        if not any(block.separations for block in self._blocks):
            return
        if self.is_for_a_start and is_led_around and cars:
            return
        if is_far_off and self.why_no_path and not self._was_cut_short and not self._has_clear_ends():
            return
        formulations = [block.record.formulation for block in self._blocks]
        for clearances in PATH_CLEARANCES:
            if not self._leads_along_paths(cars, clearances):
                break  # there is none farther from everything either
            yield partial(self._from_here, f"along the path of a car, {clearances:g} clearances from obstacles")
        if not is_led_around and self._has_a_way_around():
            is_led_around = True
            yield partial(self._from_here, "led around all obstacles")
        if not cars:
            for seed, clearances in more if is_far_off else (first, *more):
                if self._leads_along_samples(seed, clearances):
                    yield partial(self._from_here, f"along random configurations, {clearances:g} clearances away")
        yield self._new_planes
        if any(formulation.norms for formulation in formulations):
            yield self._other_norm
        yield self._growing_clearance
        if all(formulation.signed for formulation in formulations):
            yield self._giving_way
        for turn in TURNS:
            yield partial(self._other_side, turn)
        if self._was_cut_short:
            yield self._from_initial_guess

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
            region.initialize()
        for block in self._blocks:
            clear_margins(block)
            block.initialize(directions=(directions or {}).get(block))

    def _from_initial_guess(self, most_iterations: int | None = None, *, is_at_start: bool = False) -> SolveResult:
        if not is_at_start:
            self.start()
        if most_iterations == MOST_ITERATIONS_OF_A_CAR and self._overlaps_deeply():
            most_iterations = MOST_ITERATIONS_IN_OVERLAP
        again = ", to the end" if self._was_cut_short else ""
        result = self._planning.solve(f"from the initial guess{again}", most_iterations=most_iterations)
        self._was_cut_short = result.stop_reason is StopReason.ITERATION_LIMIT
        if self._was_cut_short and most_iterations is not None and result.constraint_violation <= NEARLY_FEASIBLE:
            result = self._planning.solve("on from there", again=True, most_iterations=MOST_ITERATIONS_OF_A_CAR)
        return result

    def _overlaps_deeply(self) -> bool:
        """Whether shapes overlap at the initial guess, where the separations start now, by more than a little."""
        for block in self._blocks:
            reach = min(part.shape.reach for part in block.record.scene.parts.values() if part.shape.is_bounded)
            if min(block.separation_gaps().values(), default=0.0) < -DEEP * reach:
                return True
        return False

    def _leads_along_paths(self, cars: Sequence[tuple[ObstacleAvoidanceBlockData, Any]], clearances: float) -> bool:
        """Whether a search finds a path for a car; it is on the model then, as its initial guess."""
        last, found = PlanningPoint(self._model), False
        self._initial.restore()
        for block, car in cars:
            left = self._planning.seconds_left()
            try:
                path = car.path(block, clearances, None if math.isinf(left) else max(left, 1e-3))
            except InitialGuessError as error:
                logger.info("'%s': no path for '%s': %s", block.name, car.bodies[0], error)
                continue
            found = car.follow(path) or found
        if not found:
            last.restore()
        return found

    def _is_far_off(self) -> bool:
        """Whether an arm's guess overlaps deeply, or does not end where rows of the model say.

        Where the position of a body consists of variables, the guess is led around obstacles instead.
        """
        if all(map(can_be_rerouted, self._blocks)):
            return False
        return self._overlaps_deeply() or not all(space.guess_ends_there() for space in self._spaces())

    def _has_clear_ends(self) -> bool:
        """Whether there are configurations that are clear and meet the rows of the model at all starts and ends.

        Where there are none, other ways past the obstacles do not help. Other random ones than for the paths are tried.
        """
        last, generator = PlanningPoint(self._model), np.random.default_rng(len(PATH_CLEARANCES))
        self._initial.restore()
        try:
            for space in self._spaces():
                for is_last in (False, True):
                    space.ends(is_last, space.guess()[0], generator)
        except InitialGuessError as error:
            logger.info("%s", error)
            return False
        finally:
            last.restore()
        return True

    def _spaces(self) -> Iterator[ConfigurationSpace]:
        """Configurations of the phases that have some."""
        for phase in phases_of(self._model):
            try:
                yield ConfigurationSpace(phase)
            except (InitialGuessError, ObstacleError, ValueError) as error:
                logger.info("'%s': no configurations: %s", phase.name, error)

    def _leads_along_samples(self, seed: int, clearances: float) -> bool:
        """Whether arms and bodies that fly find a path where the initial guess collides; it is on the model then."""
        last, found = PlanningPoint(self._model), False
        self._initial.restore()
        for space in self._spaces():
            if space.guess_leads_there():
                continue
            try:
                guess = sampled_path(space.phase, clearances=clearances, samples=SAMPLES, seed=seed)
            except InitialGuessError as error:
                logger.info("%s", error)
                self.why_no_path = self.why_no_path or str(error)
                continue
            space.phase.initialize(guess)
            found = True
        if not found:
            last.restore()
        return found

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
        for block in self._blocks:
            clear_margins(block)
            block.initialize()
        # A start that is clear of everything needs no detour over the middle of all bounds.
        clear = not any(block.record.overlapping for block in self._blocks)
        return self._planning.solve(purpose, again=clear, most_iterations=MOST_ITERATIONS)

    def _new_planes(self) -> SolveResult:
        for block in self._blocks:
            split_violated(block)
            block.initialize()
        return self._planning.solve("new planes, at the last point", most_iterations=MOST_ITERATIONS)

    def _other_norm(self) -> SolveResult:
        self.start()
        for block in self._blocks:
            if block.record.formulation.norms:
                block.set_norm("ball" if block.record.norm_now == "sphere" else "sphere")
        return self._planning.solve("other norm of the normals", most_iterations=MOST_ITERATIONS)

    def _growing_clearance(self) -> SolveResult:
        self.start()
        try:
            for factor in CLEARANCE_FACTORS:
                for block in self._blocks:
                    block.scale_clearance(factor)
                result = self._planning.solve(
                    f"{factor:.0%} of the clearance",
                    again=factor != CLEARANCE_FACTORS[0],
                    relaxed=factor < 1.0,
                    most_iterations=MOST_ITERATIONS,
                )
                if result.quality is Quality.INFEASIBLE or not self._planning.may_go_on(result):
                    break
        finally:
            for block in self._blocks:
                block.scale_clearance(1.0)
        return result

    def _giving_way(self) -> SolveResult:
        with softened(self._model, self._blocks, SOFTNESS_WEIGHT):
            self.start()
            self._planning.solve("planes that give way", relaxed=True, most_iterations=MOST_ITERATIONS)
        for block in self._blocks:
            block.initialize()
        return self._planning.solve("hard planes again", most_iterations=MOST_ITERATIONS)

    def _other_side(self, turn: float) -> SolveResult:
        """Let the two bodies with the largest violation pass each other on another side."""
        block, pair, direction = self._most_in_the_way()
        self.start({block: {pair: _turned(direction, turn)}})
        purpose = f"'{pair[0]}' past '{pair[1]}', {turn:.0f} degrees round"
        return self._planning.solve(purpose, most_iterations=MOST_ITERATIONS)

    def _most_in_the_way(self) -> tuple[ObstacleAvoidanceBlockData, tuple[str, str], Array]:
        """The block and bodies of the separation with the largest violation, and its normal at the initial guess."""
        gaps = {
            (block, index): gap - value(block.required[index])
            for block in self._blocks
            for index, gap in block.separation_gaps().items()
        }
        block, (first, second, start) = min(gaps, key=gaps.__getitem__)
        at_last_point = _normal(block, first, second, start)
        self.start()
        # The broad phase may leave out at the initial guess what is in the way now.
        normal = _normal(block, first, second, start) if (first, second, start) in block.separations else at_last_point
        parts = block.record.scene.parts
        return block, (parts[first].body, parts[second].body), normal


def _normal(block: ObstacleAvoidanceBlockData, first: str, second: str, start: Any) -> Array:
    return np.array([value(block.normal[first, second, start, axis]) for axis in block.axes])


def clear_margins(block: ObstacleAvoidanceBlockData) -> None:
    """Forget what another motion asked for."""
    for index in block.separations:
        block.margin[index] = 0.0


def _turned(direction: Array, degrees: float) -> Array:
    """A direction turned in the plane of its two largest components."""
    i, j = np.sort(np.argsort(-np.abs(direction), kind="stable")[:2])
    angle = np.deg2rad(degrees)
    turned = direction.copy()
    turned[i] = np.cos(angle) * direction[i] - np.sin(angle) * direction[j]
    turned[j] = np.sin(angle) * direction[i] + np.cos(angle) * direction[j]
    return turned


@contextmanager
def softened(model: Any, blocks: list[ObstacleAvoidanceBlockData], weight: float) -> Iterator[None]:
    """Let planes be violated at a penalty, in an objective that replaces the user's meanwhile."""
    users = list(model.component_data_objects(Objective, active=True))
    home = blocks[0]
    name = unique_component_name(home, "softened_objective")
    own = sum(objective.expr if objective.is_minimizing() else -objective.expr for objective in users)
    try:
        for block in blocks:
            block.soften(weight)
        home.add_component(name, Objective(expr=own + sum(block.softness for block in blocks)))
        for objective in users:
            objective.deactivate()
        yield
    finally:
        for objective in users:
            objective.activate()
        home.del_component(name)
        for block in blocks:
            block.harden()
