"""Taylor forms and Bernstein coefficients contain all values, slopes and curvatures that sampling finds."""

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.numerics.interval_arithmetic import (
    TAYLOR_FUNCTIONS,
    Interval,
    TaylorForm,
    taylor_form_of_polynomial,
)
from pyrobocop_pyomo.numerics.polynomials import (
    bernstein_matrix,
    derivative_coefficients,
    restrict,
)

SAMPLES = 1000

ONE_ARGUMENT = [
    lambda a: pyo.sin(a),
    lambda a: pyo.cos(a),
    lambda a: pyo.exp(pyo.sin(a)),
    lambda a: pyo.atan(a),
    lambda a: pyo.sqrt(1.0 + a**2),
    lambda a: pyo.log(2.0 + pyo.cos(a)),
    lambda a: pyo.tan(0.5 * pyo.sin(a)),
    lambda a: a**3,
    lambda a: a**2,
    lambda a: (1.5 + a**2) ** -1.25,
    lambda a: -a,
    lambda a: 3.0 * a - 2.0,
    lambda a: 1.0 / (3.0 + pyo.sin(a)),
    lambda a: a * a,
]
TWO_ARGUMENTS = [
    lambda a, b: a + b,
    lambda a, b: a - b,
    lambda a, b: a * b,
    lambda a, b: a / (2.5 + pyo.cos(b)),
    lambda a, b: a * pyo.cos(b) - b * pyo.sin(a),
]


def model() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(initialize=0.0), pyo.Var(initialize=0.0)
    return m


def formula(m: pyo.ConcreteModel, choices: list[int]) -> object:
    """A formula in two variables, built up by the choices."""
    made = [m.a, m.b]
    for choice in choices:
        if choice % 3:
            made.append(ONE_ARGUMENT[choice % len(ONE_ARGUMENT)](made[-1]))
        else:
            made.append(TWO_ARGUMENTS[choice % len(TWO_ARGUMENTS)](made[-1], made[choice % len(made)]))
    return made[-1]


def forms_of(signals: dict[int, np.ndarray], start: float, end: float) -> dict[int, TaylorForm]:
    """Of polynomials on a subinterval, from their coefficients."""
    forms = {}
    for key, coefficients in signals.items():
        slopes = derivative_coefficients(coefficients)
        triple = (coefficients, slopes, derivative_coefficients(slopes))
        forms[key] = taylor_form_of_polynomial(tuple(restrict(order, [start], [end]) for order in triple))
    return forms


@settings(max_examples=100)
@given(
    choices=st.lists(st.integers(0, 2 * 3 * 5 * 7 * 9), min_size=1, max_size=4),
    degree=st.integers(1, 5),
    seed=st.integers(0, 10**6),
    start=st.floats(0, 0.9),
    width=st.floats(0.02, 1.0),
)
def test_taylor_forms_contain_all_samples(
    choices: list[int], degree: int, seed: int, start: float, width: float
) -> None:
    end = min(start + width, 1.0)
    m = model()
    expression = formula(m, choices)
    random = np.random.default_rng(seed)
    signals = {id(v): random.normal(size=(1, degree + 1)) for v in (m.a, m.b)}
    form = ExpressionSteps([expression]).evaluate_at(forms_of(signals, start, end), TAYLOR_FUNCTIONS)[0]

    at = np.linspace(start, end, SAMPLES)
    step = at[1] - at[0]
    basis = bernstein_matrix(degree, at)
    found = ExpressionSteps([expression]).evaluate_at(
        {key: basis @ rows[0] for key, rows in signals.items()}, ARRAY_FUNCTIONS
    )[0]
    # By the mean value theorem divided differences are values of the derivatives; rounding is divided with them.
    rounding = 1e-12 * (1.0 + np.abs(found).max())
    slopes, curvatures = np.diff(found) / step, np.diff(found, 2) / step**2
    for values, interval, slack in (
        (found, form.value, rounding),
        (slopes, form.first, rounding / step),
        (curvatures, form.second, rounding / step**2),
    ):
        assert interval.low[0] - slack <= values.min()
        assert values.max() <= interval.high[0] + slack


