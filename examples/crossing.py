"""Two cars meet at a crossing, both at the same moment: one has to give way.

The problem treats both alike. In the initial guess both drive straight on at constant speed and overlap in the middle
of the crossing, and a solver that starts from there has no reason to prefer one side: a seeded random direction
chooses, once, the side on which they pass each other. The corners of the streets are endless wedges.

Both are points with a heading, a speed and a curvature, in one phase: the distance between two bodies is evaluated
at the same time for both.
"""

from __future__ import annotations

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

CAR = rcp.Polytope.box(4.4, 1.8)
CLEARANCE, STREET, APPROACH, DURATION = 0.3, 7.0, 20.0, 8.0
# Where each comes from and goes to: (x, y, heading).
ROUTES = {
    "east": ((-APPROACH, 0, 0), (APPROACH, 0, 0)),
    "north": ((0, -APPROACH, pi / 2), (0, APPROACH, pi / 2)),
}


def corners() -> dict[str, rcp.Polytope]:
    """What is not street: a wedge in each quadrant."""
    half = STREET / 2
    signs = {"north-east": (1, 1), "north-west": (-1, 1), "south-west": (-1, -1), "south-east": (1, -1)}
    return {
        name: rcp.Polytope.from_halfspaces([[-x, 0], [0, -y]], [-half, -half], bounded=False)
        for name, (x, y) in signs.items()
    }


def build(elements: int = 40, stages: int = 2) -> pyo.ConcreteModel:
    """Both across in eight seconds, smoothly."""
    m = pyo.ConcreteModel(name="crossing")
    m.traffic = b = rcp.PhaseBlock(duration=DURATION, elements=elements, stages=stages)
    cruise = 2 * APPROACH / DURATION
    for car, (start, goal) in ROUTES.items():
        for name, first, last in zip(("x", "y", "theta"), start, goal, strict=True):
            b.declare(f"{name}_{car}", rcp.State(initial=first, final=last))
        b.declare(f"v_{car}", rcp.State(initial=cruise, final=cruise, bounds=(0, 2 * cruise)))
        b.declare(f"curvature_{car}", rcp.Control(bounds=(-0.2, 0.2), parametrization="piecewise_linear"))
        b.declare(f"acceleration_{car}", rcp.Control(bounds=(-4, 4), parametrization="piecewise_linear"))

    @b.ode
    def unicycles(b, t):
        rates = {}
        for car in ROUTES:
            x, y, theta, v = (signals(b, name, car) for name in ("x", "y", "theta", "v"))
            rates |= {
                x: v[t] * pyo.cos(theta[t]),
                y: v[t] * pyo.sin(theta[t]),
                theta: v[t] * signals(b, "curvature", car)[t],
                v: signals(b, "acceleration", car)[t],
            }
        return rates

    b.initialize_straight_lines()
    m.traffic.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={car: rcp.Body(CAR, pose=pose_of(car)) for car in ROUTES},
        obstacles=corners(),
        clearance=CLEARANCE,
    )
    m.discomfort = pyo.Objective(
        expr=b.integral(
            lambda b, t: sum(
                signals(b, "acceleration", car)[t] ** 2 + (20 * signals(b, "curvature", car)[t]) ** 2 for car in ROUTES
            )
        )
    )
    return m


def signals(b, name: str, car: str):
    """The variables of one car."""
    return getattr(b, f"{name}_{car}")


def pose_of(car: str):
    """The pose rule of one car."""

    def pose(b, t):
        return rcp.planar_pose(*(signals(b, name, car)[t] for name in ("x", "y", "theta")))

    return pose


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Both cars, and their speeds over time."""
    left, right = figure.subfigures(1, 2, width_ratios=(1.4, 1))
    rcp.scenes.draw_avoidance(m.traffic.avoid, snapshots=9, title=m.name, figure=left)
    m.traffic.trajectory().plot({f"v_{car}": f"speed {car} [m/s]" for car in ROUTES}, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    run_example(build, draw, cases={"meet": {}}, default="meet", coarse={"elements": 20}, size=(11, 6))
