"""Paths of cars as starts of plans: cars are recognised by their equations."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.obstacles import avoidance_blocks
from pyrobocop_pyomo.obstacles.rerouting import balls_of, distance_lower_bounds, overlaps_deeply
from pyrobocop_pyomo.planning.recovery import PATH_CLEARANCES, Fit, register_starts

from .recognised_car import RecognisedCar, recognised_car

logger = logging.getLogger(__name__)


class CarStarts:
    """Paths that cars and their trailers can drive."""

    def fits(self, model: Any) -> Fit | None:
        """See `StartProvider`. A path on a grid is no start where a car has to manoeuvre."""
        cars = _cars(model)
        if not cars:
            return None
        # The path of a car comes close to obstacles, and is a good start nevertheless.
        pulls = any(car.trailer is not None for _, car in cars)
        blocks = avoidance_blocks(model)
        free = not pulls and any(map(overlaps_deeply, blocks)) and all(map(_can_turn_at_both_ends, blocks))
        return Fit(may_be_led_around=free, obeys_equations=True)

    def propose(self, model: Any, deadline: Deadline) -> Iterator[str]:
        """See `StartProvider`. Where there is no path, there is none farther from everything either."""
        cars = _cars(model)
        for clearances in PATH_CLEARANCES:
            has_path = False
            for block, car in cars:
                try:
                    path = car.path(block, clearances, deadline.left)
                except InitialGuessError as error:
                    logger.info("'%s': no path for '%s': %s", block.name, car.bodies[0], error)
                    continue
                has_path = car.follow(path) or has_path
            if not has_path:
                return
            yield f"along the path of a car, {clearances:g} clearances from obstacles"


def _can_turn_at_both_ends(block: Any) -> bool:
    """Whether every body that moves could turn on the spot where its motion starts and ends, clear of what rests.

    A car whose start or goal has no such room needs manoeuvres, which a path for a ball does not know.
    """
    motion, scene = block.motion, block.record.scene
    for name, body in scene.bodies.items():
        if name in scene.obstacles or body.pose is None:
            continue
        balls, walls = balls_of(scene, name), [wall.shape for _, wall in scene.walls_of(name)]
        clearance = max(value for pair, value in scene.clearances.items() if name in pair)
        ends = [motion.intervals[0][0], motion.intervals[-1][-1]]
        poses = [motion.pose_at_node(body.pose, end, name=name).numbers() for end in ends]
        middles = np.array([rotation @ balls.middle + place for rotation, place in poses])
        if (distance_lower_bounds(middles, walls) < balls.outer + clearance).any():
            return False
    return True


def _cars(model: Any) -> list[tuple[Any, RecognisedCar]]:
    return [(block, car) for block in avoidance_blocks(model) if (car := recognised_car(block)) is not None]


register_starts(CarStarts())
