"""The numbered formulas of relaxations, groupings, lifting and schedules, evaluated against the code."""

import math

import numpy as np
import pyomo.environ as pyo
import pytest
from complementarity.harness import stages
from hypothesis import assume, given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import Elastic, PerElement, lifted_pairs_of, relaxation_rows_of, shifted_rows_of
from pyrobocop_pyomo.complementarity.relaxations import RELAXATIONS

sides = st.floats(-2, 5)
deltas = st.floats(1e-3, 1.0)


def relax():
    return pyo.TransformationFactory("pyrobocop.relax_complementarity")


def pair(**options):
    """A pair whose signs no bound keeps, so that all that is generated shows; relaxed."""
    m = pyo.ConcreteModel(name="one pair")
    m.a, m.b = pyo.Var(initialize=1.0), pyo.Var(initialize=1.0)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.a >= 0, m.b >= 0), weight=0.5)
    m.cost = pyo.Objective(expr=m.a)
    relax().apply_to(m, **options)
    return m


def holds(m, a, b):
    """Whether all generated rows hold at a point."""
    m.a.set_value(a)
    m.b.set_value(b)
    return all(
        (row.lb is None or pyo.value(row.body) >= row.lb) and (row.ub is None or pyo.value(row.body) <= row.ub)
        for row in m.relaxed_complementarity.component_data_objects(pyo.Constraint, active=True)
    )


def kink(z, delta):
    """eq-steffensen-ulbrich."""
    return abs(z) if abs(z) >= delta else (-(z**4) / delta**3 + 6 * z**2 / delta + 3 * delta) / 8


def phi(p, q):
    """eq-kanzow-schwartz."""
    return p * q if p + q >= 0 else -(p**2 + q**2) / 2


# By the word that chooses them: what the page says must not be positive.
INEQUALITIES = {
    "scholtes": lambda a, b, d: [-a, -b, a * b - d],
    "fischer-burmeister": lambda a, b, d: [-a, -b, a + b - math.sqrt(a**2 + b**2 + 2 * d)],
    "chks": lambda a, b, d: [-a, -b, a + b - math.sqrt((a - b) ** 2 + 4 * d)],
    "steffensen-ulbrich": lambda a, b, d: [-a, -b, a + b - kink(a - b, d)],
    "kanzow-schwartz": lambda a, b, d: [-a, -b, phi(a - d, b - d)],
}
PRICED = {"penalty", "elastic"}


@pytest.mark.parametrize("word", sorted(RELAXATIONS.keys() - PRICED))
@given(a=sides, b=sides, delta=deltas)
def test_the_rows_that_are_built_are_those_of_the_page(word, a, b, delta):
    excess = INEQUALITIES[word](a, b, delta)
    assume(min(abs(each) for each in excess) > 1e-9)
    m = pair(relaxation=word, delta=delta)
    assert holds(m, a, b) == (max(excess) <= 0)
    (row,) = relaxation_rows_of(m)
    assert pyo.value(row.body) - row.ub == pytest.approx(excess[-1], abs=1e-9)


@given(a=st.floats(0, 3), b=st.floats(0, 3), delta=deltas)
def test_prices(a, b, delta):
    """eq-penalty and eq-elastic, as objectives; the weight is 0.5."""

    def objective(m):
        m.a.set_value(a)
        m.b.set_value(b)
        (found,) = m.component_data_objects(pyo.Objective, active=True)
        return pyo.value(found)

    assert objective(pair(relaxation="penalty", delta=delta)) == pytest.approx(a + 0.5 * a * b / delta)
    m = pair(relaxation="elastic", delta=delta)
    t = m.relaxed_complementarity.excess
    t.set_value(0.7)
    assert objective(m) == pytest.approx(a + 0.7 / delta)
    (row,) = relaxation_rows_of(m)
    assert (row.lb, t.lb, t.ub) == (None, 0, Elastic().excess_bound)
    assert pyo.value(row.body) - pyo.value(row.upper) == pytest.approx(a * b - 0.7)


# -------------------------------------------------------------------- groupings


def relaxed_stages(values, **options):
    m = stages(values, weight=1.0)
    relax().apply_to(m, **options)
    return m


amounts = st.lists(st.floats(0.0, 3.0), min_size=8, max_size=8)


@given(values=amounts, delta=deltas)
def test_sums_and_crossed_products(values, delta):
    """eq-sum, eq-crossed and eq-left-end: bodies and bounds of the rows."""
    a, b = np.reshape(values[:4], (2, 2)), np.reshape(values[4:], (2, 2))
    # Nothing is left of the first element.
    left_of_a, left_of_b = ([side[0].tolist(), [side[0, 1], *side[1]]] for side in (a, b))
    expected = {
        PerElement(): [a[e] @ b[e] for e in (0, 1)],
        rcp.relaxations.Crossed(): [a[e, i] * b[e, j] for e in (0, 1) for i in (0, 1) for j in (0, 1)],
        rcp.relaxations.Crossed(left_end="first"): [i * j for e in (0, 1) for i in left_of_a[e] for j in b[e]],
        rcp.relaxations.Crossed(left_end="second"): [i * j for e in (0, 1) for i in a[e] for j in left_of_b[e]],
    }
    for grouping, products in expected.items():
        rows = shifted_rows_of(relaxed_stages(values, grouping=grouping, delta=delta))
        assert [pyo.value(row.body) for row in rows] == pytest.approx(products, abs=1e-9)
        assert [row.ub for row in rows] == [delta] * len(rows)


# -------------------------------------------------------------------- lifting, schedules


@given(x=st.floats(-3, 3))
def test_lifting(x):
    """eq-lift and eq-range-parts: generated variables, their start values and their rows."""
    m = pyo.ConcreteModel(name="lifted")
    m.x, m.y = pyo.Var(initialize=x), pyo.Var(bounds=(0, None), initialize=1)
    m.F = pyo.Var(bounds=(-1, 2), initialize=0.5)
    m.side = rcp.Complementarity(expr=rcp.complements(m.x**3 - 1 >= 0, m.y >= 0))
    m.range = rcp.Complementarity(expr=rcp.complements(pyo.inequality(-1, m.F, 2), m.x - m.y))
    m.cost = pyo.Objective(expr=m.y)
    relax().apply_to(m, lift=True)
    lifted, lower, upper = lifted_pairs_of(m)
    assert (lifted.a.variable.lb, lifted.a.variable.value) == (0, pytest.approx(max(x**3 - 1, 0)))
    assert lifted.b.variable is m.y
    plus, minus = lower.b.variable, upper.b.variable
    assert (plus.lb, minus.lb) == (0, 0)
    assert plus.value - minus.value == pytest.approx(x - 1, abs=1e-12)
    assert [(each.a.variable, each.a.sign, each.a.offset) for each in (lower, upper)] == [(m.F, 1, -1), (m.F, -1, 2)]
    definitions = [pyo.value(row.body) - row.ub for row in m.relaxed_complementarity.definitions.values()]
    expected = [lifted.a.variable.value - (x**3 - 1), plus.value - minus.value - (x - 1)]
    assert np.abs(definitions) == pytest.approx(np.abs(expected), abs=1e-9)
