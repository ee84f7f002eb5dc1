"""A quadrotor flies through a window in a wall that is too narrow for it: it has to roll.

The body is a box of 0.6 m x 0.6 m x 0.2 m. Through ``narrow``, 0.6 m wide and 0.8 m high, it fits only on its side;
through ``low``, 0.8 m wide and 0.5 m high, upright, with little room. ``three`` has three windows of 0.9 m x 0.6 m
behind each other, none in line with the next. A wall is 0.1 m thick: a plan that keeps its distance only at the points
of a mesh may jump straight through it. The initial guess is a straight line, for ``narrow`` rolled to one side in the
middle: rolling left is as good as rolling right, and from upright neither lowers the objective. For ``three`` the line
runs into walls, and `solve` leads it through the windows.

The states are position, roll, pitch and yaw, velocity and body rates; the controls are the thrusts of four rotors.
Rigid-body model: Mahony, Kumar & Corke, Multirotor aerial vehicles, IEEE Robotics & Automation Magazine 19 (2012),
doi:10.1109/MRA.2012.2206474
"""

from __future__ import annotations

from math import pi, sin

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

BODY = rcp.Polytope.box(0.6, 0.6, 0.2)
CLEARANCE = 0.04
MASS, GRAVITY, INERTIA = 1.0, 9.81, (0.012, 0.012, 0.02)
ARM, DRAG, MOST_THRUST = 0.2, 0.02, 6.0  # of a rotor: lever in metres, torque per thrust in metres, newtons
THICKNESS, WALL = 0.1, 3.0  # of the wall: depth, and half of its width and height
# Width and height of each, and where its middle is; by the middle's distance ahead.
WINDOWS = {
    "narrow": {0.0: (0.6, 0.8, 0.0, 0.0)},
    "low": {0.0: (0.8, 0.5, 0.0, 0.0)},
    "three": {-2.0: (0.9, 0.6, 0.5, 0.3), 0.0: (0.9, 0.6, -0.5, -0.2), 2.0: (0.9, 0.6, 0.4, 0.3)},
}
ROLL = {"narrow": 0.9}  # of the initial guess, in the middle
ENDS = {"three": ((-3.5, 0.0, 0.0), (3.5, 0.0, 0.0))}
START, GOAL = (-1.5, 0.4, -0.3), (1.5, -0.4, 0.3)


def wall(x: float, width: float, height: float, y: float, z: float) -> dict[str, rcp.Polytope]:
    """Four boxes around an opening with its middle at (y, z)."""
    left, right, top, bottom = y + width / 2, y - width / 2, z + height / 2, z - height / 2
    ends = {
        "left": (left, WALL, -WALL, WALL),
        "right": (-WALL, right, -WALL, WALL),
        "above": (right, left, top, WALL),
        "below": (right, left, -WALL, bottom),
    }
    return {
        side: rcp.Polytope.box(
            THICKNESS, y_high - y_low, z_high - z_low, center=(x, (y_low + y_high) / 2, (z_low + z_high) / 2)
        )
        for side, (y_low, y_high, z_low, z_high) in ends.items()
    }


def walls(case: str) -> dict[str, rcp.Polytope]:
    """The boxes around each of its windows."""
    return {
        f"{side} of window {number}": box
        for number, (x, window) in enumerate(WINDOWS[case].items(), start=1)
        for side, box in wall(x, *window).items()
    }


