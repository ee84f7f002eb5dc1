"""Together with generalized disjunctive programming, `pyomo.dae`, `pyomo.mpec` lists and Pyomo's KKT conditions."""

from __future__ import annotations

from dataclasses import dataclass

import pyomo.dae as dae
import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from pyomo.gdp import Disjunct, Disjunction

from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import nl_text, relaxation, state


@pytest.fixture
def relax():
    return relaxation()


@pytest.fixture
def choice():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 10), initialize=1), pyo.Var(bounds=(0, 10), initialize=2)
    m.cost = pyo.Objective(expr=m.x + m.y)
    m.common = Complementarity(expr=complements(m.x >= 0, m.y <= 10))
    m.left, m.right = Disjunct(), Disjunct()
    m.left.cc = Complementarity(expr=complements(m.x >= 0, m.y - m.x >= 0))
    m.right.row = pyo.Constraint(expr=m.x >= 5)
    m.either = Disjunction(expr=[m.left, m.right])
    return m


def test_a_relaxed_disjunct_can_be_reformulated(choice, relax):
    relax.apply_to(choice)
    pyo.TransformationFactory("gdp.bigm").apply_to(choice, bigM=1e3)
    nl_text(choice)


def test_a_penalty_cannot_enter_a_disjunct(choice, relax):
    before = state(choice)
    with pytest.raises(ComplementarityError, match=r"'left\.cc': lies in the disjunct 'left'"):
        relax.apply_to(choice, relaxation="penalty")
    assert state(choice) == before


@pytest.mark.parametrize(
    ("component", "pair"),
    [(mpec.Complementarity, mpec.complements), (Complementarity, complements)],
    ids=["pyomo.mpec", "ours"],
)
def test_pairs_in_blocks_over_time_survive_discretisation(component, pair, relax):
    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, bounds=(0, None), initialize=1)
    m.u = pyo.Var(m.t, initialize=0)
    m.xdot = dae.DerivativeVar(m.x, wrt=m.t, initialize=0)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.xdot[t] == m.u[t])
    m.cost = pyo.Objective(expr=m.x[1])

    def at(b, t):
        b.first = component(expr=pair(b.model().x[t] >= 0, b.model().u[t] >= 0))
        b.second = component(expr=pair(b.model().x[t] >= 0, b.model().u[t] <= 1))

    m.contact = pyo.Block(m.t, rule=at)
    pyo.TransformationFactory("dae.collocation").apply_to(m, nfe=3, ncp=2)
    assert len(active_pairs(m)) == 2 * len(m.t)
    relax.apply_to(m, grouping="element")
    assert len(relax.shifted_rows_of(m)) == len(m.t)
    nl_text(m)


def test_the_kkt_conditions_of_pyomo_are_taken(relax):
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, 3), initialize=1)
    m.y = pyo.Var(initialize=1)
    m.c = pyo.Constraint(expr=m.x + m.y <= 4)
    m.ranged = pyo.Constraint(expr=(-1, m.x - m.y, 2))
    m.cost = pyo.Objective(expr=(m.x - 5) ** 2 + m.y**2)
    pyo.TransformationFactory("core.kkt").apply_to(m)
    pairs = active_pairs(m)
    assert len(pairs) == 5
    # At x = y = 1, by hand: slacks 4 - 2, 0 + 1, 2 - 0, 1 - 0, 3 - 1.
    assert sorted(pyo.value(pair.b) for pair in pairs) == [1, 1, 2, 2, 2]
    relax.apply_to(m)
    assert len(relax.shifted_rows_of(m)) == 5


@dataclass(frozen=True)
class Together:
    """One name for all pairs."""

    def groups(self, pairs):
        return [("all", list(pairs))]


@dataclass(frozen=True)
class Forgetful:
    """Loses all pairs but the first."""

    def groups(self, pairs):
        return [("first", list(pairs[:1]))]


def test_a_group_never_reaches_over_the_edge_of_a_disjunct(choice, relax):
    choice.right.cc = Complementarity(expr=complements(choice.x, choice.y <= 5, first_bound="lower"))
    relax.apply_to(choice, grouping=Together())
    assert len(relax.shifted_rows_of(choice)) == 3
    assert relax.rows_of(choice.right.cc)[0] is not relax.rows_of(choice.left.cc)[0]


def test_a_grouping_that_loses_pairs_is_refused(choice, relax):
    choice.more = Complementarity(expr=complements(choice.x >= 0, choice.y <= 9))
    before = state(choice)
    with pytest.raises(ComplementarityError, match=r"Forgetful\(\) put 1 pairs into groups, of 2 pairs"):
        relax.apply_to(choice, grouping=Forgetful())
    assert state(choice) == before
