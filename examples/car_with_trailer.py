"""A car backs its trailer into a loading bay, or pulls it from one aisle of a warehouse into the next.

The hitch is a metre behind the rear axle of a kinematic bicycle, and the wheels of the trailer do not slip either. So
the trailer's angle to the car decays while the car drives ahead, and grows while it reverses: the car has to steer the
wrong way first. The angle may not exceed 57 degrees. Car and trailer keep 10 cm from shelves and walls, also between
the points of the mesh; duration and effort are penalised.

The initial guess is a straight line through the shelves. The solver recognises the trailer by its equations, and
searches for a path by itself.

Laumond, Jacobs, Taix & Murray, A motion planner for nonholonomic mobile robots, IEEE Transactions on Robotics and
Automation 10 (1994), doi:10.1109/70.326564, for the kinematics.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Metres, seconds, radians. The frame of each body sits on its (rear) axle.
WHEELBASE, HITCH, LENGTH = 2.5, -1.0, 3.2
CAR = rcp.Polytope.from_vertices([(-0.8, -0.9), (3.2, -0.9), (3.2, 0.9), (-0.8, 0.9)])
TRAILER = rcp.Polytope.from_vertices([(-1, -0.9), (2, -0.9), (2, 0.9), (-1, 0.9)])
CLEARANCE = 0.1
STEERING, STEERING_RATE, ACCELERATION, SPEED, ANGLE = 0.6, 0.6, 0.5, (-1.0, 2.0), 1.0
BOX = ((-20, 20), (-20, 20))


def box(left: float, bottom: float, right: float, top: float) -> rcp.Polytope:
    """A shelf, a pallet or a wall."""
    return rcp.Polytope.box(right - left, top - bottom, center=(0.5 * (left + right), 0.5 * (bottom + top)))


# Start and goal as (x, y, heading, angle of the trailer).
CASES: dict[str, dict[str, Any]] = {
    "bay": {
        "start": (-8, 4, 0, 0),
        "goal": (0, 0.3, pi / 2, 0),
        "obstacles": {
            "left": box(-14, -7, -1.4, 0), "right": box(1.4, -7, 14, 0), "dock": box(-1.4, -7, 1.4, -5.6),
            "far side": box(-14, 11, 14, 12),
        },
    },
    "aisles": {
        "start": (-5, -4, 0, 0),
        "goal": (-4, 4, pi, 0),
        "obstacles": {
            "shelf": box(-14, -1.5, 4, 1.5), "lower": box(-14, -7.5, 4, -6.5), "upper": box(-14, 6.5, 4, 7.5),
            "wall": box(15, -12, 16, 12),
        },
    },
}  # fmt: skip


def build(
    case: str = "bay", elements: int = 40, stages: int = 2, scene: Mapping[str, Any] | None = None
) -> pyo.ConcreteModel:
    """From the start to the goal of a case, or of another scene, in little time."""
    scene = CASES[case] if scene is None else scene
    m = pyo.ConcreteModel(name="car with a trailer")
    m.drive = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(5, 120), initial_guess=30), elements=elements, stages=stages
    )
    limits = {"x": BOX[0], "y": BOX[1], "theta": (None, None), "angle": (-ANGLE, ANGLE)}
    for (name, bounds), first, last in zip(limits.items(), scene["start"], scene["goal"], strict=True):
        b.declare(name, rcp.State(initial=first, final=last, bounds=bounds))
    b.v = rcp.State(initial=0, final=0, bounds=SPEED)
    b.steering = rcp.State(initial=0, bounds=(-STEERING, STEERING))
    b.acceleration = rcp.Control(bounds=(-ACCELERATION, ACCELERATION), parametrization="piecewise_constant")
    b.steering_rate = rcp.Control(bounds=(-STEERING_RATE, STEERING_RATE), parametrization="piecewise_constant")

    @b.ode
    def rolling(b, t):
        turn = b.v[t] * pyo.tan(b.steering[t]) / WHEELBASE
        own_turn = (HITCH * turn * pyo.cos(b.angle[t]) - b.v[t] * pyo.sin(b.angle[t])) / LENGTH
        return {
            b.x: b.v[t] * pyo.cos(b.theta[t]),
            b.y: b.v[t] * pyo.sin(b.theta[t]),
            b.theta: turn,
            b.angle: own_turn - turn,
            b.v: b.acceleration[t],
            b.steering: b.steering_rate[t],
        }

    b.initialize_straight_lines()
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"car": rcp.Body(CAR, pose=pose_of_car), "trailer": rcp.Body(TRAILER, pose=pose_of_trailer)},
        obstacles=scene["obstacles"],
        clearance=CLEARANCE,
        exclude=[("car", "trailer")],
    )
    m.cost = pyo.Objective(
        expr=b.duration + b.integral(lambda b, t: b.steering[t] ** 2 + b.acceleration[t] ** 2 + b.steering_rate[t] ** 2)
    )
    return m


def pose_of_car(b: Any, t: Any) -> rcp.Pose:
    """Of the middle of its rear axle."""
    return rcp.planar_pose(b.x[t], b.y[t], b.theta[t])


def pose_of_trailer(b: Any, t: Any) -> rcp.Pose:
    """Of the middle of its axle."""
    return pose_of_car(b, t) @ rcp.planar_pose(HITCH, 0, b.angle[t]) @ rcp.planar_pose(-LENGTH, 0)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Car and trailer on their way, with speed, steering and the angle of the trailer to the car below."""
    above, below = figure.subfigures(2, 1, height_ratios=(2.2, 1))
    rcp.scenes.draw_avoidance(m.drive.avoid, snapshots=12, title=m.name, figure=above)
    signals = {"v": "speed", "steering": "steering", "angle": "trailer"}
    m.drive.trajectory().plot(signals, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    run_example(
        build,
        draw,
        cases={name: {"case": name} for name in CASES},
        default="bay",
        coarse={"elements": 25},
        size=(8, 9),
    )
