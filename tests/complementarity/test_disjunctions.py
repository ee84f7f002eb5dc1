"""Pairs as choices: the mixed-integer answer is that of enumerating all branches, and the way back is complete."""

from __future__ import annotations

import io
import itertools
import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from pyomo.gdp import Disjunct, Disjunction
from pyomo.repn.plugins.lp_writer import LPWriter
from scipy.optimize import linprog

from pyrobocop_pyomo.complementarity import Complementarity, active_pairs, complements
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import deactivate_pairs, nl_text, relaxation, state

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


# ---- linear programs with complementarity, built twice: as a model, and as arrays for the enumeration


def lpec(seed: int) -> tuple[Any, Any]:
    """min c'x over a box, x_0 + x_1 + x_2 >= 1, with a pair, a range and a side of two variables; and its optimum."""
    random = np.random.default_rng(seed)
    cost = random.integers(-5, 6, 6).astype(float)
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(6), bounds=(-3, 3))
    m.enough = pyo.Constraint(expr=m.x[0] + m.x[1] + m.x[2] >= 1)
    m.cost = pyo.Objective(expr=sum(cost[i] * m.x[i] for i in range(6)))
    m.pair = Complementarity(expr=complements(m.x[0] >= 0, m.x[1] + m.x[3] <= 2))
    m.range = mpec.Complementarity(expr=mpec.complements(pyo.inequality(-1, m.x[2] - m.x[4], 2), m.x[5] + m.x[0] - 1))
    m.boxed = Complementarity(expr=complements(m.x[4], m.x[1] - m.x[2]))

    def row(**entries: float) -> list[float]:
        return [entries.get(f"x{i}", 0.0) for i in range(6)]

    x0, two = row(x0=1), row(x1=1, x3=1)
    body, free = row(x2=1, x4=-1), row(x5=1, x0=1)
    x4, multiplier = row(x4=1), row(x1=1, x2=-1)

    def negative(entries: list[float]) -> list[float]:
        return [-entry for entry in entries]

    always = [
        (negative(row(x0=1, x1=1, x2=1)), -1.0),
        (negative(x0), 0.0),
        (two, 2.0),
        (body, 2.0),
        (negative(body), 1.0),
    ]
    branches = [
        [([(x0, 0.0)], []), ([(two, 2.0)], [])],
        [([(body, -1.0)], [(negative(free), -1.0)]), ([(body, 2.0)], [(free, 1.0)]), ([(free, 1.0)], [])],
        [([(x4, -3.0)], [(negative(multiplier), 0.0)]), ([(x4, 3.0)], [(multiplier, 0.0)]), ([(multiplier, 0.0)], [])],
    ]
    best = np.inf
    for chosen in itertools.product(*branches):
        equal = [row for equalities, _ in chosen for row in equalities]
        less = always + [row for _, inequalities in chosen for row in inequalities]
        answer = linprog(
            cost,
            A_ub=[a for a, _ in less],
            b_ub=[b for _, b in less],
            A_eq=[a for a, _ in equal],
            b_eq=[b for _, b in equal],
            bounds=(-3, 3),
        )
        best = min(best, answer.fun if answer.success else np.inf)
    return m, best


@pytest.mark.parametrize("reformulation", REFORMULATIONS)
@pytest.mark.parametrize("seed", range(6))
def test_the_mixed_integer_optimum_is_that_of_all_branches(choose, highs, seed, reformulation):
    m, best = lpec(seed)
    choose.apply_to(m)
    pyo.TransformationFactory(reformulation).apply_to(m)
    highs.solve(m)
    assert pyo.value(m.cost) == pytest.approx(best, abs=1e-6)
    for residual in choose.residuals(m):
        assert residual.natural == pytest.approx(0, abs=1e-6)
        assert residual.infeasibility <= 1e-6


@pytest.mark.heavy
@pytest.mark.parametrize("seed", range(3))
def test_the_special_ordered_sets_mean_the_same(choose, highs, seed):
    """Whatever solver takes sets may pick one nonzero member of each: all picks are tried."""
    m, best = lpec(seed)
    choose.apply_to(m, sos1=True)
    sets = [data for source in (m.pair, m.range, m.boxed) for data in choose.choices_of(source)]
    assert len(sets) == 5
    assert all(data.level == 1 and len(list(data.variables)) == 2 for data in sets)
    found = np.inf
    for members in itertools.product(*(data.variables for data in sets)):
        copy = m.clone()
        for source in copy.component_data_objects(pyo.SOSConstraint):
            source.deactivate()
        for zero in members:
            copy.find_component(zero).fix(0)
        found = min(found, optimum(highs, copy))
    assert found == pytest.approx(best, abs=1e-6)


