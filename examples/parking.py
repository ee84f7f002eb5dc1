"""Park a car backwards into a slot, or parallel to the street.

A kinematic bicycle with limits on steering, its rate, acceleration and speed has to get from the street into a slot
that leaves 30 cm on each side, or 1.3 m in all along the street, and keeps 5 cm from everything on the way, also
between the points of the mesh. The duration is free; time and effort are penalised. Pavement, neighbours and the far
side of the street are half-planes and wedges that never end.

The initial guess comes from a search over a grid of poses, Hybrid A*: the planner finds where to change gear, the
optimiser makes a smooth motion of it.

Zhang, Liniger, Sakai & Borrelli, Autonomous parking using optimization-based collision avoidance, CDC 2018,
doi:10.1109/CDC.2018.8619433
"""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Metres, seconds, radians. The frame of the car sits on its rear axle.
WHEELBASE = 2.7
CAR = rcp.Polytope.from_vertices([(-1, -1), (3.7, -1), (3.7, 1), (-1, 1)])
CLEARANCE = 0.05
STEERING, STEERING_RATE, ACCELERATION, SPEED = 0.6, 0.6, 0.4, (-1.0, 2.0)
BOX = ((-15, 15), (1, 10))  # of the rear axle
START = (-6, 9.5, 0)


def below_and_beside(x: float, y: float, side: int) -> rcp.Polytope:
    """The endless wedge below y, on the left (side = -1) or on the right of x."""
    return rcp.Polytope.from_halfspaces([[-side, 0], [0, 1]], [-side * x, y], bounded=False)


FAR_SIDE = rcp.Polytope.from_halfspaces([[0, -1]], [-11], bounded=False)
PAVEMENT = rcp.Polytope.from_halfspaces([[0, 1]], [2.5], bounded=False)
CASES = {
    "reverse": {
        "goal": (0, 1.3, pi / 2),
        "obstacles": {
            "left": below_and_beside(-1.3, 5, -1),
            "right": below_and_beside(1.3, 5, 1),
            "far side": FAR_SIDE,
        },
    },
    "parallel": {
        "goal": (-1.35, 4, 0),
        "obstacles": {
            "behind": below_and_beside(-3, 5, -1),
            "ahead": below_and_beside(3, 5, 1),
            "pavement": PAVEMENT,
            "far side": FAR_SIDE,
        },
    },
}


def build(
    case: str = "reverse", elements: int = 50, stages: int = 2, start: tuple[float, float, float] = START
) -> pyo.ConcreteModel:
    """From the street into the slot in little time."""
    goal, obstacles = CASES[case]["goal"], CASES[case]["obstacles"]
    path = rcp.scenes.hybrid_a_star(
        start,
        goal,
        body=CAR,
        obstacles=obstacles,
        wheelbase=WHEELBASE,
        steering_limit=STEERING,
        bounds=BOX,
        clearance=CLEARANCE,
    )
    m = pyo.ConcreteModel(name="parking")
    m.drive = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(5, 120)), elements=elements, stages=stages)
    b.x = rcp.State(initial=start[0], final=goal[0], bounds=BOX[0])
    b.y = rcp.State(initial=start[1], final=goal[1], bounds=BOX[1])
    b.theta = rcp.State(initial=start[2], final=goal[2], bounds=(-pi, pi))
    b.v = rcp.State(initial=0, final=0, bounds=SPEED)
    b.steering = rcp.State(initial=0, bounds=(-STEERING, STEERING))
    b.acceleration = rcp.Control(bounds=(-ACCELERATION, ACCELERATION), parametrization="piecewise_constant")
    b.steering_rate = rcp.Control(bounds=(-STEERING_RATE, STEERING_RATE), parametrization="piecewise_constant")

    @b.ode
    def bicycle(b, t):
        return {
            b.x: b.v[t] * pyo.cos(b.theta[t]),
            b.y: b.v[t] * pyo.sin(b.theta[t]),
            b.theta: b.v[t] * pyo.tan(b.steering[t]) / WHEELBASE,
            b.v: b.acceleration[t],
            b.steering: b.steering_rate[t],
        }

    b.initialize(path.initial_guess(b, acceleration=ACCELERATION))
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"car": rcp.Body(CAR, pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]))},
        obstacles=obstacles,
        clearance=CLEARANCE,
    )
    m.cost = pyo.Objective(
        expr=b.duration + b.integral(lambda b, t: b.steering[t] ** 2 + b.acceleration[t] ** 2 + b.steering_rate[t] ** 2)
    )
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The car on its way into the slot, with speed and steering below."""
    above, below = figure.subfigures(2, 1, height_ratios=(2.2, 1))
    rcp.scenes.draw_avoidance(m.drive.avoid, snapshots=14, title=m.name, figure=above)
    m.drive.trajectory().plot({"v": "speed [m/s]", "steering": "steering [rad]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    run_example(
        build,
        draw,
        cases={name: {"case": name} for name in CASES},
        default="all",
        coarse={"elements": 40},
        size=(12, 8),
    )
