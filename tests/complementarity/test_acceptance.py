"""What a user of Pyomo may expect of pairs, one sentence after another.

Kept elsewhere: that importing registers everything, prints nothing and costs little (architecture/test_shop_window),
that nothing but solving needs an Ipopt (solving/test_solve), that wrong statements are named (test_bad_input), and that
applications are reverted in parts and in any order (test_transformation, test_forms, test_disjunctions).
"""

from __future__ import annotations

import itertools
import math
import pickle
from collections.abc import Callable
from typing import Any

import pyomo.dae as dae
import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from pyomo.gdp import Disjunct

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import active_pairs, canonical_form, component_residuals, side_values

from .harness import nl_text, relaxation, state, text_without_pairs

TRANSFORMATIONS = ["pyrobocop.relax_complementarity", "pyrobocop.complementarity_to_disjunctions"]
with_ipopt = pytest.mark.asl


@pytest.fixture
def relax() -> Any:
    return relaxation()


def contact(m: Any, i: int) -> Any:
    return mpec.complements(m.gap[i] >= 0, m.force[i] - m.least >= 0)


def existing_model() -> Any:
    """A user's model of pyomo.mpec: min sum (gap - 1)^2 + (force - 3)^2 with 0 <= gap ⟂ force - least >= 0."""
    m = pyo.ConcreteModel(name="existing")
    m.I = pyo.Set(initialize=[1, 2])
    m.gap, m.force = pyo.Var(m.I, bounds=(0, None), initialize=1), pyo.Var(m.I, initialize=2)
    m.least = pyo.Param(initialize=1, mutable=True)
    m.cc = mpec.Complementarity(m.I, rule=contact)
    m.cost = pyo.Objective(expr=sum((m.gap[i] - 1) ** 2 + (m.force[i] - 3) ** 2 for i in m.I))
    return m


def solve_relaxed(m: Any) -> float:
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    return float(pyo.value(m.cost))


# ---- 1 and 3: transformations, in place and on a copy


@pytest.mark.parametrize("name", TRANSFORMATIONS)
def test_both_transformations_are_registered_and_say_what_they_do(name):
    assert name in pyo.TransformationFactory
    assert len(pyo.TransformationFactory.doc(name)) > 20


@pytest.mark.parametrize("name", TRANSFORMATIONS)
def test_a_copy_is_transformed_and_the_original_is_not_touched(name):
    m = existing_model()
    m.gap.setub(9)
    m.force.setub(9)
    before, text = state(m), text_without_pairs(m)
    ctypes = [component.ctype for component in m.component_objects()]
    copy = pyo.TransformationFactory(name).create_using(m)
    assert active_pairs(copy) == []
    assert state(m) == before
    assert text_without_pairs(m) == text
    assert [component.ctype for component in m.component_objects()] == ctypes
    pyo.TransformationFactory(name).apply_to(m)
    assert active_pairs(m) == []
    assert m.cc.ctype is mpec.Complementarity


# ---- 4 and 5: wherever pairs are


def test_pairs_are_found_wherever_pyomo_lets_them_be(relax):
    m = existing_model()
    m.scalar = mpec.Complementarity(expr=contact(m, 1))
    m.list = mpec.ComplementarityList(rule=[contact(m, 1), contact(m, 2)])
    m.part = pyo.Block(m.I, rule=lambda b, i: setattr(b, "cc", mpec.Complementarity(expr=contact(b.model(), i))))
    m.t = dae.ContinuousSet(initialize=[0, 1])
    m.x = pyo.Var(m.t, bounds=(0, None), initialize=1)
    m.xdot = dae.DerivativeVar(m.x, wrt=m.t)
    m.rate = pyo.Constraint(m.t, rule=lambda m, t: m.xdot[t] == 1)
    m.moment = pyo.Block(m.t)
    for t in m.t:
        m.moment[t].cc = rcp.Complementarity(expr=rcp.complements(m.x[t] >= 0, m.gap[1] >= 0))
    m.maybe = Disjunct()
    m.maybe.cc = mpec.Complementarity(expr=contact(m, 2))
    expected = {
        *("cc[1]", "cc[2]", "scalar", "list[1]", "list[2]", "part[1].cc", "part[2].cc", "maybe.cc"),
        *("moment[0].cc", "moment[1].cc"),
    }
    assert {pair.name for pair in active_pairs(m)} == expected
    relax.apply_to(m)
    assert {source.name for row in relax.shifted_rows_of(m) for source in relax.sources_of(row)} == expected


