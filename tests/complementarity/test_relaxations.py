"""Relaxations as numbers: formulas, limits, nested sets, symmetry and equivalences, without a model or a solver."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pyrobocop_pyomo.complementarity import (
    ChenHarkerKanzowSmale,
    Elastic,
    FischerBurmeister,
    KanzowSchwartz,
    Scholtes,
    SteffensenUlbrich,
)
from pyrobocop_pyomo.complementarity.relaxations import RELAXATIONS, as_relaxation

BOUNDING = [
    Scholtes(),
    SteffensenUlbrich(),
    KanzowSchwartz(),
    FischerBurmeister(),
    ChenHarkerKanzowSmale(),
    Elastic(),
]

sides = st.floats(0, 10)
signed = st.floats(-2, 10)
deltas = st.floats(1e-3, 1.0)


def accepts(relaxation, a, b, delta, margin=0.0):
    """Whether the relaxed set holds the point; with a margin, whether it does so beyond rounding."""
    return max(relaxation.residual(a, b, delta), -a, -b) <= margin


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed, delta=deltas)
def test_floats_arrays_and_expressions_give_the_same_numbers(relaxation, a, b, delta):
    """The formulas themselves are in the documentation: tests/docs/test_relaxation_formulas.py compares with them."""
    expected = relaxation.residual(a, b, delta)
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(initialize=a), pyo.Var(initialize=b)
    m.delta = pyo.Param(initialize=delta, mutable=True)
    arrays = relaxation.residual(np.array([a, a]), np.array([b, b]), delta)
    found = [pyo.value(relaxation.residual(m.a, m.b, m.delta)), *arrays]
    assert found == pytest.approx([expected] * 3, abs=1e-9)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed, delta=deltas)
def test_swapping_the_sides_changes_nothing(relaxation, a, b, delta):
    assert relaxation.residual(a, b, delta) == pytest.approx(relaxation.residual(b, a, delta), abs=1e-12)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(size=sides, delta=deltas)
def test_the_relaxed_set_holds_the_pairs(relaxation, size, delta):
    assert accepts(relaxation, 0.0, size, delta, margin=1e-12)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed, delta=deltas, part=st.floats(0.05, 1))
def test_a_smaller_delta_accepts_fewer_points(relaxation, a, b, delta, part):
    if accepts(relaxation, a, b, part * delta):
        assert accepts(relaxation, a, b, delta, margin=1e-9)


@pytest.mark.parametrize("relaxation", BOUNDING, ids=str)
@given(a=signed, b=signed)
def test_in_the_limit_only_the_pairs_are_accepted(relaxation, a, b):
    assume(abs(min(a, b)) > 0.01)  # away from them
    assert not accepts(relaxation, a, b, 1e-6)


@given(a=signed, b=signed, delta=deltas)
def test_kanzow_and_schwartz_bound_the_smaller_side(a, b, delta):
    assume(abs(min(a, b) - delta) > 1e-9)
    assert (KanzowSchwartz().residual(a, b, delta) <= 0) == (min(a, b) <= delta)


@pytest.mark.parametrize("other", [FischerBurmeister(), ChenHarkerKanzowSmale()], ids=str)
@given(a=sides, b=sides, delta=deltas)
def test_both_roots_accept_what_the_product_accepts(other, a, b, delta):
    assume(abs(a * b - delta) > 1e-9 * (1 + a + b) ** 2)
    assert (other.residual(a, b, delta) <= 0) == (Scholtes().residual(a, b, delta) <= 0)


@pytest.mark.parametrize("other", [FischerBurmeister(), ChenHarkerKanzowSmale()], ids=str)
@given(a=st.floats(0.01, 100), delta=deltas)
def test_both_roots_vanish_where_the_product_is_delta(other, a, delta):
    b = delta / a
    assert other.residual(a, b, delta) == pytest.approx(0.0, abs=1e-12 * (a + b))
    assert other.residual(a, 1.1 * b, delta) > 0 > other.residual(a, 0.9 * b, delta)


@given(a=sides, b=sides)
def test_the_smoothed_minimum_is_twice_the_minimum_at_zero(a, b):
    assert ChenHarkerKanzowSmale().residual(a, b, 0.0) == pytest.approx(2 * min(a, b), abs=1e-12)


@given(delta=deltas, sign=st.sampled_from([-1, 1]))
def test_the_kink_meets_the_absolute_value_with_two_derivatives(delta, sign):
    """The residual is a + b - phi(a - b): along a = t, b = -t it is -phi(2 t)."""

    def phi(z):
        return -SteffensenUlbrich().residual(z / 2, -z / 2, delta)

    step = 1e-4 * delta
    inside, edge, outside = (phi(sign * (delta + k * step)) for k in (-1, 0, 1))
    assert edge == pytest.approx(delta)
    assert (outside - inside) / (2 * step) == pytest.approx(1.0, abs=1e-6)
    # The third derivative jumps by -3 / delta^2: the second difference vanishes with the step.
    assert abs(outside - 2 * edge + inside) / step**2 <= 3.1 * step / delta**2


def test_words_stand_for_objects():
    assert as_relaxation("kanzow_schwartz") == as_relaxation("kanzow-schwartz") == KanzowSchwartz()
    assert as_relaxation("linf") == as_relaxation("elastic") == Elastic()
    for word in RELAXATIONS:
        assert as_relaxation(word) == as_relaxation(as_relaxation(word))
        hash(as_relaxation(word))


def test_numbers_that_make_no_relaxation_are_refused():
    with pytest.raises(ValueError, match="must be positive"):
        Elastic(excess_bound=0)
