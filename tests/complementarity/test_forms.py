"""All forms of a statement: what each means, checked by its projection formula and not by our own pairs."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pyomo.mpec as mpec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpcc_catalogue.branches import enumerate_branches

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import (
    Complementarity,
    SidePart,
    active_pairs,
    canonical_form,
    complements,
    pair_residuals,
    rows_of,
    shifted_rows_of,
    side_values,
)
from pyrobocop_pyomo.errors import ComplementarityError

from .harness import RELAX, state

BOTH = pytest.mark.parametrize("component", [Complementarity, mpec.Complementarity], ids=["ours", "pyomo.mpec"])
whole = st.integers(-3, 3)


def two_variables(f: float = 0.0, h: float = 0.0) -> Any:
    m = pyo.ConcreteModel()
    m.f, m.h = pyo.Var(initialize=f), pyo.Var(initialize=h)
    m.lo, m.up = pyo.Param(initialize=-1, mutable=True), pyo.Param(initialize=2, mutable=True)
    return m


def row_holds(row: Any) -> bool:
    return bool(pyo.value(row))


def met(form: Any) -> bool:
    """Whether the canonical form holds exactly, its rows included."""
    rows = [row for pair in form.pairs for row in (pair.a_row, pair.b_row) if row is not None]
    return all(map(row_holds, (*rows, *form.rows))) and all(
        residual.natural == 0 for residual in pair_residuals(form.pairs)
    )


def projection_holds(f: float, h: float, lower: float, upper: float) -> bool:
    """``l <= F <= u ⟂ H`` is ``F = mid(l, F - H, u)``, one equation for all bounds, infinite ones included."""
    return f == min(max(f - h, lower), upper)


# ---- meaning


@given(f=whole, h=whole, lower=whole, width=st.integers(1, 3), scale=st.sampled_from([1, 2]))
def test_a_range_is_met_where_the_projection_formula_holds(f, h, lower, width, scale):
    m = two_variables(f, h)
    m.cc = Complementarity(expr=complements(pyo.inequality(lower, scale * m.f, lower + width), m.h + 0 * m.f))
    assert met(canonical_form(m.cc)) == projection_holds(scale * f, h, lower, lower + width)


@given(f=whole, h=whole, which=st.sampled_from(["lower", "upper", "none"]))
def test_an_infinite_bound_of_a_range_counts_as_none(f, h, which):
    lower = -1 if which == "upper" else -math.inf
    upper = 2 if which == "lower" else math.inf
    m = two_variables(f, h)
    # What is left is one bound, and the sign of the other side is that of the projection formula.
    other = m.h >= 0 if which == "upper" else m.h <= 0
    m.cc = Complementarity(expr=complements(pyo.inequality(lower, m.f, upper), other))
    if which == "none":
        with pytest.raises(ComplementarityError, match="'cc': "):
            canonical_form(m.cc)
        return
    (pair,) = canonical_form(m.cc).pairs
    assert pair.b_part is SidePart.WHOLE
    assert met(canonical_form(m.cc)) == projection_holds(f, h, lower, upper)


@given(f=whole, h=whole, sign=st.sampled_from([1, -1]), swapped=st.booleans())
def test_a_range_against_a_signed_side_adds_the_sign(f, h, sign, swapped):
    m = two_variables(f, h)
    sides = (pyo.inequality(-1, m.f, 2), m.h >= 0 if sign == 1 else m.h <= 0)
    m.cc = Complementarity(expr=complements(*(sides[::-1] if swapped else sides)))
    form = canonical_form(m.cc)
    assert (len(form.pairs), len(form.rows)) == (1, 1)
    assert met(form) == (projection_holds(f, h, -1, 2) and sign * h >= 0)


@given(f=whole, h=whole)
def test_an_equality_holds_and_leaves_the_other_side_free(f, h):
    m = two_variables(f, h)
    ranged = pyo.inequality(2, m.f, 2)
    for number, sides in enumerate(
        [(m.f == 2, m.h), (m.h + m.f, m.f == 2), (m.f + m.h == 2 + m.h, m.h), (ranged, m.h)]
    ):
        m.add_component(f"cc{number}", Complementarity(expr=complements(*sides)))
        form = canonical_form(m.component(f"cc{number}"))
        assert form.pairs == ()
        assert met(form) == (f == 2)


@BOTH
@given(f=whole, h=whole, lower=whole, upper=whole)
def test_mutable_bounds_are_followed(component, f, h, lower, upper):
    m = two_variables(f, h)
    m.cc = component(expr=(pyo.inequality(m.lo, m.f, 2 * m.up), m.h))
    form = canonical_form(m.cc)
    m.lo.set_value(lower)
    m.up.set_value(upper)
    if lower < 2 * upper:
        assert met(form) == projection_holds(f, h, lower, 2 * upper)


def test_a_named_expression_is_followed_on_both_sides():
    m = two_variables(0, 3)
    m.range, m.free = pyo.Expression(expr=m.f), pyo.Expression(expr=0.0)
    m.cc = Complementarity(expr=complements(pyo.inequality(m.lo, m.range, m.up), m.free))
    form = canonical_form(m.cc)
    assert met(form)
    m.free.set_value(m.h)
    assert not met(form)
    m.range.set_value(m.f - 1)
    assert met(form)


@pytest.mark.parametrize("fixed", [(), ("f",), ("h",), ("f", "h")], ids=str)
def test_fixing_variables_changes_nothing_about_the_form(fixed):
    m = two_variables(1, 2)
    m.x = pyo.Var(bounds=(0, 1), initialize=1)
    m.statements = Complementarity([1, 2, 3, 4])
    for name in fixed:
        m.component(name).fix()
    m.statements[1] = complements(pyo.inequality(m.lo, m.f, m.up), m.h)
    m.statements[2] = complements(m.f == 1, m.h)
    m.statements[3] = complements(m.h <= 0, pyo.inequality(m.lo, m.f, m.up))
    m.statements[4] = complements(m.x, m.f - m.h)
    forms = [canonical_form(m.statements[i]) for i in (1, 2, 3, 4)]
    assert [(len(form.pairs), len(form.rows)) for form in forms] == [(2, 0), (0, 1), (1, 1), (2, 0)]


# ---- what a plain variable's own bounds mean


def test_own_bounds_of_a_free_side_are_just_bounds_when_asked_for():
    m = two_variables()
    m.speed = pyo.Var(bounds=(-10, 10))
    m.force = pyo.Var(bounds=(-1, 1))
    m.cc = Complementarity(expr=complements(m.force, m.speed, second_bound="free"))
    pairs = canonical_form(m.cc).pairs
    assert [pair.role for pair in pairs] == ["lower", "upper"]
    assert all(pair.b is m.speed and pair.a_row is None and pair.b_row is None for pair in pairs)


def test_in_pyomo_mpec_only_written_bounds_count_where_they_suffice():
    m = two_variables()
    m.speed = pyo.Var(bounds=(-10, 10))
    m.range = mpec.Complementarity(expr=mpec.complements(pyo.inequality(-1, m.f, 1), m.speed))
    m.equal = mpec.Complementarity(expr=mpec.complements(m.speed, m.f == 1))
    assert [pair.name for pair in active_pairs(m)] == ["range (lower)", "range (upper)"]
    m.own = mpec.Complementarity(expr=mpec.complements(m.speed, m.f))
    assert [pair.name for pair in active_pairs(m, [m.own])] == ["own (lower)", "own (upper)"]


# ---- relaxed


@given(f=st.floats(-1, 2), h=st.floats(-3, 3), delta=st.floats(1e-6, 1))
def test_the_rows_of_a_range_bound_what_h_is_beyond_zero_by_delta(f, h, delta):
    """Each row is the bound of one part's product; the parts are variables that start at the parts of H."""
    m = two_variables(f, h)
    m.cc = Complementarity(expr=complements(pyo.inequality(m.lo, m.f, m.up), m.h))
    RELAX.apply_to(m, delta=delta)
    *products, lower, parts, upper = rows_of(m.cc)  # the sides of the first part, and what makes both parts
    for row, residual in zip(products, RELAX.residuals(m), strict=True):
        assert pyo.value(row.body) == pytest.approx(residual.product)
    assert pyo.value(parts.body) == pytest.approx(0.0) == parts.ub
    assert (lower.lb, upper.ub) == (-1, 2)
    assert lower.body is upper.body is m.f
    assert [row.ub for row in shifted_rows_of(m)] == [delta, delta]


