"""The model of a parking case: a car, its obstacles, a path of hybrid A* as the initial guess."""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.expr import cos, sin, tan

from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError
from pyrobocop_pyomo.geometry import planar_pose, signed_distance
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.obstacles.avoidance_block import ObstacleAvoidanceBlock
from pyrobocop_pyomo.phases import Control, Duration, PhaseBlock, State

from .car_path import CarPath
from .cost_to_go import bounds_around
from .motion_primitives import CarSearch
from .parking_case import ParkingCar, ParkingCase
from .staged_search import CLEARANCES, ROOM, staged_search

logger = logging.getLogger(__name__)

# Of the clearance that start and goal have, where that is less than asked for.
SHARE_OF_AVAILABLE = 0.8
SECONDS_PER_ELEMENT = 0.6
ELEMENTS = (30, 90)
# Seconds of duration per unit of the integral of squared controls: makes the controls of the fastest plan unique.
EFFORT = 0.1


def parking_model(
    case: ParkingCase,
    car: ParkingCar | None = None,
    *,
    clearance: float = 0.05,
    elements: int | None = None,
    search: CarSearch | None = None,
    needs_path: bool = False,
    time_limit: float | None = None,
) -> ConcreteModel:
    """Model of a parking case, ready for `solve`: from rest at the start to rest at the goal in little time.

    Coordinates of the model are relative to the start: add ``case.origin`` to x and y.

    Parameters
    ----------
    case : ParkingCase
    car : ParkingCar, optional
    clearance : float, optional
        Distance to keep. Where the start or the goal has less, 0.8 times what it has is requested; where no path keeps
        it, the largest of 0.6, 0.4, 0.2 and 0.1 times it that a path keeps. The log says so.
    elements : int, optional
        Of the mesh; by default one for 0.6 seconds of the initial guess, from 30 to 90.
    search : CarSearch, optional
        Resolution and costs of the path that is the initial guess, and how long it is searched for.
    needs_path : bool, optional
        Whether to refuse a case in which no path keeps the clearance. By default less is required then, and where there
        is no path at all, a straight line is the initial guess.
    time_limit : float, optional
        Seconds for the search. Without it the model does not depend on how busy the machine is.

    Returns
    -------
    ConcreteModel
        With the phase ``drive``: states ``x``, ``y``, ``theta``, ``v``, ``steering``, controls ``acceleration`` and
        ``steering_rate``; its block ``avoid``; and the objective ``cost``, the duration plus a tenth of the integral
        of squared controls.

    Raises
    ------
    ObstacleError
        When the car overlaps an obstacle at the start or at the goal.
    InitialGuessError
        When there is no path, and one is needed.
    """
    car = ParkingCar() if car is None else car
    clearance, reductions = _possible_clearance(case, car, clearance)
    ends, wanted = np.array([case.start[:2], case.goal[:2]]), clearance
    regions = [bounds_around(ends, room * car.length) for room in ROOM]
    path: CarPath | None
    try:
        path, clearance, bounds = staged_search(
            tuple(case.start),
            tuple(case.goal),
            body=car.shape,
            obstacles=case.parts,
            wheelbase=car.wheelbase,
            steering_limit=car.steering,
            regions=regions,
            clearance=wanted,
            shares=(1.0,) if needs_path else CLEARANCES,
            search=search,
            time_limit=time_limit,
        )
        if clearance < wanted:
            logger.warning(
                "parking case '%s': no path with a clearance of %.4g was found; %.4g is required.",
                case.name, wanted, clearance,
            )  # fmt: skip
    except InitialGuessError as error:
        if needs_path:
            raise
        logger.warning(
            "parking case '%s': no path was found; the initial guess is a straight line. %s", case.name, error
        )
        path, bounds = None, regions[-1]
    for reduction in reductions:  # of a case that is refused nothing is required
        logger.warning("%s", reduction)
    duration = 30.0 if path is None else path.timed(0.6 * car.speed, 0.5 * car.acceleration).duration
    if elements is None:
        elements = int(np.clip(math.ceil(duration / SECONDS_PER_ELEMENT), *ELEMENTS))
    final_heading = float(case.goal[2] if path is None else path.poses[-1, 2])
    m = ConcreteModel(name=case.name)
    m.drive = b = PhaseBlock(
        duration=Duration(bounds=(0.1, 20.0 * duration), initial_guess=duration), elements=elements, stages=3
    )
    b.x = State(initial=float(case.start[0]), final=float(case.goal[0]), bounds=bounds[0])
    b.y = State(initial=float(case.start[1]), final=float(case.goal[1]), bounds=bounds[1])
    b.theta = State(initial=float(case.start[2]), final=final_heading)
    b.v = State(initial=0, final=0, bounds=(-car.speed, car.speed))
    b.steering = State(initial=0, bounds=(-car.steering, car.steering))
    b.acceleration = Control(bounds=(-car.acceleration, car.acceleration), parametrization="piecewise_constant")
    b.steering_rate = Control(bounds=(-car.steering_rate, car.steering_rate), parametrization="piecewise_constant")

    @b.ode
    def bicycle(b: Any, t: Any) -> dict[Any, Any]:
        return {
            b.x: b.v[t] * cos(b.theta[t]),
            b.y: b.v[t] * sin(b.theta[t]),
            b.theta: b.v[t] * tan(b.steering[t]) / car.wheelbase,
            b.v: b.acceleration[t],
            b.steering: b.steering_rate[t],
        }

    if path is None:
        b.initialize_straight_lines()
    else:
        b.initialize(path.initial_guess(b, speed=0.6 * car.speed, acceleration=0.5 * car.acceleration))
    if case.obstacles:
        b.avoid = ObstacleAvoidanceBlock(
            b.time,
            bodies={"car": Body(car.shape, pose=_pose)},
            obstacles=dict(case.obstacles),
            clearance=clearance,
            broad_phase=car.width,  # the fastest plan is seldom farther from the path than this
        )
    m.cost = Objective(expr=b.duration + EFFORT * b.integral(_effort))
    return m


def _pose(b: Any, t: Any) -> Any:
    return planar_pose(b.x[t], b.y[t], b.theta[t])


def _effort(b: Any, t: Any) -> Any:
    return b.acceleration[t] ** 2 + b.steering_rate[t] ** 2


def _possible_clearance(case: ParkingCase, car: ParkingCar, clearance: float) -> tuple[float, list[str]]:
    """The clearance asked for, or less where an end has less, and each such reduction in words.

    Raises
    ------
    ObstacleError
        Naming the obstacle that the car overlaps at an end.
    """
    if not (math.isfinite(clearance) and clearance > 0.0):
        raise ObstacleError(f"parking case '{case.name}': clearance = {clearance}; expected a positive length.")
    reductions = []
    for which, end in (("start", case.start), ("goal", case.goal)):
        for name, shape in case.parts.items():
            distance = signed_distance(car.shape, shape, planar_pose(*end.tolist())).distance
            if distance <= 0.0:
                raise ObstacleError(
                    f"parking case '{case.name}': at the {which} the car overlaps '{name}' by {-distance:.6g}. Is its "
                    "pose that of the middle of the rear axle, and its size that of ParkingCar?"
                )
            if distance < clearance:
                reductions.append(
                    f"parking case '{case.name}': at the {which} '{name}' is {distance:.4g} away, less than the "
                    f"clearance {clearance:.4g}; {SHARE_OF_AVAILABLE * distance:.4g} is required."
                )
                clearance = SHARE_OF_AVAILABLE * distance
    return clearance, reductions
