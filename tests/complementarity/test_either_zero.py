"""A side with a sign against a side of any sign: one of both is zero, and nothing else is asked of the second."""

from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import integrator, one_phase
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import canonical_form, pair_residuals, pairs_of
from pyrobocop_pyomo.complementarity.replaced_rows import is_zero_product
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import nl_text, state


def nearest(c0: float, h0: float, **bounds: float) -> pyo.ConcreteModel:
    """The nearest point to (c0, h0) on the union of the half line h = 0, c >= 0 and the line c = 0."""
    m = pyo.ConcreteModel()
    m.c, m.h = pyo.Var(initialize=0.5, **bounds), pyo.Var(initialize=0.1)
    m.either = rcp.Complementarity(expr=rcp.either_zero(m.c >= 0, 2.0 * m.h))
    m.cost = pyo.Objective(expr=(m.c - c0) ** 2 + (m.h - h0) ** 2)
    return m


@given(c=st.floats(0, 5), h=st.floats(-5, 5))
def test_residuals_are_those_of_the_product_with_the_size_of_the_free_side(c, h):
    m = nearest(0, 0)
    m.c, m.h = c, h
    residuals = pair_residuals(pairs_of(m))
    assert max(abs(residual.product) for residual in residuals) == pytest.approx(c * abs(2.0 * h), rel=1e-12)
    assert max(abs(residual.natural) for residual in residuals) == pytest.approx(min(c, abs(2.0 * h)), rel=1e-12)
    assert [residual.name for residual in residuals] == ["either (positive)", "either (negative)", "either (sign)"]


@pytest.mark.ipopt
@pytest.mark.parametrize(
    ("relaxation", "c0", "h0", "expected"),
    [
        ("scholtes", 3.0, 1.0, (3.0, 0.0)),
        ("fischer-burmeister", 1.0, 3.0, (0.0, 3.0)),
        ("penalty", 1.0, -3.0, (0.0, -3.0)),
        ("scholtes", -1.0, -3.0, (0.0, -3.0)),
    ],
)
def test_the_nearest_point_is_found_and_certified(relaxation, c0, h0, expected):
    m = nearest(c0, h0)
    result = rcp.solve(m, strategies=rcp.Strategy(relaxation=relaxation))
    assert result.quality is rcp.Quality.OPTIMAL
    assert (m.c.value, m.h.value) == pytest.approx(expected, abs=1e-6)
    assert result.certificate.name == "PROVEN"


@pytest.mark.ipopt
def test_a_decided_pair_is_decided_before_the_solve():
    m = nearest(3.0, 1.0)
    m.h.setlb(0.5)
    result = rcp.solve(m)
    assert (m.c.value, m.h.value) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert result.quality is rcp.Quality.OPTIMAL


def test_it_is_stated_in_a_phase_and_verified():
    _, b = one_phase("move", duration=1.0, elements=2, scheme="implicit_euler")
    b.x, b.force = rcp.State(initial=0.0), rcp.Control(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.force[t] - 1.0})

    b.complementarity(lambda b, t: rcp.either_zero(b.force[t] >= 0, b.x[t]), name="sticking")

    times = list(b.time)
    for t, (x, force) in zip(times, [(0.0, 0.0), (0.0, 1.0), (-0.5, 0.0)], strict=True):
        b.x[t].set_value(x)
        if t > 0:
            b.force[t].set_value(force)
    verification = b.trajectory().verify()
    assert verification.natural_residual < 1e-12
    b.x[times[1]].set_value(-0.25)
    assert b.trajectory().verify().product == pytest.approx(0.25)


def test_a_plain_variable_with_one_bound_is_a_first_side_and_a_bounded_one_a_second():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, None)), pyo.Var(bounds=(-1, 2))
    m.either = rcp.Complementarity(expr=rcp.either_zero(m.x, m.y))
    form = canonical_form(m.either)
    assert [pair.a for pair in form.pairs] == [m.x, m.x, m.y]
    m.x.setub(5)
    with pytest.raises(ComplementarityError, match="two finite bounds"):
        canonical_form(m.either)
    m.other = rcp.Complementarity(expr=rcp.either_zero(m.x, m.y, first_bound="upper"))
    m.x, m.y = 4.0, 0.0
    assert pyo.value(canonical_form(m.other).pairs[0].a) == 1.0


# --------------------------------------------------------------------
# Rows that say that a product is zero, and no other row is taken for one.


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
    m, b = integrator(x={"initial": 0.0}, elements=4, scheme="implicit_euler")
    b.r = rcp.Control(bounds=(0, 1))
    b.constraint(lambda b, t: {"limit": b.u[t] <= 1, "switch": b.r[t] * (b.u[t] - 1) == 0}, name="rows")
    m.cost = pyo.Objective(expr=b.final_time - b.x[b.final_time])
    found = [finding for finding in rcp.diagnose(m).findings if "product is zero" in finding.message]
    assert ["rcp.either_zero(" in finding.remedy and finding.components == ("p.rows",) for finding in found] == [True]


# --------------------------------------------------------------------
# Absolute values as two parts: the same values, known optima, pairs only where they are needed, and the way back.


SPLIT = pyo.TransformationFactory("pyrobocop.absolute_values_to_complementarity")