def optimum(highs: Any, m: Any) -> float:
    """The optimum of a linear program, infinity where there is none."""
    result = highs.solve(m, load_solutions=False)
    if result.solver.termination_condition != pyo.TerminationCondition.optimal:
        return np.inf
    return float(result.problem.upper_bound)


# ---- what is generated


def model() -> Any:
    m = pyo.ConcreteModel()
    m.I = pyo.Set(initialize=[1, 2])
    m.lo = pyo.Param(initialize=0, mutable=True)
    m.x, m.y = pyo.Var(m.I, bounds=(0, 4), initialize=1), pyo.Var(m.I, bounds=(-2, 5), initialize=1)
    m.n = pyo.Var(domain=pyo.Binary, initialize=1)
    m.cc = Complementarity(m.I, rule=lambda m, i: complements(m.x[i] >= 0, m.y[i] + m.n <= 6))
    m.range = Complementarity(m.I, expr=complements(m.x, m.y, second_bound="free"))
    m.moving = mpec.Complementarity(expr=mpec.complements(pyo.inequality(m.lo, m.x[1] - m.x[2], 2 + m.lo), m.y[1]))
    m.equal = Complementarity(expr=complements(m.x[1] + m.x[2] == 3, m.y[1]))
    m.signed = Complementarity(expr=complements(pyo.inequality(1, m.x[1] + m.x[2], 3), m.y[1] >= 0))
    m.part = pyo.Block(m.I)
    for i in m.I:
        m.part[i].cc = Complementarity(expr=complements(m.x[i], m.y[1] - m.y[2] >= 0, first_bound="lower"))
    m.cost = pyo.Objective(expr=sum(m.x[i] - 2 * m.y[i] for i in m.I))
    return m


def text_without_pairs(m: Any) -> str:
    pairs = deactivate_pairs(m)
    text = nl_text(m)
    for pair in pairs:
        pair.activate()
    return text


def lp_text(m: Any) -> str:
    """The model as a mixed-integer solver would get it, with its disjunctions reformulated."""
    pairs = deactivate_pairs(m)
    copy = pyo.TransformationFactory("gdp.bigm").create_using(m)
    for pair in pairs:
        pair.activate()
    stream = io.StringIO()
    LPWriter().write(copy, stream, symbolic_solver_labels=True)
    return stream.getvalue()


@pytest.mark.parametrize("options", [{}, {"sos1": True}, {"default_bound": 7}], ids=str)
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))), ids=str)
def test_applications_are_reverted_in_any_order(choose, options, order):
    m = model()
    before, nl, lp = state(m), text_without_pairs(m), lp_text(m)
    tokens = [
        choose.apply_to(m, targets=[m.cc[1], m.range], **options),
        choose.apply_to(m, targets=m.part, **options),
        choose.apply_to(m, **options),
    ]
    assert active_pairs(m) == []
    for number in order:
        choose.revert(m, tokens[number])
    assert state(m) == before
    assert (text_without_pairs(m), lp_text(m)) == (nl, lp)
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        choose.revert(m)


def test_every_disjunct_variable_and_row_knows_its_pair(choose):
    m = model()
    (block,) = choose.apply_to(m).blocks
    generated = [
        *block.component_data_objects((pyo.Constraint, pyo.Var), descend_into=(pyo.Block, Disjunct)),
        *block.component_data_objects((Disjunct, Disjunction)),
    ]
    assert {choose.source_of(part).name for part in generated} == {pair.name for pair in all_sources(m)}
    for source in all_sources(m):
        for choice in choose.choices_of(source):
            assert choose.source_of(choice) is source
    assert [len(choose.choices_of(source)[0].disjuncts) for source in (m.cc[1], m.range[1], m.signed)] == [2, 3, 2]
    assert choose.choices_of(m.equal) == []
    with pytest.raises(ComplementarityError, match=r"'x\[1\]': was not generated"):
        choose.source_of(m.x[1])


def all_sources(m: Any) -> list[Any]:
    return [*m.cc.values(), *m.range.values(), m.moving, m.equal, m.signed, *(m.part[i].cc for i in m.I)]


@pytest.mark.parametrize("kind", ["clone", "pickle"])
def test_a_copy_answers_with_its_own_components(choose, kind):
    m = model()
    m.cc._rule = None  # a lambda does not pickle
    choose.apply_to(m)
    other = m.clone() if kind == "clone" else pickle.loads(pickle.dumps(m))
    assert lp_text(other) == lp_text(m)
    (choice,) = choose.choices_of(other.cc[2])
    assert choice.model() is other
    assert choose.source_of(choice) is other.cc[2]
    choose.revert(other)
    assert len(active_pairs(m)) == 0 < len(active_pairs(other))


