"""Laws of the collocation schemes: exactness, order, symmetry."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import (
    Scheme,
    differentiation_matrix,
    evaluation_matrix,
    find_scheme,
    gauss_legendre,
    integration_matrix,
    lobatto,
    radau,
)

STAGES = (1, 2, 3, 5, 12)
SCHEMES = [scheme(s) for scheme in (radau, gauss_legendre) for s in STAGES]
LOBATTO = [lobatto(s) for s in STAGES[1:]]
EXPLICIT = [find_scheme("explicit_euler"), Scheme.from_points("left", [0, 2 / 3])]


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_state_polynomials_are_differentiated_exactly(scheme: Scheme) -> None:
    for degree in range(scheme.stages + 1):
        values = scheme.state_nodes**degree
        expected = degree * scheme.c ** max(degree - 1, 0)
        np.testing.assert_allclose(scheme.D @ values, expected, atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_quadrature_is_exact_below_the_order(scheme: Scheme) -> None:
    for degree in range(scheme.order):
        assert scheme.b @ scheme.c**degree == pytest.approx(1 / (degree + 1), abs=1e-13)


@pytest.mark.parametrize("stages", STAGES)
def test_computed_order_is_the_known_one(stages: int) -> None:
    assert radau(stages).order == 2 * stages - 1
    assert gauss_legendre(stages).order == 2 * stages


def test_order_is_computed_from_the_points_and_not_from_the_name() -> None:
    # One doubled digit in the middle point of radau(3): the order drops from 5 to 3.
    assert Scheme.from_points("typed", [0.155051, 0.6444949, 1.0]).order == 3


@settings(deadline=None)
@example(nodes=[0, 1], coefficients=[1.0], at=5e-324)
@given(
    nodes=st.lists(st.integers(0, 100), min_size=2, max_size=8, unique=True),
    coefficients=st.lists(st.floats(-3, 3), min_size=1, max_size=8),
    at=st.floats(0, 1),
)
def test_lagrange_matrices_reproduce_any_polynomial(nodes: list[int], coefficients: list[float], at: float) -> None:
    tau = np.sort(np.array(nodes) / 100)
    polynomial = np.polynomial.Polynomial(coefficients[: len(tau)])
    scale = 1e-6 * (1 + np.abs(evaluation_matrix(tau, [at])).max())
    assert (evaluation_matrix(tau, [at]) @ polynomial(tau))[0] == pytest.approx(polynomial(at), abs=scale)
    slope_scale = 1e-9 * (1 + np.abs(differentiation_matrix(tau)).max() ** 2)
    np.testing.assert_allclose(differentiation_matrix(tau) @ polynomial(tau), polynomial.deriv()(tau), atol=slope_scale)
    area_scale = 1e-9 * (1 + np.abs(integration_matrix(tau, [at])).max())
    area = polynomial.integ()(at) - polynomial.integ()(0.0)
    assert (integration_matrix(tau, [at]) @ polynomial(tau))[0] == pytest.approx(area, abs=area_scale)


@pytest.mark.parametrize("gap", [0.0, 5e-324, 1e-250, 1e-150])
def test_next_to_a_node_its_value_is_the_value(gap: float) -> None:
    assert evaluation_matrix([0.0, 0.5, 1.0], [gap]).tolist() == [[1.0, pytest.approx(0), pytest.approx(0)]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("runge", 3), "unknown scheme 'runge'; known are 'radau', 'gauss'"),
        (("radau", 0), "radau: stages = 0; expected an integer of at least 1"),
        (("gauss", 2.0), r"gauss: stages = 2\.0; expected an integer"),
        (("implicit_euler", 2), "'implicit_euler' has 1 stage, but stages = 2"),
        ((radau(2), 3), r"radau\(2\) has 2 stages, but stages = 3"),
    ],
)
def test_a_scheme_that_does_not_exist_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        find_scheme(*arguments)


def test_points_that_do_not_increase_are_refused() -> None:
    with pytest.raises(ModelError, match="must strictly increase"):
        Scheme.from_points("mine", [0.5, 0.2])


@pytest.mark.parametrize("scheme", [*SCHEMES, *LOBATTO, *EXPLICIT], ids=str)
def test_every_scheme_is_its_tableau_in_one_form_of_rows(scheme: Scheme) -> None:
    """``D x = h F f`` and the end weights hold for what the Runge-Kutta form gives, for arbitrary right-hand sides."""
    rng = np.random.default_rng(scheme.stages)
    rates, start, width = rng.standard_normal(scheme.stages), rng.standard_normal(), 0.3
    stage_values = start + width * scheme.A @ rates
    end = start + width * scheme.b @ rates
    values = {0.0: start, 1.0: end, **dict(zip(scheme.c.tolist(), stage_values, strict=True))}
    nodes = np.array([values[tau] for tau in scheme.state_nodes.tolist()])
    np.testing.assert_allclose(scheme.D @ nodes, width * scheme.F @ rates, atol=1e-9)
    assert scheme.end_weights @ nodes == pytest.approx(end, abs=1e-10)
    assert [scheme.F[row, stage] for row, stage in enumerate(scheme.row_stages)] == [1.0] * len(scheme.D)


@pytest.mark.parametrize("scheme", LOBATTO, ids=str)
def test_lobatto_is_symmetric_of_its_order_and_shares_its_ends(scheme: Scheme) -> None:
    assert scheme.order == 2 * scheme.stages - 2
    assert (scheme.c[0], scheme.c[-1]) == (0.0, 1.0)
    assert scheme.starts_on_a_stage
    assert scheme.stiffly_accurate
    np.testing.assert_allclose(scheme.c + scheme.c[::-1], 1.0, atol=1e-15)
    np.testing.assert_allclose(scheme.b, scheme.b[::-1], atol=1e-14)


def test_named_members_are_the_textbook_ones() -> None:
    trapezoid, simpson = find_scheme("trapezoid"), find_scheme("hermite_simpson")
    np.testing.assert_allclose(trapezoid.A, [[0, 0], [0.5, 0.5]], atol=1e-15)
    np.testing.assert_allclose(simpson.A, [[0, 0, 0], [5 / 24, 1 / 3, -1 / 24], [1 / 6, 2 / 3, 1 / 6]], atol=1e-15)
    assert [scheme.order for scheme in EXPLICIT] == [1, 3]
    with pytest.raises(ModelError, match="lobatto: stages = 1; expected an integer of at least 2"):
        lobatto(1)