@pytest.mark.parametrize("options", [{"relaxation": "penalty"}, {"grouping": "element"}, {"lift": True}], ids=str)
def test_the_products_of_a_range_are_summed_and_penalised_like_others(options):
    """With its free side split into parts, none of which is negative, no product cancels another."""
    m = two_variables(-3, 4)
    m.range = Complementarity(expr=complements(pyo.inequality(m.lo, m.f, m.up), m.h))
    m.cost = pyo.Objective(expr=m.f)
    before = state(m)
    token = RELAX.apply_to(m, delta=0.5, **options)
    total = sum(residual.product for residual in RELAX.residuals(m))
    if options.get("relaxation") == "penalty":
        assert pyo.value(token.block.objective) == pytest.approx(m.f.value + total / 0.5)
    else:
        assert sum(pyo.value(row.body) for row in shifted_rows_of(m)) == pytest.approx(total)
    RELAX.revert(m, token)
    assert state(m) == before


# --------------------------------------------------------------------
# Every form against its branches.


with_ipopt = pytest.mark.asl


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


between = pyo.inequality
FORMS: dict[str, Callable[[Any], Any]] = {
    "single": lambda m: (m.x >= 0, m.y >= 0),
    "variables on both sides": lambda m: (m.x >= m.y, m.y >= 0),
    "one-sided upper": lambda m: (m.x <= m.up, m.y <= 1),
    "range": lambda m: (between(-1, m.x, 2), m.y + 0 * m.x),
    "range, mutable": lambda m: (between(m.lo, m.e, m.up), m.y + 0 * m.x),
    "range, nonlinear": lambda m: (between(-1, m.x**3, 2), m.y + 0 * m.x),
    "range, positive": lambda m: (between(-1, m.x, 2), m.y >= 0),
    "range, negative": lambda m: (m.y <= 0, between(-1, m.x, 2)),
    "plain variable": lambda m: (m.box, m.y + 0 * m.x),
    "equality": lambda m: (m.x + m.y == 1, m.x - m.y),
}


