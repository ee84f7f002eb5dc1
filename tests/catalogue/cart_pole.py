"""The cart with a pole of ModelingToolkit.jl's issue 5076: upright at rest after five seconds, by 125 steps."""

from typing import Any

import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar, Integral

CART, POLE, LENGTH, GRAVITY = 1.0, 0.2, 0.5, 9.81


def cart_pole() -> Any:
    """States as in the issue: position, angle from hanging, and their rates; a bounded force, least effort."""
    m = pyo.ConcreteModel(name="cart with a pole")
    m.t = ContinuousSet(bounds=(0, 5))
    m.x, m.angle, m.v, m.w = (pyo.Var(m.t, initialize=0) for _ in range(4))
    m.force = pyo.Var(m.t, bounds=(-10, 10), initialize=0)
    m.dx, m.dangle, m.dv, m.dw = (DerivativeVar(state) for state in (m.x, m.angle, m.v, m.w))
    m.moving = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.v[t])
    m.turning = pyo.Constraint(m.t, rule=lambda m, t: m.dangle[t] == m.w[t])
    m.cart = pyo.Constraint(
        m.t,
        rule=lambda m, t: (
            (CART + POLE) * m.dv[t]
            + POLE * LENGTH * (m.dw[t] * pyo.cos(m.angle[t]) - m.w[t] ** 2 * pyo.sin(m.angle[t]))
            == m.force[t]
        ),
    )
    m.pole = pyo.Constraint(
        m.t, rule=lambda m, t: m.dv[t] * pyo.cos(m.angle[t]) + LENGTH * m.dw[t] == -GRAVITY * pyo.sin(m.angle[t])
    )
    for state, last in ((m.x, 0.0), (m.angle, 3.141592653589793), (m.v, 0.0), (m.w, 0.0)):
        state[0].fix(0)
        state[5].fix(last)
    m.effort = Integral(m.t, rule=lambda m, t: m.force[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    return m
