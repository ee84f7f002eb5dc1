"""Rows that say that a product is zero, as pairs: the same points, the way back, and no other row is touched."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from contact_tasks import hopper
from hypothesis import given
from hypothesis import strategies as st
from mpcc_catalogue.point_check import check_point, read_pairs

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import ProductsToComplementarity
from pyrobocop_pyomo.complementarity.switched_products import as_line, pair_of_factors, zero_product
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import nl_text, state


@pytest.fixture
def switch() -> ProductsToComplementarity:
    return pyo.TransformationFactory("pyrobocop.products_to_complementarity")


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


def test_the_rewritten_line_is_what_a_user_would_write() -> None:
    rows = [zero_product(row) for row in switched().rows.values()]
    pairs = [None if factors is None else pair_of_factors(*factors) for factors in rows]
    assert [None if pair is None else as_line(pair) for pair in pairs] == [
        "rcp.either_zero(a >= 0, x - y)",
        "rcp.either_zero(a >= 0, x)",
        "rcp.complements(a >= 0, b <= 0)",
        "rcp.either_zero(a >= 0, x)",
        None,
        None,
    ]


# Numbers whose products do not underflow: zero, or large enough.
numbers = st.one_of(st.just(0.0), st.floats(0.01, 3.0))


@given(a=numbers, b=numbers, x=numbers, y=numbers, signs=st.tuples(st.sampled_from([-1, 1]), st.sampled_from([-1, 1])))
def test_points_that_meet_the_rows_are_those_that_meet_the_pairs(a: float, b: float, x: float, y: float, signs: Any):
    m = switched()
    m.a, m.b, m.x, m.y = a, -b, signs[0] * x, signs[1] * y
    rows = list(m.rows.values())[:4]
    meets_rows = all(abs(pyo.value(row.body)) < 1e-9 for row in rows)
    pyo.TransformationFactory("pyrobocop.products_to_complementarity").apply_to(m)
    assert (max(pair.natural() for pair in read_pairs(m)) < 1e-9) == meets_rows


def test_the_way_back_is_complete(switch: ProductsToComplementarity) -> None:
    m = switched()
    before, text = state(m), nl_text(m)
    token = switch.apply_to(m)
    assert [row.active for row in m.rows.values()] == [False] * 4 + [True] * 2
    assert switch.source_of(next(iter(token.block.pairs.values()))) is m.rows[1]
    copy = m.clone()
    switch.revert(m, token)
    switch.revert(copy)
    assert state(m) == state(copy) == before
    assert nl_text(m) == nl_text(copy) == text
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        switch.revert(m)


def test_a_copy_is_made_and_the_model_stays(switch: ProductsToComplementarity) -> None:
    m = switched()
    before = state(m)
    made = switch.create_using(m)
    assert state(m) == before
    assert len(rcp.active_pairs(made)) > 0


def test_targets_are_taken_and_others_left(switch: ProductsToComplementarity) -> None:
    m = switched()
    switch.apply_to(m, targets=[m.rows[3]])
    assert [row.active for row in m.rows.values()] == [True, True, False, True, True, True]
    switch.apply_to(m, targets=[m.rows])  # a second application has its own block
    assert [row.active for row in m.rows.values()] == [False] * 4 + [True] * 2
    with pytest.raises(ComplementarityError, match=r"no active row in the targets.*bounds=\(0, None\)"):
        switch.apply_to(m, targets=[m.rows[5]])
    with pytest.raises(ComplementarityError, match="neither a block nor a constraint"):
        switch.apply_to(m, targets=[m.a])
    switch.revert(m)
    assert all(row.active for row in m.rows.values())


def test_rows_of_a_phase_keep_their_families(switch: ProductsToComplementarity) -> None:
    m = hopper(0, products=True)
    token = switch.apply_to(m)
    families = [pair.family for pair in token.block.pairs.values()]
    assert len(set(families)) == 3
    assert len(families) == 3 * sum(1 for _ in m.b.points)


def test_a_diagnosis_shows_the_line_wherever_it_stands_in_a_rule() -> None:
    m = pyo.ConcreteModel()
    m.b = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x, b.u, b.r = rcp.State(initial=0.0), rcp.Control(), rcp.Control(bounds=(0, 1))
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.constraint(lambda b, t: {"limit": b.u[t] <= 1, "switch": b.r[t] * (b.u[t] - 1) == 0}, name="rows")
    m.cost = pyo.Objective(expr=b.final_time - b.x[b.final_time])
    remedies = [finding.remedy for finding in rcp.diagnose(m).findings if "product is zero" in finding.message]
    assert ["rcp.either_zero(b.r[0.25] >= 0, b.u[0.25] - 1)" in remedy for remedy in remedies] == [True]


@pytest.mark.ipopt
@pytest.mark.slow
def test_the_hopper_with_products_is_solved_as_the_one_with_pairs(switch: ProductsToComplementarity) -> None:
    stated, m = hopper(0), hopper(0, products=True)
    switch.apply_to(m)
    result = rcp.solve(m, progress=False)
    assert result.certificate is rcp.Certificate.PROVEN
    for variable in stated.component_data_objects(pyo.Var):
        variable.set_value(m.find_component(variable).value, skip_validation=True)
    point = check_point(stated)
    assert point.violation <= 1e-6
    assert point.natural <= 1e-6
    switch.revert(m)
    assert check_point(m).violation <= 1e-6