AIMS = ((-2.5, -1.5), (0.5, 1.5), (3.5, -1.5))


@pytest.mark.parametrize("form", FORMS)
def test_pyomo_mpec_and_this_package_mean_the_same(form):
    statement, m = FORMS[form], plane()
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
@pytest.mark.parametrize(("form", "aim"), [(form, AIMS[k % len(AIMS)]) for k, form in enumerate(FORMS)], ids=str)
def test_every_form_reaches_the_best_of_its_branches(form, aim):
    def stated(start: tuple[float, float]) -> Any:
        m = plane()
        m.aim.store_values(dict(enumerate(aim, start=1)))
        m.x, m.y = start
        m.cc = rcp.Complementarity(expr=FORMS[form](m))
        return m

    def reached(start: tuple[float, float]) -> float:
        m = stated(start)
        result = rcp.solve(m)
        result.raise_for_status()
        assert max((abs(residual.natural) for residual in result.residuals), default=0) <= 1e-4
        assert all(pyo.value(row.args[0] - row.args[1]) == pytest.approx(0, abs=1e-6) for row in equalities(m.cc))
        return result.objective

    # From a point inside: a solver that starts where a cube is flat does not get anywhere.
    best = enumerate_branches(stated((1.0, 0.5)), starts=1)[0]
    # A local solver may end in a worse branch than the best: it has three starts.
    assert any(reached(start) == pytest.approx(best, abs=2e-4) for start in (aim, (0.5, 0.5), (1.9, -0.5)))


def equalities(source: Any) -> list[Any]:
    return [row for row in canonical_form(source).rows if len(row.args) == 2 and not canonical_form(source).pairs]
