"""Mixed pairs ``l <= F <= u ⟂ H``: H >= 0 where F is at l, H <= 0 where F is at u, and 0 between."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
from pyomo import mpec

from pyrobocop_pyomo.complementarity import Complementarity, complements

from .entries import MpccProblem

MIXED = frozenset({"mixed form"})
CONVEX = frozenset({"mixed form", "convex"})


def _box_projection() -> Any:
    """The follower projects the leader's point on a box; the leader wants (1, 1) but pays for its own point."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var([1, 2], initialize=0), pyo.Var([1, 2], bounds=(-1, 0.5), initialize=0)
    m.cost = pyo.Objective(expr=sum((m.y[i] - 1) ** 2 + 0.1 * (m.x[i] - 2 * i) ** 2 for i in m.x))
    m.projection = Complementarity(
        [1, 2], rule=lambda m, i: complements(pyo.inequality(-1, m.y[i], 0.5), m.y[i] - m.x[i])
    )
    return m


def _saturated_controller() -> Any:
    """A gain is tuned while the actuator saturates at one: four samples of a first-order plant."""
    m = pyo.ConcreteModel()
    m.t = pyo.RangeSet(0, 4)
    m.gain = pyo.Var(bounds=(0, 5), initialize=1)
    m.x, m.u = pyo.Var(m.t, initialize=1), pyo.Var(m.t, bounds=(-1, 1), initialize=0)
    m.x[0].fix(3)
    m.plant = pyo.Constraint(
        m.t, rule=lambda m, t: m.x[t] == 0.9 * m.x[t - 1] + m.u[t - 1] if t > 0 else pyo.Constraint.Skip
    )
    m.u[4].fix(0)
    m.saturation = Complementarity(
        [0, 1, 2, 3], rule=lambda m, t: complements(pyo.inequality(-1, m.u[t], 1), m.u[t] + m.gain * m.x[t])
    )
    m.cost = pyo.Objective(expr=sum(m.x[t] ** 2 for t in m.t) + 0.1 * m.gain**2)
    return m


def _coulomb() -> Any:
    """A block is pushed: friction opposes sliding, at most 2; sticking up to there."""
    m = pyo.ConcreteModel()
    m.push, m.speed = pyo.Var(bounds=(-10, 10), initialize=0), pyo.Var(initialize=0)
    m.friction = pyo.Var(bounds=(-2, 2), initialize=0)
    m.balance = pyo.Constraint(expr=m.push + m.friction == 0.5 * m.speed)
    m.law = mpec.Complementarity(expr=mpec.complements(pyo.inequality(-2, m.friction, 2), m.speed))
    m.cost = pyo.Objective(expr=(m.speed - 1) ** 2 + 0.1 * m.push**2)
    return m


def _range_against_sign() -> Any:
    """A range with a sign on the other side: 0 <= F - 1 ⟂ H >= 0, and F <= 3 beside it."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=2), pyo.Var(initialize=1)
    m.cost = pyo.Objective(expr=(m.x - 4) ** 2 + (m.y - 1) ** 2)
    m.either = Complementarity(expr=complements(pyo.inequality(1, m.x, 3), m.y >= 0))
    return m


def _equation_against_free() -> Any:
    """An equation leaves its partner free: nothing to complement, and the equation has to hold."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0), pyo.Var(initialize=0)
    m.cost = pyo.Objective(expr=(m.x - 4) ** 2 + (m.y - 1) ** 2)
    m.row = Complementarity(expr=complements(m.x + m.y == 3, m.y - m.x))
    return m


def _traded_good() -> Any:
    """A price between a floor and a ceiling; outside, stocks are bought or rationed. The leader sets the tariff."""
    m = pyo.ConcreteModel()
    m.tariff, m.price = pyo.Var(bounds=(0, 4), initialize=1), pyo.Var(bounds=(2, 6), initialize=3)
    m.excess = pyo.Expression(expr=(3 * m.price - 4) - (14 - m.price - 2 * m.tariff))
    m.market = Complementarity(expr=complements(pyo.inequality(2, m.price, 6), m.excess))
    m.revenue = pyo.Objective(expr=m.tariff * (14 - m.price - 2 * m.tariff), sense=pyo.maximize)
    return m


def _median() -> Any:
    """mid(-1, x_i, 2) for ten values of a shifted sequence; its sum is to be 3 with a small shift."""
    m = pyo.ConcreteModel()
    index = range(10)
    m.shift, m.y = pyo.Var(initialize=0), pyo.Var(index, bounds=(-1, 2), initialize=0)
    m.median = Complementarity(
        index, rule=lambda m, i: complements(pyo.inequality(-1, m.y[i], 2), m.y[i] - (i - 6) - m.shift)
    )
    m.cost = pyo.Objective(expr=(sum(m.y.values()) - 3) ** 2 + 0.01 * m.shift**2)
    return m


PROBLEMS = (
    MpccProblem("projection on a box", _box_projection, 0.5, tags=CONVEX, source="written for this catalogue"),
    MpccProblem("saturated controller", _saturated_controller, 12.2313934, tags=MIXED,
                source="written for this catalogue"),
    MpccProblem("coulomb friction", _coulomb, 25 / 41, tags=CONVEX, source="written for this catalogue"),
    MpccProblem("range against a sign", _range_against_sign, 2.0, tags=CONVEX, source="by inspection",
                solution={"x": 3, "y": 0}),
    MpccProblem("equation against free", _equation_against_free, 2.0, tags=CONVEX, source="by inspection",
                solution={"x": 3, "y": 0}),
    MpccProblem("price between floor and ceiling", _traded_good, 361 / 24, tags=MIXED | {"maximise"},
                source="written for this catalogue"),
    MpccProblem("ten medians", _median, 0.01775805, tags=CONVEX, source="written for this catalogue"),
)  # fmt: skip