def test_create_using_leaves_the_original_and_takes_its_targets(choose):
    m = model()
    before = state(m)
    copy = choose.create_using(m, targets=[m.cc])
    assert state(m) == before
    assert len(list(copy.component_data_objects(Disjunction, descend_into=True))) == 2
    assert copy.range.active


def test_a_relaxation_and_disjunctions_live_side_by_side(choose):
    m = model()
    m.n.fix(1)
    before = state(m)
    relax = relaxation()
    relax.apply_to(m, targets=m.part)
    choose.apply_to(m)
    assert len(relax.shifted_rows_of(m)) == 2
    choose.revert(m)
    relax.revert(m)
    assert state(m) == before


def test_bounds_of_a_range_stay_those_of_their_parameters(choose):
    m = model()
    choose.apply_to(m, targets=m.moving)
    (choice,) = choose.choices_of(m.moving)
    lower = choice.disjuncts[0].rows[0]
    m.lo.set_value(1)
    assert (pyo.value(lower.lower), lower.body.lb, lower.body.ub) == (1, 1, 3)


@pytest.mark.parametrize("fixed", [False, True])
def test_fixing_a_side_changes_nothing_about_what_is_generated(choose, fixed):
    m = model()
    if fixed:
        m.x.fix(1)
        m.y.fix(2)
    choose.apply_to(m)
    m.x.unfix()
    m.y.unfix()
    m.x.set_values({1: 1, 2: 1})
    m.y.set_values({1: 1, 2: 1})
    reference = model()
    choose.apply_to(reference)
    assert lp_text(m) == lp_text(reference)


@pytest.mark.parametrize("reformulation", REFORMULATIONS)
def test_a_pair_in_a_disjunct_holds_only_where_that_is_chosen(choose, highs, reformulation):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 4)), pyo.Var(bounds=(0, 4))
    m.left, m.right = Disjunct(), Disjunct()
    m.left.cc = Complementarity(expr=complements(m.x >= 0, m.y >= 0))
    m.right.row = pyo.Constraint(expr=m.x + m.y <= 3)
    m.either = Disjunction(expr=[m.left, m.right])
    m.cost = pyo.Objective(expr=m.x + m.y, sense=pyo.maximize)
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


# ---- refusals


def unbounded(m: Any) -> None:
    m.z = pyo.Var()
    m.wide = Complementarity([3], rule=lambda m, i: complements(m.z >= 0, m.x[1] >= 0))


def test_a_side_without_a_bound_is_named_and_can_be_given_one(choose):
    m = model()
    unbounded(m)
    before = state(m)
    words = r"^'wide\[3\]': no finite upper bound follows for the side 'z'.*default_bound=.*sos1=True"
    with pytest.raises(ComplementarityError, match=words):
        choose.apply_to(m)
    assert state(m) == before
    choose.apply_to(m, sos1=True)
    choose.revert(m)
    choose.apply_to(m, targets=m.wide, default_bound=50)
    (choice,) = choose.choices_of(m.wide[3])
    assert choice.disjuncts[0].rows[0].body.ub == 50


def side_out_of_reach(m: Any) -> None:
    m.wide = Complementarity([3], rule=lambda m, i: complements(m.x[1] + m.x[2] >= 9, m.y[1] >= 0))


def no_pair_left(m: Any) -> None:
    for pair in deactivate_pairs(m):
        pair.deactivate()


def not_a_number(m: Any) -> None:
    m.wide = Complementarity([3], rule=lambda m, i: complements(float("nan") * m.x[1] >= 0, m.y[1] >= 0))


@pytest.mark.parametrize(
    ("spoil", "options", "words"),
    [
        (side_out_of_reach, {}, r"'wide\[3\]': the side .* is at most -1 by the bounds of its variables"),
        (side_out_of_reach, {"sos1": True}, r"'wide\[3\]': the side .* is at most -1"),
        (no_pair_left, {}, "no active complementarity pair in it"),
        (not_a_number, {}, r"'wide\[3\]': a coefficient is NaN"),
        (None, {"default_bound": -1}, "default_bound"),
        (None, {"big_m": 1}, "big_m"),
    ],
)
def test_a_failure_leaves_the_model_as_it_was(choose, spoil, options, words):
    m = model()
    if spoil is not None:
        spoil(m)
    before = state(m)
    with pytest.raises(ValueError, match=words):
        choose.apply_to(m, **options)
    assert state(m) == before


def test_a_token_belongs_to_its_model_and_works_once(choose):
    m = model()
    token = choose.apply_to(m)
    with pytest.raises(ComplementarityError, match="the token was made for another model"):
        choose.revert(m.clone(), token)
    choose.revert(m, token)
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        choose.revert(m, token)
    with pytest.raises(ComplementarityError, match=r"'cc\[1\]': is no disjunction"):
        choose.choices_of(m.cc[1])
