"""How far relaxed solutions are from the solution, as delta shrinks: the orders that the docstrings state."""

from __future__ import annotations

import math

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import (
    AugmentedLagrangian,
    ChenHarkerKanzowSmale,
    Complementarity,
    FischerBurmeister,
    KanzowSchwartz,
    LinFukushima,
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
    # No bounds on the variables: each relaxation decides itself what keeps the signs.
    m.a, m.b = pyo.Var(initialize=start[0]), pyo.Var(initialize=start[1])
    m.pair = Complementarity(expr=complements(m.a >= 0, m.b >= 0))
    m.cost = pyo.Objective(expr=cost(m))
    return m


def distance(problem, relaxation, delta):
    m, solution = problem()
    result = rcp.solve(
        m, relaxation=relaxation, schedule=rcp.relaxations.Fixed(delta), backend="asl", options=OPTIONS, polish=False
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
        (Scholtes(equality=True), 1.0, 0.5),
        (FischerBurmeister(), 1.0, 0.5),
        (FischerBurmeister(equality=True), 1.0, 0.5),
        (ChenHarkerKanzowSmale(), 1.0, 0.5),
        (ChenHarkerKanzowSmale(equality=True), 1.0, 0.5),
        (KanzowSchwartz(), 1.0, 1.0),
        (LinFukushima(), 2.0, 1.0),
        (AugmentedLagrangian(), 1.0, None),
    ],
    ids=str,
)
def test_the_order_in_delta_is_the_stated_one(relaxation, strict, corner):
    deltas = [1e-2, 3e-3, 1e-3, 3e-4]
    assert observed_order(held_by_the_product, relaxation, deltas) == pytest.approx(strict, abs=0.1)
    if corner is not None:
        assert observed_order(biactive, relaxation, deltas) == pytest.approx(corner, abs=0.1)


def test_a_sign_that_is_not_kept_is_missed_by_delta():
    assert observed_order(held_by_the_sign, LinFukushima(), [1e-2, 3e-3, 1e-3]) == pytest.approx(1.0, abs=0.1)
    assert distance(held_by_the_sign, Scholtes(), 1e-2) < 1e-6


def test_a_rounded_corner_is_exact_beyond_delta_and_linear_at_the_corner():
    assert distance(held_by_the_product, SteffensenUlbrich(), 0.5) < 1e-5
    assert observed_order(biactive, SteffensenUlbrich(), [1e-2, 3e-3, 1e-3]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("choice", [Penalty(), rcp.relaxations.Elastic()], ids=str)
def test_a_price_is_exact_where_it_exceeds_the_multiplier(choice):
    """At (0, 2) the product has the multiplier 1: the objective falls by 2 per unit of a, the product grows by 2."""
    assert distance(held_by_the_product, choice, 0.5) < 1e-6
    assert distance(held_by_the_product, choice, 2.0) > 1e-2


@pytest.mark.parametrize("choice", ["penalty", "augmented-lagrangian", "elastic", "scholtes"])
@pytest.mark.parametrize("strategies", [None, "elastic"])
def test_a_model_without_an_objective_is_solved(choice, strategies):
    m = program(lambda m: m.a, (1.0, 2.0))
    m.del_component("cost")
    m.line = pyo.Constraint(expr=m.a + 2 * m.b == 3)
    m.itself = Complementarity(expr=complements(m.a - 3 >= 0, m.a - 3 >= 0))
    result = rcp.solve(m, relaxation=choice, strategies=strategies, backend="asl")
    result.raise_for_status()
    assert result.objective == 0
    assert (m.a.value, m.b.value) == pytest.approx((3.0, 0.0), abs=1e-6)


def test_multipliers_make_the_products_vanish_at_a_constant_delta():
    m, solution = held_by_the_product()
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    relax.apply_to(m, relaxation="augmented-lagrangian", delta=1.0)
    errors = []
    for _ in range(12):
        pyo.SolverFactory("pyrobocop.ipopt").solve(m)
        errors.append(math.dist((m.a.value, m.b.value), solution))
        relax.update_parameters(m, 1.0)
    assert errors[0] > 1e-2
    assert errors[-1] < 1e-3 * errors[0]


@pytest.mark.parametrize(
    ("problem", "bound", "slack"), [(held_by_the_product, 1e-3, 1e-1), (held_by_the_sign, 1e-1, 1e-3)]
)
def test_of_a_two_sided_relaxation_what_decides_goes_on_and_the_other_one_stays(problem, bound, slack):
    m, solution = problem()
    m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    relax.apply_to(m, relaxation="two-sided", delta=1e-1)
    for delta in (1e-2, 1e-3):
        pyo.SolverFactory("pyrobocop.ipopt").solve(m)
        relax.update_parameters(m, delta)
    product, sign, _ = relax.rows_of(m.pair)
    assert product.ub == bound
    assert sign.lb == -slack
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    assert math.dist((m.a.value, m.b.value), solution) < 2e-3
    relax.reset_parameters(m, 0.5)
    assert (product.ub, sign.lb) == (0.5, -0.5)


def test_without_multipliers_a_two_sided_relaxation_asks_for_them():
    m, _ = held_by_the_sign()
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    relax.apply_to(m, relaxation="two-sided")
    with pytest.raises(ValueError, match=r"'toy': TwoSided.*no suffix 'dual'.*Suffix\.IMPORT"):
        relax.update_parameters(m, 1e-3)