def test_what_is_deactivated_is_left_alone_and_can_follow(relax):
    m = existing_model()
    m.part = pyo.Block(m.I, rule=lambda b, i: setattr(b, "cc", mpec.Complementarity(expr=contact(b.model(), i))))
    m.cc[1].deactivate()
    m.part[2].deactivate()
    relax.apply_to(m)
    assert [row_source.name for row in relax.shifted_rows_of(m) for row_source in relax.sources_of(row)] == [
        "cc[2]",
        "part[1].cc",
    ]
    assert (m.cc[1].active, m.part[2].active, m.part[2].cc.active) == (False, False, True)
    m.cc[1].activate()
    m.part[2].activate()
    relax.apply_to(m)
    assert len(relax.shifted_rows_of(m)) == 4


# ---- 6 and 7: copies


@with_ipopt
@pytest.mark.parametrize("copied", ["before", "after", "pickled"])
def test_a_copy_is_solved_to_the_same_point_and_knows_its_own_pairs(relax, copied):
    m = existing_model()
    other = m.clone() if copied == "before" else None
    relax.apply_to(m, delta=1e-8)
    if other is None:
        other = m.clone() if copied == "after" else pickle.loads(pickle.dumps(m))
    else:
        relax.apply_to(other, delta=1e-8)
    for row in relax.shifted_rows_of(other):
        (source,) = relax.sources_of(row)
        assert source is other.find_component(source.name)
        assert source is not m.find_component(source.name)
    assert solve_relaxed(other) == pytest.approx(solve_relaxed(m), abs=1e-6)


# ---- 8 and 9: more than once, and parts only


def test_a_second_application_adds_what_is_new_under_the_same_delta(relax):
    m = existing_model()
    relax.apply_to(m, delta=0.5)
    count = len(relax.shifted_rows_of(m))
    m.late = mpec.Complementarity(expr=contact(m, 1))
    relax.apply_to(m)
    assert len(relax.shifted_rows_of(m)) == count + 1
    relax.delta_of(m).set_value(0.25)
    assert {row.ub for row in relax.shifted_rows_of(m)} == {0.25}


def test_of_a_part_that_is_relaxed_the_rest_stays_and_the_writer_names_it(relax):
    m = existing_model()
    m.part = pyo.Block()
    m.part.cc = mpec.Complementarity(expr=contact(m, 1))
    relax.apply_to(m.part)
    with pytest.raises(ValueError, match="does not know how to process") as caught:
        nl_text(m)
    named = [line.strip() for line in str(caught.value).splitlines() if "cc" in line]
    assert named == ["cc[1]", "cc[2]"]


# ---- 10: fixed variables