def kinked() -> pyo.ConcreteModel:
    """Absolute values within each other, in rows of each kind, shared, in a named expression, and two that stay."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0.3), pyo.Var(initialize=-0.4)
    m.size = pyo.Var(bounds=(1, 2), initialize=1.5)
    m.weight = pyo.Param(initialize=3.0, mutable=True)
    m.distance = pyo.Expression(expr=abs(m.x - 0.5) + abs(m.y))
    m.rows = pyo.ConstraintList()
    m.rows.add(abs(abs(m.x) - 1) + m.distance == 2)
    m.rows.add((-1, m.y - 2 * abs(m.x * m.y), 4))
    m.rows.add(m.weight * abs(m.x) <= m.size)
    m.rows.add(m.x * abs(m.x) + abs(m.size) <= 3)  # stays: a continuous derivative, and a variable above zero
    m.cost = pyo.Objective(expr=m.size * m.distance + (m.x - 2) ** 2)
    return m


def values(m: Any) -> list[float]:
    """Of all rows and objectives that the user wrote."""
    return [*(pyo.value(row.body) for row in m.rows.values()), pyo.value(m.cost)]


@given(x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_with_its_parts_each_row_has_the_value_that_it_had(x: float, y: float) -> None:
    m = kinked()
    m.x, m.y = x, y
    before = values(m)
    token = SPLIT.apply_to(m)
    assert values(m) == pytest.approx(before, abs=1e-12)
    for i, row in token.blocks[0].difference.items():
        assert pyo.value(row.body) == pytest.approx(pyo.value(row.upper), abs=1e-12)
        assert token.blocks[0].positive[i].value * token.blocks[0].negative[i].value == 0.0
        assert min(token.blocks[0].positive[i].value, token.blocks[0].negative[i].value) >= 0.0


def test_the_way_back_is_complete() -> None:
    m = kinked()
    before, text = state(m), nl_text(m)
    token = SPLIT.apply_to(m)
    assert len(token.blocks[0].positive) == 5  # x, |x| - 1, x - 0.5, y, x * y
    assert "abs(" not in "".join(str(m.rows[i].expr) for i in (1, 2, 3)) + str(m.cost.expr)
    assert "abs(" in str(m.rows[4].expr)
    copy = m.clone()
    SPLIT.revert(m, token)
    SPLIT.revert(copy)
    assert state(m) == state(copy) == before
    assert nl_text(m) == nl_text(copy) == text
    with pytest.raises(ComplementarityError, match="nothing to revert"):
        SPLIT.revert(m)


def test_applications_that_build_on_each_other_are_undone_together() -> None:
    m = kinked()
    text = nl_text(m)
    SPLIT.apply_to(m, targets=[m.rows[1]])
    SPLIT.apply_to(m, targets=[m.rows, m.cost])
    SPLIT.revert(m)
    assert nl_text(m) == text


def test_what_holds_none_is_named() -> None:
    m = kinked()
    with pytest.raises(ComplementarityError, match=r"no active row or objective in the targets holds abs"):
        SPLIT.apply_to(m, targets=[m.rows[4]])
    with pytest.raises(ComplementarityError, match="a target is one of Block, Constraint, Objective, or"):
        SPLIT.apply_to(m, targets=[m.x])
    assert m.component("absolute_values_as_pairs") is None


# The statement, and whether a sum of parts above the absolute value could be of use.
USES: dict[str, tuple[Callable[[Any], Any], bool]] = {
    "cost": (lambda m: abs(m.x), False),
    "cost with a number": (lambda m: 3 * (1 + abs(m.x - m.y)) / 2, False),
    "cost with a duration": (lambda m: m.duration * abs(m.x) - m.loss * abs(m.y) / m.duration, False),
    "cost within a sum that is subtracted": (lambda m: m.y**2 - (m.y - 2 * abs(m.x)), False),
    "gain": (lambda m: m.x**2 - abs(m.x), True),
    "cost with a factor of any sign": (lambda m: m.y * abs(m.x) + m.y**2, True),
    "square": (lambda m: (abs(m.x) - 1) ** 2, True),
    "divisor": (lambda m: 1 / (1 + abs(m.x)), True),
    "upper bound": (lambda m: abs(m.x) + m.y <= 1, False),
    "lower bound of minus": (lambda m: m.y - abs(m.x) >= -1, False),
    "lower bound": (lambda m: abs(m.x) >= 1, True),
    "both bounds": (lambda m: (0.5, abs(m.x), 1), True),
    "equation": (lambda m: abs(m.x) == m.y, True),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_pairs_are_made_only_where_a_larger_sum_could_be_of_use(use: str, mirrored: bool) -> None:
    statement, needed = USES[use]
    m = pyo.ConcreteModel()
    m.x, m.y, m.duration, m.loss = pyo.Var(), pyo.Var(), pyo.Var(bounds=(1, 2)), pyo.Var(bounds=(-2, 0))
    stated = statement(m)
    if isinstance(stated, tuple) or stated.is_relational():
        m.row = pyo.Constraint(expr=stated)
        m.cost = pyo.Objective(expr=m.x)
    else:
        m.cost = pyo.Objective(expr=-stated if mirrored else stated, sense=pyo.maximize if mirrored else pyo.minimize)
    SPLIT.apply_to(m)
    assert bool(rcp.active_pairs(m)) == needed


@pytest.mark.ipopt
@pytest.mark.parametrize("weight", [1.0, 5.0, -1.0])
def test_soft_thresholds(weight: float) -> None:
    """``min (x - 2)**2 + w |x|`` is at ``2 - w / 2``, and at zero from ``w = 4`` on."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + weight * abs(m.x))
    token = SPLIT.apply_to(m)
    rcp.solve(m, progress=False).raise_for_status()
    assert m.x.value == pytest.approx(max(2 - weight / 2, 0.0), abs=1e-6)
    parts = pyo.value(token.blocks[0].positive[0] + token.blocks[0].negative[0])
    assert parts == pytest.approx(abs(m.x.value), abs=1e-6)
    SPLIT.revert(m)
    assert pyo.value(m.cost) == pytest.approx((m.x.value - 2) ** 2 + weight * abs(m.x.value))
