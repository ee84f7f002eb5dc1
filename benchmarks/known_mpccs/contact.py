"""Contact and friction at rest or over one step, and mechanisms with stops."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

from pyrobocop_pyomo.complementarity import Complementarity, complements

from .entries import MpccProblem, state_pairs

CONTACT = frozenset({"contact"})
CONVEX = frozenset({"contact", "convex"})
OWN = "written for this catalogue"
STEWART = "kind: Stewart & Trinkle, Int. J. Numer. Methods Eng. 39 (1996), doi:10.1002/(SICI)1097-0207(19960815)39:15"
STEWART += "<2673::AID-NME972>3.0.CO;2-I"


def _gripper() -> Any:
    """Two fingers on springs squeeze a box of weight 2 by friction; the smaller squeeze is the better."""
    m = pyo.ConcreteModel()
    m.reach = pyo.Var([1, 2], bounds=(0, 3), initialize=0.5)
    m.normal, m.slip = pyo.Var([1, 2], bounds=(0, None), initialize=1), pyo.Var([1, 2], bounds=(0, None), initialize=0)
    m.lift = pyo.Var([1, 2], initialize=0)
    m.sink = pyo.Var(bounds=(0, 5), initialize=0)
    m.balance = pyo.Constraint(expr=m.normal[1] == m.normal[2])
    m.weight = pyo.Constraint(expr=m.lift[1] + m.lift[2] == 2)
    pairs = []
    for i in m.reach:
        pairs.append((m.normal[i], 1 - m.reach[i] + 0.2 * m.normal[i]))
        pairs.append((m.slip[i], 0.5 * m.normal[i] - m.lift[i]))
    m.fall = pyo.Constraint([1, 2], rule=lambda m, i: m.slip[i] == m.sink)
    state_pairs(m, pairs)
    m.cost = pyo.Objective(expr=sum(m.reach[i] ** 2 for i in m.reach) + 10 * m.sink)
    return m


def _sliding_step() -> Any:
    """One step of a block with friction: which push brings it to rest at 1, and costs little?"""
    m = pyo.ConcreteModel()
    m.push = pyo.Var(bounds=(-20, 20), initialize=0)
    m.v = pyo.Var(initialize=1)
    m.right, m.left = pyo.Var(bounds=(0, None), initialize=0), pyo.Var(bounds=(0, None), initialize=0)
    m.speed = pyo.Var(bounds=(0, None), initialize=0)
    m.motion = pyo.Constraint(expr=m.v == 3 + 0.1 * (m.push + m.right - m.left))
    state_pairs(m, [(m.right, m.speed + m.v), (m.left, m.speed - m.v), (m.speed, 8 - m.right - m.left)])
    m.cost = pyo.Objective(expr=10 * (m.v - 1) ** 2 + 0.01 * m.push**2)
    return m


def _bouncing_mass() -> Any:
    """Three implicit steps of a falling mass: the throw that ends at height 0.2 with a soft landing."""
    m = pyo.ConcreteModel()
    h, steps = 0.2, range(1, 5)
    m.throw = pyo.Var(bounds=(-5, 5), initialize=0)
    m.height, m.speed = pyo.Var(range(5), initialize=0.5), pyo.Var(range(5), initialize=0)
    m.force = pyo.Var(steps, bounds=(0, None), initialize=0)
    m.height[0].fix(0.5)
    m.start = pyo.Constraint(expr=m.speed[0] == m.throw)
    m.momentum = pyo.Constraint(steps, rule=lambda m, k: m.speed[k] == m.speed[k - 1] + h * (m.force[k] - 9.81))
    m.position = pyo.Constraint(steps, rule=lambda m, k: m.height[k] == m.height[k - 1] + h * m.speed[k])
    m.contact = Complementarity(steps, rule=lambda m, k: complements(m.height[k] >= 0, m.force[k] >= 0))
    m.cost = pyo.Objective(expr=100 * (m.height[4] - 0.2) ** 2 + 0.01 * m.throw**2 + 1e-3 * m.force[4] ** 2)
    return m


def _stack() -> Any:
    """Three blocks in a row between two walls are pushed apart by one actuator; gaps close one by one."""
    m = pyo.ConcreteModel()
    m.push = pyo.Var(bounds=(0, 10), initialize=1)
    m.place = pyo.Var([1, 2, 3], initialize=0)
    m.contact = pyo.Var(range(4), bounds=(0, None), initialize=0)
    gap = [m.place[1] + 0.5, m.place[2] - m.place[1] + 0.3, m.place[3] - m.place[2] + 0.2, 1 - m.place[3]]
    forces = {1: m.push, 2: 0.0, 3: 0.0}
    m.balance = pyo.Constraint(
        [1, 2, 3], rule=lambda m, i: 2 * m.place[i] == forces[i] + m.contact[i - 1] - m.contact[i]
    )
    state_pairs(m, [(m.contact[i], gap[i]) for i in range(4)])
    m.cost = pyo.Objective(expr=(m.place[3] - 0.8) ** 2 + 0.001 * m.push**2)
    return m


def _four_point_foot() -> Any:
    """A foot on four unilateral springs carries a load; where to put it so that one given corner bears nothing?"""
    m = pyo.ConcreteModel()
    corners = {1: (1, 1), 2: (-1, 1), 3: (-1, -1), 4: (1, -1)}
    m.pull = pyo.Var(["x", "y"], bounds=(-0.9, 0.9), initialize=0)
    m.pose = pyo.Var(["z", "roll", "pitch"], initialize=0)
    m.force = pyo.Var(corners, bounds=(0, None), initialize=1)
    for name, weights, total in (
        ("vertical", dict.fromkeys(corners, 1), 4.0),
        ("about_y", {i: c[0] for i, c in corners.items()}, 4.0 * m.pull["x"]),
        ("about_x", {i: c[1] for i, c in corners.items()}, 4.0 * m.pull["y"]),
    ):
        m.add_component(name, pyo.Constraint(expr=sum(w * m.force[i] for i, w in weights.items()) == total))
    depth = {i: m.pose["z"] + c[0] * m.pose["roll"] + c[1] * m.pose["pitch"] for i, c in corners.items()}
    state_pairs(m, [(m.force[i], 0.5 * m.force[i] - depth[i]) for i in corners])
    m.cost = pyo.Objective(expr=m.force[3] ** 2 + 0.1 * m.pull["x"] ** 2 + 0.1 * (m.pull["y"] - 0.1) ** 2)
    return m


def _outrata_like() -> Any:
    """Two coordinates of a tool between a ramp and a curved wall that both move with a setting."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 10), initialize=1), pyo.Var([1, 2], initialize=1)
    m.force = pyo.Var([3, 4], bounds=(0, None), initialize=0)
    x, y, f = m.x, m.y, m.force
    m.first = pyo.Constraint(expr=(1 + 0.2 * x) * y[1] - (3 + 1.333 * x) - 0.333 * f[3] + 2 * y[1] * f[4] == 0)
    m.second = pyo.Constraint(expr=(1 + 0.1 * x) * y[2] - x + f[3] + 2 * y[2] * f[4] == 0)
    state_pairs(m, [(f[3], 0.333 * y[1] - y[2] + 1 - 0.1 * x), (f[4], 9 + 0.1 * x - y[1] ** 2 - y[2] ** 2)])
    m.cost = pyo.Objective(expr=0.5 * ((y[1] - 3) ** 2 + (y[2] - 4) ** 2))
    return m


PROBLEMS = (
    MpccProblem("gripper", _gripper, 3.92, tags=CONVEX, source=OWN),
    MpccProblem("sliding step", _sliding_step, 1.3090909, tags=CONVEX, source=f"{OWN}; {STEWART}"),
    MpccProblem("bouncing mass", _bouncing_mass, 0.205176941, tags=CONVEX, source=f"{OWN}; {STEWART}"),
    MpccProblem("blocks in a row", _stack, 0.03710425, tags=CONVEX, source=OWN),
    MpccProblem("four-point foot", _four_point_foot, 27 / 700, tags=CONVEX, source=OWN),
    MpccProblem("outrata31", _outrata_like, 3.2077, tags=CONTACT, source="MacMPEC (S. Leyffer), outrata31; Outrata, "
                "SIAM J. Optim. 4 (1994)", notes="The state's two equations are rows here."),
)  # fmt: skip
