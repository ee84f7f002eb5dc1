"""Pairs as choices: the mixed-integer answer is that of enumerating all branches, and the way back is complete."""

import io
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from harness.checked import unchanged
from mpcc_catalogue.branches import enumerate_branches
from pyomo.gdp import Disjunct, Disjunction
from pyomo.repn.plugins.lp_writer import LPWriter

from pyrobocop_pyomo.complementarity import (
    Complementarity,
    active_pairs,
    complements,
    either_zero,
    relaxation_rows_of,
    rows_of,
    shifted_rows_of,
    sources_of,
)
from pyrobocop_pyomo.complementarity.lifting import side_variable
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, deactivate_pairs, nl_text, state, text_without_pairs

REFORMULATIONS = ["gdp.bigm", "gdp.hull"]


@pytest.fixture
def choose() -> Any:
    return pyo.TransformationFactory("pyrobocop.complementarity_to_disjunctions")


@pytest.fixture
def highs() -> Any:
    solver = pyo.SolverFactory("appsi_highs")
    if not solver.available(exception_flag=False):
        pytest.skip("highspy is not installed")
    # A binary of 1e-6 is zero to HiGHS by default, and times a bound of 3 it is more than what is compared here.
    solver.highs_options = {"mip_feasibility_tolerance": 1e-9, "primal_feasibility_tolerance": 1e-9}
    return solver


# ---- linear programs with complementarity


def lpec(seed: int) -> Any:
    """min c'x over a box, x_0 + x_1 + x_2 >= 1, with a pair, a range and a side of two variables."""
    cost = np.random.default_rng(seed).integers(-5, 6, 6).astype(float)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(6), bounds=(-3, 3), initialize=0.0)
    m.enough = pyo.Constraint(expr=m.x[0] + m.x[1] + m.x[2] >= 1)
    m.cost = pyo.Objective(expr=sum(cost[i] * m.x[i] for i in range(6)))
    m.pair = Complementarity(expr=complements(m.x[0] >= 0, m.x[1] + m.x[3] <= 2))
    m.range = mpec.Complementarity(expr=mpec.complements(pyo.inequality(-1, m.x[2] - m.x[4], 2), m.x[5] + m.x[0] - 1))
    m.boxed = Complementarity(expr=complements(m.x[4], m.x[1] - m.x[2]))
    return m


@pytest.mark.ipopt
@pytest.mark.parametrize("seed", range(2))
def test_the_mixed_integer_optimum_is_that_of_all_branches(choose, highs, seed):
    best, _ = enumerate_branches(lpec(seed), starts=1)
    for reformulation in REFORMULATIONS:
        m = lpec(seed)
        choose.apply_to(m)
        pyo.TransformationFactory(reformulation).apply_to(m)
        highs.solve(m)
        assert pyo.value(m.cost) == pytest.approx(best, abs=1e-6)
        for residual in choose.residuals(m):
            assert residual.natural == pytest.approx(0, abs=1e-6)


# ---- what is generated


def model() -> Any:
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[1, 2])
    m.lo = pyo.Param(initialize=0, mutable=True)
    m.x, m.y = pyo.Var(m.I, bounds=(0, 4), initialize=1), pyo.Var(m.I, bounds=(-2, 5), initialize=1)
    m.n = pyo.Var(domain=pyo.Binary, initialize=1)
    m.cc = Complementarity(m.I, rule=lambda m, i: complements(m.x[i] >= 0, m.y[i] + m.n <= 6))
    m.range = Complementarity(m.I, rule={i: complements(m.x[i], m.y[i], second_bound="free") for i in m.I})
    m.moving = mpec.Complementarity(expr=mpec.complements(pyo.inequality(m.lo, m.x[1] - m.x[2], 2 + m.lo), m.y[1]))
    m.equal = Complementarity(expr=complements(m.x[1] + m.x[2] == 3, m.y[1]))
    m.signed = Complementarity(expr=complements(pyo.inequality(1, m.x[1] + m.x[2], 3), m.y[1] >= 0))
    m.part = pyo.Block(m.I)
    for i in m.I:
        m.part[i].cc = Complementarity(expr=complements(m.x[i], m.y[1] - m.y[2] >= 0, first_bound="lower"))
    m.either = Complementarity(expr=either_zero(m.x[1] >= 0, 2 * m.y[2]))
    m.cost = pyo.Objective(expr=sum(m.x[i] - 2 * m.y[i] for i in m.I))
    return m


