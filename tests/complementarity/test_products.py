"""Rows that say that a product is zero, and no other row is taken for one."""

from __future__ import annotations

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.switched_products import is_zero_product


def switched() -> pyo.ConcreteModel:
    """Each row but the last two says that a product is zero, of which a sign is known."""
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, 5), initialize=1.0), pyo.Var(bounds=(-3, 0), initialize=-1.0)
    m.x, m.y = pyo.Var(initialize=0.3), pyo.Var(initialize=0.4)
    m.scale = pyo.Param(initialize=3.0, mutable=True)
    m.rows = pyo.ConstraintList()
    m.rows.add(m.a * (m.x - m.y) == 0)
    m.rows.add(m.scale * (m.x * m.a) == 0)
    m.rows.add(-2 * m.a * m.b == 0)
    m.rows.add(m.x**2 * m.a <= 0)
    m.rows.add(m.x * m.y == 0)
    m.rows.add(m.a * m.x <= 1)
    m.cost = pyo.Objective(expr=(m.a - 1) ** 2 + (m.b + 1) ** 2 + (m.x - 2) ** 2 + (m.y - 1) ** 2)
    return m


def test_rows_are_told_by_their_form() -> None:
    """What may have any sign on both sides is named too: which pair is meant, the user knows."""
    assert list(map(is_zero_product, switched().rows.values())) == [True, True, True, True, True, False]


def test_a_diagnosis_names_it_wherever_it_stands_in_a_rule() -> None:
    m = pyo.ConcreteModel()
    m.b = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x, b.u, b.r = rcp.State(initial=0.0), rcp.Control(), rcp.Control(bounds=(0, 1))
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.constraint(lambda b, t: {"limit": b.u[t] <= 1, "switch": b.r[t] * (b.u[t] - 1) == 0}, name="rows")
    m.cost = pyo.Objective(expr=b.final_time - b.x[b.final_time])
    found = [finding for finding in rcp.diagnose(m).findings if "product is zero" in finding.message]
    assert ["rcp.either_zero(" in finding.remedy and finding.components == ("b.rows",) for finding in found] == [True]
