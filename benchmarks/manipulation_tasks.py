"""Two tasks of manipulation, stated on phases: a gripper lifts a block, and a finger turns a knob stroke by stroke.

Tasks of these kinds are common where contact is planned or controlled (Li, Gong & Chalvatzaki, IMPACT,
arXiv:2605.09127); sizes and equations are ours. Contacts are soft, so that forces follow from the motion, and friction
is that of Coulomb: Stewart and Trinkle (1996), doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pyomo.environ as pyo
from contact_tasks import Task, distance, phase_of, squared_distance, states

import pyrobocop_pyomo as rcp

HALF_WIDTH, MASS, GRAVITY = 0.05, 0.2, 9.81
RADIUS, REACH = 0.1, 0.5


def coulomb(b, name: str, friction: float, pressed: str, slip: Callable) -> None:
    """Friction of a contact, ``{name}_forward - {name}_backward``, that pulls the body along where slip is positive."""
    forward, backward, size = f"{name}_forward", f"{name}_backward", f"{name}_slip"
    for part in (forward, backward, size):
        b.declare(part, rcp.Control(bounds=(0, None)))

    def law(b, t):
        along, against, speed = (b.component(part)[t] for part in (forward, backward, size))
        return [
            rcp.complements(along >= 0, speed - slip(b, t) >= 0),
            rcp.complements(against >= 0, speed + slip(b, t) >= 0),
            rcp.complements(speed >= 0, friction * b.component(pressed)[t] - along - against >= 0),
        ]

    b.complementarity(law, name=f"{name}_friction")


def gripper(b, start: Mapping[str, float]) -> None:
    """A block (x, z) on a table between two fingertips (x1, z1) and (x2, z2), which move as they are told."""
    states(b, start)
    for name in ("u1", "s1", "u2", "s2"):
        b.declare(name, rcp.Control(bounds=(-1, 1)))
    for name in ("n1", "n2", "table"):
        b.declare(name, rcp.Control(bounds=(0, 20)))
    for finger in "12":
        coulomb(
            b,
            f"f{finger}",
            0.8,
            f"n{finger}",
            lambda b, t, finger=finger: b.component(f"s{finger}")[t] - b.w[t],
        )

    @b.ode
    def motion(b, t):
        lift = b.f1_forward[t] - b.f1_backward[t] + b.f2_forward[t] - b.f2_backward[t]
        return {
            "x": b.v[t],
            "z": b.w[t],
            "v": (b.n1[t] - b.n2[t]) / MASS,
            "w": (lift + b.table[t]) / MASS - GRAVITY,
            "x1": b.u1[t],
            "z1": b.s1[t],
            "x2": b.u2[t],
            "z2": b.s2[t],
        }

    @b.complementarity
    def touches(b, t):
        return {
            "left": rcp.complements(b.n1[t] >= 0, b.x[t] - HALF_WIDTH - b.x1[t] + b.n1[t] / 100 >= 0),
            "right": rcp.complements(b.n2[t] >= 0, b.x2[t] - b.x[t] - HALF_WIDTH + b.n2[t] / 100 >= 0),
            "table": rcp.complements(b.table[t] >= 0, b.z[t] + b.table[t] / 1000 >= 0),
        }


def knob(b, start: Mapping[str, float]) -> None:
    """A knob at the angle q, and a fingertip at the angle p, which reaches 0.5 rad to both sides, and the height r."""
    states(b, start, p=(-REACH, REACH))
    b.turn, b.press = rcp.Control(bounds=(-2, 2)), rcp.Control(bounds=(-0.5, 0.5))
    b.n = rcp.Control(bounds=(0, 10))
    coulomb(b, "f", 0.6, "n", lambda b, t: RADIUS * (b.turn[t] - b.w[t]))

    @b.ode
    def motion(b, t):
        torque = RADIUS * (b.f_forward[t] - b.f_backward[t]) - 0.02 * b.w[t]
        return {"q": b.w[t], "w": torque / 0.01, "p": b.turn[t], "r": b.press[t]}

    b.complementarity(lambda b, t: rcp.complements(b.n[t] >= 0, b.r[t] + b.n[t] / 200 >= 0), name="touch")


GRIPPER_START = {"x": 0.0, "z": 0.0, "v": 0.0, "w": 0.0, "x1": -0.12, "z1": 0.0, "x2": 0.12, "z2": 0.0}
KNOB_START = {"q": 0.0, "w": 0.0, "p": 0.0, "r": 0.05}


def lift_block(case: int) -> pyo.ConcreteModel:
    """The block is grasped, lifted and held somewhere else."""
    random = np.random.default_rng(6000 + case)
    m = pyo.ConcreteModel(name=f"gripper {case}")
    b = phase_of(m, 40, 0.05)
    gripper(b, {**GRIPPER_START, "x1": -random.uniform(0.08, 0.2), "x2": random.uniform(0.08, 0.2)})
    m.goal = {"x": random.uniform(-0.2, 0.2), "z": random.uniform(0.1, 0.3), "v": 0.0, "w": 0.0}
    effort = sum(b.component(name)[t] ** 2 for name in ("u1", "s1", "u2", "s2", "n1", "n2") for t in b.points)
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + 1e-3 * effort)
    return m


def turn_knob(case: int) -> pyo.ConcreteModel:
    """The knob is turned further than one stroke of the finger reaches."""
    random = np.random.default_rng(7000 + case)
    m = pyo.ConcreteModel(name=f"knob {case}")
    b = phase_of(m, 60, 0.05)
    knob(b, {**KNOB_START, "p": random.uniform(-0.4, 0.4), "r": random.uniform(0.01, 0.08)})
    m.goal = {"q": random.choice([-1, 1]) * random.uniform(1.2, 2.0), "w": 0.0}
    effort = sum(b.component(name)[t] ** 2 for name in ("turn", "press", "n") for t in b.points)
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + 1e-3 * effort)
    return m


MANIPULATION = (
    Task("gripper", lift_block, distance(("x", "z", "v", "w"))),
    Task("knob", turn_knob, distance(("q", "w"))),
)
