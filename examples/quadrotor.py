"""Fly a quadrotor from rest to rest at another place, with little effort.

Position with z downwards, yaw, pitch and roll, velocity and body rates; the controls are thrust and three torques. The
published moments of inertia are ten times the values in the literature on this quadrotor, by a wrong exponent. They
are kept for comparison; ``build(inertia="literature")`` takes the smaller ones.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069; numbers of the quadrotor: Luukkonen, Modelling and control of quadcopter,
Aalto University 2011
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

MASS, GRAVITY = 0.468, 9.8
INERTIA = {"published": (4.856e-2, 4.856e-2, 8.801e-2), "literature": (4.856e-3, 4.856e-3, 8.801e-3)}
GOAL = (2.0, 2.0, 3.0)
CONTROLS = ("thrust", "roll_torque", "pitch_torque", "yaw_torque")
BODY = rcp.Polytope.box(0.45, 0.45, 0.08)  # only drawn


def build(elements: int = 200, stages: int = 1, scheme: str = "radau", inertia: str = "published") -> pyo.ConcreteModel:
    """To the goal in 6.6 seconds."""
    m = pyo.ConcreteModel(name="quadrotor")
    m.flight = b = rcp.PhaseBlock(duration=6.6, elements=elements, scheme=scheme, stages=stages)
    for name, goal in zip(("x", "y", "z"), GOAL, strict=True):
        b.declare(name, rcp.State(initial=0, final=goal))
    for name in ("yaw", "pitch", "roll", "v_x", "v_y", "v_z", "p", "q", "r"):
        b.declare(name, rcp.State(initial=0, final=0))
    for name in CONTROLS:
        b.declare(name, rcp.Control(bounds=(-10, 10)))
    i_x, i_y, i_z = INERTIA[inertia]

    @b.ode
    def rigid_body(b, t):
        yaw, pitch, roll, p, q, r = b.yaw[t], b.pitch[t], b.roll[t], b.p[t], b.q[t], b.r[t]
        lift = b.thrust[t] / MASS
        turn = q * pyo.sin(roll) + r * pyo.cos(roll)
        return {
            b.x: b.v_x[t],
            b.y: b.v_y[t],
            b.z: b.v_z[t],
            b.yaw: turn / pyo.cos(pitch),
            b.pitch: q * pyo.cos(roll) - r * pyo.sin(roll),
            b.roll: p + turn * pyo.tan(pitch),
            b.v_x: -lift * (pyo.sin(roll) * pyo.sin(yaw) + pyo.cos(roll) * pyo.cos(yaw) * pyo.sin(pitch)),
            b.v_y: -lift * (pyo.cos(yaw) * pyo.sin(roll) - pyo.cos(roll) * pyo.sin(yaw) * pyo.sin(pitch)),
            b.v_z: GRAVITY - lift * pyo.cos(roll) * pyo.cos(pitch),
            b.p: ((i_y - i_z) * q * r + b.roll_torque[t]) / i_x,
            b.q: ((i_z - i_x) * p * r + b.pitch_torque[t]) / i_y,
            b.r: ((i_x - i_y) * p * q + b.yaw_torque[t]) / i_z,
        }

    def cost(b, t):
        from_goal = sum((position[t] - goal) ** 2 for position, goal in zip((b.x, b.y, b.z), GOAL, strict=True))
        return from_goal + sum(getattr(b, name)[t] ** 2 for name in CONTROLS)

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The flight with z upwards, and the angles and controls over time."""
    trajectory = m.flight.trajectory()
    flip = np.diag([1.0, -1.0, -1.0])  # half a turn about x: z upwards
    angles = np.column_stack([trajectory.yaw, trajectory.pitch, trajectory.roll])
    rotation = flip @ np.array([turned(*row) for row in angles]) @ flip
    place = np.column_stack([trajectory.x, trajectory.y, trajectory.z]) @ flip
    left, right = figure.subfigures(1, 2, width_ratios=(1.3, 1))
    path = rcp.scenes.BodyPath(BODY, rotation, place, "quadrotor")
    rcp.scenes.draw_scene(trajectory.time, [path], snapshots=9, title=m.name, figure=left)
    labels = {"roll": "roll [rad]", "pitch": "pitch [rad]", "thrust": "thrust [N]", "pitch_torque": "pitch [N m]"}
    trajectory.plot(labels, figure=right)


def turned(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Rotation matrix of the three angles, about z, then y, then x."""
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(angle), np.sin(angle)) for angle in (yaw, pitch, roll))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


if __name__ == "__main__":
    from run_example import run_example

    cases = {"published": {}, "literature": {"inertia": "literature"}}
    run_example(build, draw, cases=cases, default="published", coarse={"elements": 25}, size=(10, 5))