@settings(max_examples=100)
@given(
    choices=st.lists(st.integers(0, 2 * 3 * 5 * 7 * 9), min_size=1, max_size=3),
    seed=st.integers(0, 10**6),
    at=st.floats(0, 1),
)
def test_taylor_forms_of_an_instant_are_points(choices: list[int], seed: int, at: float) -> None:
    """Nothing is lost on a subinterval of length zero, so that halving subintervals converges."""
    m = model()
    expression = formula(m, choices)
    random = np.random.default_rng(seed)
    signals = {id(v): random.normal(size=(1, 4)) for v in (m.a, m.b)}
    values = {key: bernstein_matrix(3, at) @ rows[0] for key, rows in signals.items()}
    form = ExpressionSteps([expression]).evaluate_at(forms_of(signals, at, at), TAYLOR_FUNCTIONS)[0]
    found = ExpressionSteps([expression]).evaluate_at(values, ARRAY_FUNCTIONS)[0]
    assert form.value.low[0] == pytest.approx(found[0], rel=1e-8, abs=1e-8)
    for interval in (form.value, form.first, form.second):
        assert interval.high[0] - interval.low[0] <= 1e-9 * (1.0 + interval.magnitude[0])


bounds = st.tuples(st.floats(-30, 30), st.floats(0, 8)).map(lambda pair: (pair[0], pair[0] + pair[1]))


@pytest.mark.parametrize("name", ["sin", "cos", "tan", "exp", "arctan"])
@given(bounds=bounds)
def test_functions_contain_their_values(name: str, bounds: tuple[float, float]) -> None:
    low, high = bounds
    found = getattr(Interval(np.array([low]), np.array([high])), name)()
    values = getattr(np, name)(np.linspace(low, high, SAMPLES))
    assert found.low[0] <= values.min()
    assert values.max() <= found.high[0]


@pytest.mark.parametrize("exponent", [2.0, 3.0, -1.0, -2.0, 0.5, 1.5, -0.5, 0.0, 1.0])
@given(bounds=bounds)
def test_powers_contain_their_values(exponent: float, bounds: tuple[float, float]) -> None:
    low, high = bounds
    with np.errstate(all="ignore"):
        found = Interval(np.array([low]), np.array([high])).power(exponent)
        values = np.linspace(low, high, SAMPLES) ** exponent
    if low < 0.0 and exponent != round(exponent):
        # Not a number anywhere: no comparison with it is true, so that it proves nothing.
        assert not found.low[0] > -np.inf
        return
    assert not found.low[0] > values.min()
    assert not found.high[0] < values.max()
    crosses_a_pole = exponent < 0.0 and low <= 0.0 <= high
    assert crosses_a_pole or not np.abs(values).max() < 1e100 or np.isfinite(found.low[0])


def test_a_subinterval_over_a_pole_is_unbounded() -> None:
    across = Interval(np.array([1.0]), np.array([2.0])).tan()
    assert (across.low[0], across.high[0]) == (-np.inf, np.inf)
    over_zero = Interval(np.array([-1.0]), np.array([1.0])).reciprocal()
    assert (over_zero.low[0], over_zero.high[0]) == (-np.inf, np.inf)


def test_constants_have_no_slope() -> None:
    form = TaylorForm.constant(2.5, 3)
    assert form.value.low.tolist() == [2.5] * 3
    assert form.first.magnitude.max() == form.second.magnitude.max() == 0.0


# --------------------------------------------------------------------
# Bernstein coefficients: they say the same as the polynomial, on [0, 1] and on its parts, and enclose it.


degrees = st.integers(0, 9)
seeds = st.integers(0, 10**6)


def values_at(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    return bernstein_matrix(len(coefficients) - 1, at) @ coefficients


@given(degree=degrees, seed=seeds, ends=st.tuples(st.floats(0, 1), st.floats(0, 1)))
def test_a_part_is_the_same_polynomial(degree: int, seed: int, ends: tuple[float, float]) -> None:
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    part = restrict(coefficients[None, :], [ends[0]], [ends[1]])[0]
    local = np.linspace(0, 1, 7)
    wanted = values_at(coefficients, ends[0] + local * (ends[1] - ends[0]))
    assert values_at(part, local) == pytest.approx(wanted, abs=1e-12)
    assert part.min() - 1e-13 <= wanted.min()
    assert wanted.max() <= part.max() + 1e-13


@given(degree=st.integers(1, 9), seed=seeds)
def test_the_derivative_is_that_of_numpys_polynomial(degree: int, seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=degree + 1)
    at = np.linspace(0, 1, degree + 1)
    polynomial = np.polynomial.Polynomial.fit(at, values_at(coefficients, at), degree)
    assert values_at(derivative_coefficients(coefficients), at) == pytest.approx(polynomial.deriv()(at), abs=1e-7)
