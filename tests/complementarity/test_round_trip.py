"""Every relaxation with every grouping, half of them lifted: there and back, and to a point that meets the pairs."""

from __future__ import annotations

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from pyomo.gdp import Disjunct, Disjunction

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import Complementarity, complements
from pyrobocop_pyomo.complementarity.grouping import GROUPINGS
from pyrobocop_pyomo.complementarity.relaxations import RELAXATIONS

from .harness import relaxation, round_trip, state

GROUPING_CHOICES = list(GROUPINGS)
CHOICES = [word for word in RELAXATIONS if word not in ("l1", "linf")]  # which are other words for two of them


def contact(m, element, stage):
    return complements(m.gap[element, stage] >= 0, 2 * m.force[element, stage] - m.gap[element, stage] + 1 >= 0)


def element_of(m, element, stage):
    return element


def friction(m, element):
    return complements(pyo.inequality(-1, m.force[element, 1], m.top), m.speed[element])


def two_elements():
    """Two elements of two stages with a plain and an affine side, and a range for each element."""
    m = pyo.ConcreteModel(name="two elements")
    m.I = pyo.Set(initialize=[1, 2])
    m.top = pyo.Param(initialize=2.0, mutable=True)
    m.gap = pyo.Var(m.I, m.I, bounds=(0, None), initialize=0.7)
    m.force = pyo.Var(m.I, m.I, initialize=0.4)
    m.speed = pyo.Var(m.I, initialize=0.3)
    m.contact = Complementarity(m.I, m.I, rule=contact, group=element_of, weight=0.5)
    m.friction = Complementarity(m.I, rule=friction)
    m.cost = pyo.Objective(
        expr=sum((m.gap[i, k] - i) ** 2 + (m.force[i, k] - 1) ** 2 for i in m.I for k in m.I)
        + sum((m.speed[i] - 1) ** 2 for i in m.I)
    )
    return m


def stop(b, i):
    m = b.model()
    return mpec.complements(m.speed[i] <= 9, m.gap[i, 2] * m.force[i, 2] >= 0)


@pytest.mark.parametrize("grouping", GROUPING_CHOICES, ids=str)
@pytest.mark.parametrize("choice", CHOICES)
def test_there_and_back(choice, grouping):
    m = two_elements()
    m.part = pyo.Block([1, 2])
    for part in m.part.values():
        part.stop = mpec.Complementarity(m.I, rule=stop)
    lift = (CHOICES.index(choice) + GROUPING_CHOICES.index(grouping)) % 2 == 0
    round_trip(m, relaxation=choice, grouping=grouping, lift=lift, delta=0.1)


@pytest.mark.parametrize("grouping", GROUPING_CHOICES, ids=str)
@pytest.mark.parametrize("choice", [choice for choice in CHOICES if choice != "penalty"])
def test_pairs_of_a_disjunct_are_relaxed_there(choice, grouping):
    m = two_elements()
    m.one, m.two = Disjunct(), Disjunct()
    m.one.contact = Complementarity(m.I, rule=lambda _, i: complements(m.gap[i, 1] >= 0, m.force[i, 1] + m.top >= 1))
    m.either = Disjunction(expr=[m.one, m.two])
    before = state(m)
    relax = relaxation()
    token = relax.apply_to(m, relaxation=choice, grouping=grouping, lift=True)
    inside = relax.rows_of(m.one.contact[1])
    assert all(row.parent_block().parent_block() is m.one for row in inside)
    assert not any(row.parent_block().parent_block() is m.one for row in relax.rows_of(m.contact[1, 1]))
    m.one.deactivate()
    assert not set(map(id, inside)) & set(map(id, relax.relaxation_rows_of(m)))
    m.one.activate()
    relax.revert(m, token)
    assert state(m) == before


@pytest.mark.asl
@pytest.mark.parametrize("grouping", GROUPING_CHOICES, ids=str)
@pytest.mark.parametrize("choice", CHOICES)
def test_solved_and_back(choice, grouping):
    m = two_elements()
    before = state(m)
    result = rcp.solve(
        m,
        strategies=rcp.Strategy(
            schedule=rcp.relaxations.Geometric(), relaxation=choice, grouping=grouping, polish=False
        ),
        backend="asl",
    )
    # Where a relaxation leaves a pair to its signs alone, the product is as small as the barrier makes it.
    assert result.largest_product <= 1e-7
    assert result.constraint_violation <= 1e-6
    assert state(m) == before