def lp_text(m: Any) -> str:
    """The model as a mixed-integer solver would get it, with its disjunctions reformulated."""
    pairs = deactivate_pairs(m)
    copy = pyo.TransformationFactory("gdp.bigm").create_using(m)
    for pair in pairs:
        pair.activate()
    stream = io.StringIO()
    LPWriter().write(copy, stream, symbolic_solver_labels=True)
    return stream.getvalue()


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)], ids=str)
def test_applications_are_reverted_in_any_order(choose, order):
    m = model()
    before, nl, lp = state(m), text_without_pairs(m), lp_text(m)
    tokens = [
        choose.apply_to(m, targets=[m.cc[1], m.range]),
        choose.apply_to(m, targets=m.part),
        choose.apply_to(m),
    ]
    assert active_pairs(m) == []
    for number in order:
        choose.revert(m, tokens[number])
    assert state(m) == before
    assert (text_without_pairs(m), lp_text(m)) == (nl, lp)
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        choose.revert(m)


def test_a_pair_has_two_branches_whatever_the_sign_of_a_side_a_range_three_and_an_equality_none(choose):
    m = model()
    (block,) = choose.apply_to(m).blocks
    assert [len(choice.disjuncts) for choice in block.choices.values()] == [2, 2, 3, 3, 3, 2, 2, 2, 2]


@pytest.mark.parametrize("kind", ["clone", "pickle"])
def test_a_copy_answers_with_its_own_components(choose, kind):
    m = model()
    m.cc._rule = None  # a lambda does not pickle
    token = choose.apply_to(m)
    other = m.clone() if kind == "clone" else pickle.loads(pickle.dumps(m))
    assert lp_text(other) == lp_text(m)
    assert [residual.name for residual in choose.residuals(other)] == [
        residual.name for residual in choose.residuals(m)
    ]
    with pytest.raises(ComplementarityError, match="the token was made for another model"):
        choose.revert(other, token)
    choose.revert(other)
    assert len(active_pairs(m)) == 0 < len(active_pairs(other))


def test_a_relaxation_and_disjunctions_live_side_by_side(choose):
    m = model()
    m.n.fix(1)
    before = state(m)
    RELAX.apply_to(m, targets=m.part)
    choose.apply_to(m)
    assert len(shifted_rows_of(m)) == 2
    choose.revert(m)
    RELAX.revert(m)
    assert state(m) == before


def test_bounds_of_a_range_stay_those_of_their_parameters(choose):
    m = model()
    (block,) = choose.apply_to(m, targets=m.moving).blocks
    m.lo.set_value(1)
    assert [pyo.value(block.disjuncts[0, branch].rows[1].lower) for branch in ("lower", "upper")] == [1, 3]


def disjunct_with_a_pair() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 4)), pyo.Var(bounds=(0, 4))
    m.left, m.right = Disjunct(), Disjunct()
    m.left.cc = Complementarity(expr=complements(m.x >= 0, m.y >= 0))
    m.right.row = pyo.Constraint(expr=m.x + m.y <= 3)
    m.either = Disjunction(expr=[m.left, m.right])
    m.cost = pyo.Objective(expr=m.x + m.y, sense=pyo.maximize)
    return m


@pytest.mark.parametrize("reformulation", REFORMULATIONS)
def test_a_pair_in_a_disjunct_holds_only_where_that_is_chosen(choose, highs, reformulation):
    m = disjunct_with_a_pair()
    before = state(m)
    token = choose.apply_to(m)
    assert token.blocks[0].parent_block() is m.left
    copy = pyo.TransformationFactory(reformulation).create_using(m)
    highs.solve(copy)
    assert pyo.value(copy.cost) == pytest.approx(4)  # (4, 0): the left one, with its pair
    copy.left.binary_indicator_var.fix(0)
    highs.solve(copy)
    assert pyo.value(copy.cost) == pytest.approx(3)  # the right one, without it
    choose.revert(m, token)
    assert state(m) == before