def build(case: str = "narrow", elements: int = 24, stages: int = 3) -> pyo.ConcreteModel:
    """From hovering to hovering on the other side, in little time and with little effort."""
    m = pyo.ConcreteModel(name="quadrotor")
    m.flight = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(0.5, 6), initial_guess=2.5), elements=elements, stages=stages
    )
    ends = zip(("x", "y", "z"), *ENDS.get(case, (START, GOAL)), strict=True)
    for name, start, goal in ends:
        far = max(2.0, abs(start) + 0.5)  # in no direction beyond the walls
        b.declare(name, rcp.State(initial=start, final=goal, bounds=(-far, far)))
    for name, largest in {"roll": 1.5, "pitch": 1.2, "yaw": 1.5}.items():
        b.declare(name, rcp.State(initial=0, final=0, bounds=(-largest, largest)))
    for name, largest in {"v_x": 5, "v_y": 5, "v_z": 5, "p": 12, "q": 12, "r": 12}.items():
        b.declare(name, rcp.State(initial=0, final=0, bounds=(-largest, largest)))
    for rotor in ("front", "left", "back", "right"):
        thrust = rcp.Control(
            bounds=(0, MOST_THRUST), initial_guess=MASS * GRAVITY / 4, parametrization="piecewise_constant"
        )
        b.declare(rotor, thrust)
    b.ode(rigid_body)
    b.initialize_straight_lines()
    b.initialize(roll=lambda t: ROLL.get(case, 0.0) * sin(pi * t))

    def pose(b, t):
        return rcp.spatial_pose((b.x[t], b.y[t], b.z[t]), euler=(b.roll[t], b.pitch[t], b.yaw[t]))

    m.flight.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"quadrotor": rcp.Body(BODY, pose=pose)},
        obstacles=walls(case),
        clearance=CLEARANCE,
    )
    hover = MASS * GRAVITY / 4
    m.cost = pyo.Objective(
        expr=b.duration
        + b.integral(
            lambda b, t: (
                0.01 * sum((thrust[t] - hover) ** 2 for thrust in (b.front, b.left, b.back, b.right))
                + 0.01 * (b.p[t] ** 2 + b.q[t] ** 2 + b.r[t] ** 2)
            )
        )
    )
    return m


def rigid_body(b, t):
    """Newton and Euler; x points forward, y to the left, z up."""
    sin, cos, tan = pyo.sin, pyo.cos, pyo.tan
    roll, pitch, yaw, p, q, r = (signal[t] for signal in (b.roll, b.pitch, b.yaw, b.p, b.q, b.r))
    thrust = (b.front[t] + b.left[t] + b.back[t] + b.right[t]) / MASS
    torque = (
        ARM * (b.left[t] - b.right[t]),
        ARM * (b.back[t] - b.front[t]),
        DRAG * (b.left[t] + b.right[t] - b.front[t] - b.back[t]),
    )
    i_x, i_y, i_z = INERTIA
    return {
        b.x: b.v_x[t],
        b.y: b.v_y[t],
        b.z: b.v_z[t],
        b.v_x: thrust * (cos(yaw) * sin(pitch) * cos(roll) + sin(yaw) * sin(roll)),
        b.v_y: thrust * (sin(yaw) * sin(pitch) * cos(roll) - cos(yaw) * sin(roll)),
        b.v_z: thrust * cos(pitch) * cos(roll) - GRAVITY,
        b.roll: p + tan(pitch) * (q * sin(roll) + r * cos(roll)),
        b.pitch: q * cos(roll) - r * sin(roll),
        b.yaw: (q * sin(roll) + r * cos(roll)) / cos(pitch),
        b.p: (torque[0] + (i_y - i_z) * q * r) / i_x,
        b.q: (torque[1] + (i_z - i_x) * r * p) / i_y,
        b.r: (torque[2] + (i_x - i_y) * p * q) / i_z,
    }


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The flight, and the angles over time."""
    above, below = figure.subfigures(2, 1, height_ratios=(2.4, 1))
    far = m.flight.x[m.flight.time.first()].ub
    view = [(-far, -1.2, -1.2), (far, 1.2, 1.2)]
    rcp.scenes.draw_avoidance(m.flight.avoid, snapshots=8, view=view, title=m.name, figure=above)
    m.flight.trajectory().plot({"roll": "roll [rad]", "pitch": "pitch [rad]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    run_example(
        build,
        draw,
        cases={name: {"case": name, "elements": 48 if name == "three" else 24} for name in WINDOWS},
        default="all",
        coarse={"elements": 16},
        size=(12, 8),
    )