@with_ipopt
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    ("which", "at", "best"), [("x", 0.5, 0.25 + 9), ("x", 0.0, 1.0), ("y", 2.0, 2.0), ("y", 0.0, 9)]
)
def test_a_side_may_be_fixed_before_or_after(relax, when, swapped, which, at, best):
    """min (x - 1)^2 + (y - 3)^2 with 0 <= x ⟂ y >= 0: what is left when one of them is given."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1), pyo.Var(initialize=1)
    sides = (m.x >= 0, m.y >= 0)
    m.cc = mpec.Complementarity(expr=mpec.complements(*(sides[::-1] if swapped else sides)))
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + (m.y - 3) ** 2)
    variable = m.component(which)
    if when == "before":
        variable.fix(at)
    relax.apply_to(m, delta=1e-9)
    variable.fix(at)
    assert solve_relaxed(m) == pytest.approx(best, abs=1e-6)
    assert relax.residuals(m)[0].product <= 1e-7


# ---- 11: every form against its branches


def plane() -> Any:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(-9, 9), initialize=0.5), pyo.Var(bounds=(-9, 9), initialize=0.5)
    m.box = pyo.Var(bounds=(-1, 2), initialize=0.5)
    m.lo, m.up = pyo.Param(initialize=-1, mutable=True), pyo.Param(initialize=2, mutable=True)
    m.tied = pyo.Constraint(expr=m.box == m.x)
    m.e = pyo.Expression(expr=m.x)
    m.aim = pyo.Param([1, 2], mutable=True, initialize=0)
    m.cost = pyo.Objective(expr=(m.x - m.aim[1]) ** 2 + (m.y - m.aim[2]) ** 2)
    return m


def single(m: Any) -> list[list[Any]]:
    return [[m.x == 0, m.y >= 0], [m.x >= 0, m.y == 0]]


def between(m: Any) -> list[list[Any]]:
    return [[m.x == -1, m.y >= 0], [m.x == 2, m.y <= 0], [m.x >= -1, m.x <= 2, m.y == 0]]


def nonlinear_between(m: Any) -> list[list[Any]]:
    return [[m.x**3 == -1, m.y >= 0], [m.x**3 == 2, m.y <= 0], [m.x**3 >= -1, m.x**3 <= 2, m.y == 0]]


inequality = pyo.inequality
FORMS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], list[list[Any]]]]] = {
    "single": (lambda m: (m.x >= 0, m.y >= 0), single),
    "constant": (lambda m: (m.x >= 1, m.y >= 0), lambda m: [[m.x == 1, m.y >= 0], [m.x >= 1, m.y == 0]]),
    "named expression": (lambda m: (m.e >= 0, m.y >= 0), single),
    "variables on both sides": (
        lambda m: (m.x >= m.y, m.y >= 0),
        lambda m: [[m.x == m.y, m.y >= 0], [m.x >= m.y, m.y == 0]],
    ),
    "one-sided upper": (lambda m: (m.x <= m.up, m.y <= 1), lambda m: [[m.x == 2, m.y <= 1], [m.x <= 2, m.y == 1]]),
    "range": (lambda m: (inequality(-1, m.x, 2), m.y + 0 * m.x), between),
    "range, swapped": (lambda m: (m.y + 0 * m.x, inequality(-1, m.x, 2)), between),
    "range, mutable": (lambda m: (inequality(m.lo, m.e, m.up), m.y + 0 * m.x), between),
    "range, nonlinear": (lambda m: (inequality(-1, m.x**3, 2), m.y + 0 * m.x), nonlinear_between),
    "range, lower only": (
        lambda m: (inequality(m.lo, m.x, math.inf), m.y >= 0),
        lambda m: [[m.x == -1, m.y >= 0], [m.x >= -1, m.y == 0]],
    ),
    "range, positive": (
        lambda m: (inequality(-1, m.x, 2), m.y >= 0),
        lambda m: [[m.x == -1, m.y >= 0], [m.x >= -1, m.x <= 2, m.y == 0]],
    ),
    "range, negative": (
        lambda m: (m.y <= 0, inequality(-1, m.x, 2)),
        lambda m: [[m.x == 2, m.y <= 0], [m.x >= -1, m.x <= 2, m.y == 0]],
    ),
    "plain variable": (lambda m: (m.box, m.y + 0 * m.x), between),
    "equality": (lambda m: (m.x + m.y == 1, m.x - m.y), lambda m: [[m.x + m.y == 1]]),
}


def enumerated(branches: Callable[[Any], list[list[Any]]], aim: tuple[float, float]) -> float:
    """The best of the branches, each a convex (or, for the cube, one-dimensional) problem of its own."""
    best = math.inf
    for number in range(len(branches(plane()))):
        m = plane()
        m.aim.store_values(dict(enumerate(aim, start=1)))
        m.branch = pyo.ConstraintList()
        for row in branches(m)[number]:
            m.branch.add(row)
        # From a point inside: a solver that starts where a cube is flat does not get anywhere.
        m.x.set_value(1.0)
        solver = pyo.SolverFactory("pyrobocop.ipopt")
        result = solver.solve(m, load_solutions=True)
        assert pyo.check_optimal_termination(result)
        best = min(best, pyo.value(m.cost))
    return best


@pytest.mark.parametrize("form", FORMS)
def test_pyomo_mpec_and_this_package_mean_the_same(form):
    statement, _ = FORMS[form]
    m = plane()
    m.ours = rcp.Complementarity(expr=statement(m))
    m.theirs = mpec.Complementarity(expr=statement(m))
    for x, y in itertools.product((-1.5, 0.5, 2.5), (-2.0, 0.0, 2.0)):
        m.x.set_value(x)
        m.box.set_value(x)
        m.y.set_value(y)
        ours, theirs = (canonical_form(pair) for pair in (m.ours, m.theirs))
        assert [side_values(pair) for pair in ours.pairs] == [side_values(pair) for pair in theirs.pairs]
        assert [str(row) for row in ours.rows] == [str(row) for row in theirs.rows]


@with_ipopt
@pytest.mark.parametrize("form", FORMS)
def test_every_form_reaches_the_best_of_its_branches(form):
    statement, branches = FORMS[form]
    for aim in itertools.product((-2.5, 0.5, 3.5), (-1.5, 1.5)):
        best = math.inf
        # A local solver may end in a worse branch than the best: it has three starts.
        for start in (aim, (0.5, 0.5), (1.9, -0.5)):
            m = plane()
            m.aim.store_values(dict(enumerate(aim, start=1)))
            m.x.set_value(start[0])
            m.y.set_value(start[1])
            m.cc = rcp.Complementarity(expr=statement(m))
            result = rcp.solve(m)
            result.raise_for_status()
            assert max((abs(residual.natural) for residual in result.residuals), default=0) <= 1e-4, (form, aim)
            assert all(pyo.value(row.args[0] - row.args[1]) == pytest.approx(0, abs=1e-6) for row in equalities(m.cc))
            best = min(best, result.objective)
        assert best == pytest.approx(enumerated(branches, aim), abs=2e-4), (form, aim)


def equalities(source: Any) -> list[Any]:
    return [row for row in canonical_form(source).rows if len(row.args) == 2 and not canonical_form(source).pairs]


# ---- 13: the way back


@pytest.mark.parametrize("options", [{}, {"lift": True}, {"grouping": "element", "lift": True}], ids=str)
def test_reverting_restores_components_activity_and_the_file_byte_for_byte(relax, options):
    m = existing_model()
    m.range = mpec.Complementarity(expr=mpec.complements(inequality(0, m.gap[1] + m.gap[2], m.least), m.force[1]))
    m.equal = rcp.Complementarity(expr=rcp.complements(m.gap[1] == m.gap[2], m.force[2]))
    before, text = state(m), text_without_pairs(m)
    token = relax.apply_to(m, **options)
    assert state(m) != before
    relax.revert(m, token)
    assert state(m) == before
    assert text_without_pairs(m) == text


# ---- 14: the report


@with_ipopt
def test_after_the_homotopy_every_pair_and_every_step_is_reported():
    m = existing_model()
    result = rcp.solve(m, schedule=rcp.relaxations.Geometric(first=1e-1, factor=0.1, last=1e-8))
    assert [residual.name for residual in result.residuals] == ["cc[1]", "cc[2]"]
    natural = [residual.natural for residual in result.residuals]
    by_hand = [min(m.gap[i].value, m.force[i].value - 1) for i in m.I]
    assert natural == pytest.approx(by_hand, abs=1e-12)
    assert 0 <= max(natural) <= sum(natural) <= 1e-3
    (report,) = component_residuals(active_pairs(m))
    assert (report.name, report.pairs) == ("cc", 2)
    assert (report.largest, report.total) == pytest.approx((max(natural), sum(natural)))
    deltas = [step.delta for step in result.steps if step.delta is not None]
    assert deltas == sorted(deltas, reverse=True)
    assert deltas[0] == pytest.approx(1e-1)
    assert all(step.status.solved for step in result.steps if step.status is not None)


@with_ipopt
def test_one_iteration_is_no_success():
    m = existing_model()
    # Without polish: a branch of a small problem may well be solved in one iteration.
    result = rcp.solve(m, options={"max_iter": 1}, polish=False)
    assert not any(step.status.solved for step in result.steps if step.status is not None)
    assert result.quality is not rcp.Quality.OPTIMAL
    with pytest.raises(rcp.errors.SolveFailed):
        result.raise_for_status()