def test_a_pair_in_a_disjunct_is_not_relaxed_until_that_is_chosen():
    m = disjunct_with_a_pair()
    with unchanged(state, m), pytest.raises(ComplementarityError, match=r"'left\.cc': lies in the disjunct 'left'"):
        RELAX.apply_to(m)
    m.left.indicator_var.fix(True)
    m.right.indicator_var.fix(False)
    pyo.TransformationFactory("gdp.fix_disjuncts").apply_to(m)
    RELAX.apply_to(m)
    assert len(shifted_rows_of(m)) == 1
    nl_text(m)


@dataclass(frozen=True)
class Forgetful:
    """Loses all pairs but the first."""

    def groups(self, pairs):
        return [("first", list(pairs[:1]))]


def test_a_grouping_that_loses_pairs_is_refused():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None)), pyo.Var(bounds=(0, None))
    m.pairs = Complementarity([1, 2], rule=lambda m, i: complements(m.x >= 0, m.y <= i))
    message = r"Forgetful\(\) put 1 pairs into groups, of 2 pairs"
    with unchanged(state, m), pytest.raises(ComplementarityError, match=message):
        RELAX.apply_to(m, grouping=Forgetful())


# --------------------------------------------------------------------
# Lifting: which sides are variables already, and what the generated ones do.


def mixed(values=(2.0, 3.0, 1.0)):
    """Plain variables, shifted and reversed ones, and expressions, on either side."""
    m = pyo.ConcreteModel(name="mixed")
    m.x = pyo.Var(bounds=(0, 10), initialize=values[0])
    m.y, m.z = pyo.Var(initialize=values[1]), pyo.Var(initialize=values[2])
    m.p = pyo.Param(initialize=0.5, mutable=True)
    m.plain = Complementarity(expr=complements(m.x >= 0, m.y >= m.p))
    m.reversed = Complementarity(expr=complements(m.x <= 10, m.y + m.z >= m.p))
    m.curved = Complementarity(expr=complements(m.x * m.y >= 1, m.z <= 4))
    m.cost = pyo.Objective(expr=m.x + m.y**2)
    return m


@pytest.mark.parametrize(
    "build",
    [lambda m: 2 * m.x, lambda m: m.x + m.y, lambda m: m.p * m.x, lambda m: m.x**2, lambda m: m.x * m.y - 1],
)
def test_a_multiple_a_sum_or_a_curve_is_no_variable(build):
    assert side_variable(build(mixed())) is None


def test_only_sides_that_are_no_variables_are_lifted_and_their_products_are_bilinear():
    m = mixed()
    token = RELAX.apply_to(m, lift=True)
    assert len(token.block.lifted) == 2
    assert all(variable.lb == 0 and variable.ub is None for variable in token.block.lifted.values())
    assert {row.body.polynomial_degree() for row in shifted_rows_of(m)} == {2}
    # y >= p, z <= 4 and x <= 10: plain variables, of which only x has the bound itself.
    assert len(token.block.sides) == 2
    assert len(token.block.definitions) == 2
    for row in token.block.definitions.values():
        assert row.equality
        assert sources_of(row)[0] in (m.reversed, m.curved)
        assert row in rows_of(sources_of(row)[0])


def test_the_relaxation_rows_are_those_of_products_alone():
    m = mixed()
    token = RELAX.apply_to(m, lift=True)
    assert relaxation_rows_of(m) == shifted_rows_of(m) == list(token.block.rows.values())
    next(iter(token.block.rows.values())).deactivate()
    assert len(relaxation_rows_of(m)) == 2


def test_a_side_without_a_value_starts_at_zero():
    m = mixed()
    m.z.set_value(None)
    token = RELAX.apply_to(m, lift=True)
    assert sorted(variable.value for variable in token.block.lifted.values()) == [0, 5]
