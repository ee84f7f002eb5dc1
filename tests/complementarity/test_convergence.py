"""How far relaxed solutions are from the solution, as delta shrinks: the orders that the docstrings state."""

import math

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import (
    ChenHarkerKanzowSmale,
    Complementarity,
    Elastic,
    FischerBurmeister,
    KanzowSchwartz,
    Penalty,
    Scholtes,
    SteffensenUlbrich,
    complements,
)

pytestmark = pytest.mark.asl

OPTIONS = {"tol": 1e-12, "bound_relax_factor": 0.0}


def held_by_the_product():
    """The pair keeps a from 1 where b = 2: strictly complementary, its multiplier negative; solution (0, 2)."""
    return program(lambda m: (m.a - 1) ** 2 + 4 * (m.b - 2) ** 2, (0.1, 2.0)), (0.0, 2.0)


def held_by_the_sign():
    """The sign keeps a from -1 and the pair does nothing: strictly complementary; solution (0, 2)."""
    return program(lambda m: (m.a + 1) ** 2 + (m.b - 2) ** 2, (0.1, 2.0)), (0.0, 2.0)


def biactive():
    """Both sides are pulled up through b = a: biactive; solution (0, 0)."""
    m = program(lambda m: -m.a - m.b + (m.a - m.b) ** 2, (0.1, 0.1))
    m.same = pyo.Constraint(expr=m.a == m.b)
    return m, (0.0, 0.0)


def program(cost, start):
    m = pyo.ConcreteModel(name="toy")
    m.a, m.b = pyo.Var(initialize=start[0]), pyo.Var(initialize=start[1])
    m.pair = Complementarity(expr=complements(m.a >= 0, m.b >= 0))
    m.cost = pyo.Objective(expr=cost(m))
    return m


def distance(problem, relaxation, delta):
    m, solution = problem()
    result = rcp.solve(
        m,
        strategies=rcp.Strategy(schedule=rcp.relaxations.Fixed(delta), relaxation=relaxation, polish=False),
        backend="asl",
        options=OPTIONS,
    )
    assert result.constraint_violation <= 2 * delta + 1e-10
    return math.dist((m.a.value, m.b.value), solution)


def observed_order(problem, relaxation, deltas):
    errors = [distance(problem, relaxation, delta) for delta in deltas]
    return np.polyfit(np.log(deltas), np.log(errors), 1)[0]


@pytest.mark.parametrize(
    ("relaxation", "strict", "corner"),
    [
        (Scholtes(), 1.0, 0.5),
        (FischerBurmeister(), 1.0, 0.5),
        (ChenHarkerKanzowSmale(), 1.0, 0.5),
        (KanzowSchwartz(), 1.0, 1.0),
    ],
    ids=str,
)
def test_the_order_in_delta_is_the_stated_one(relaxation, strict, corner):
    deltas = [1e-2, 3e-3, 1e-3, 3e-4]
    assert observed_order(held_by_the_product, relaxation, deltas) == pytest.approx(strict, abs=0.1)
    assert observed_order(biactive, relaxation, deltas) == pytest.approx(corner, abs=0.1)


def test_a_sign_is_kept_exactly():
    assert distance(held_by_the_sign, Scholtes(), 1e-2) < 1e-6


def test_a_rounded_corner_is_exact_beyond_delta_and_linear_at_the_corner():
    assert distance(held_by_the_product, SteffensenUlbrich(), 0.5) < 1e-5
    assert observed_order(biactive, SteffensenUlbrich(), [1e-2, 3e-3, 1e-3]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("choice", [Penalty(), Elastic()], ids=str)
def test_a_price_is_exact_where_it_exceeds_the_multiplier(choice):
    """At (0, 2) the product has the multiplier 1: the objective falls by 2 per unit of a, the product grows by 2."""
    assert distance(held_by_the_product, choice, 0.5) < 1e-6
    assert distance(held_by_the_product, choice, 2.0) > 1e-2
