"""Points are judged by sizes at the answer and in the user's units: neither a guess nor a unit makes one true."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import one_phase, rest_to_rest
from harness.routes import backends_in_turn
from harness.small_problems import corner
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.automatic_scaling import variable_sizes
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint, Scales, stationarity
from pyrobocop_pyomo.programs.row_values import largest_terms
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram
from pyrobocop_pyomo.solving.model_check import ModelCheck

POWERS = st.integers(-12, 12)


def decaying(
    guess: Any = 1.0, *, weight: float = 1.0, unit: float = 1.0, bound: float | None = None
) -> pyo.ConcreteModel:
    """P' = u - P from 1 to 2 with the least integral of u^2 + P^2: a convex quadratic program."""
    m, b = one_phase("b", model="decaying", duration=5, elements=10)
    b.P = rcp.State(initial=unit, final=2 * unit, initial_guess=guess)
    b.u = rcp.Control(initial_guess=guess, bounds=(None, None) if bound is None else (-bound, bound))
    b.ode(lambda b, t: {b.P: b.u[t] - b.P[t]})
    m.cost = pyo.Objective(expr=weight * b.integral(lambda b, t: (b.u[t] / unit) ** 2 + (b.P[t] / unit) ** 2))
    return m


LEAST = 10.0615  # of ten elements and more


# ------------------------------------------------------------------------------ laws of solving


@pytest.mark.ipopt
@settings(max_examples=15, deadline=None)
@given(power=st.floats(0, 9), bounded=st.booleans())
def test_the_answer_does_not_depend_on_the_size_of_the_guess(power: float, bounded: bool) -> None:
    result = solution(decaying(10**power, bound=1e10 if bounded else None))
    assert result.objective == pytest.approx(LEAST, rel=1e-4)


@pytest.mark.ipopt
@settings(max_examples=15, deadline=None)
@given(power=POWERS, options=st.sampled_from([{}, {"nlp_scaling_method": "gradient-based"}]))
def test_a_weight_of_the_objective_changes_no_answer_that_is_called_solved(power: int, options: dict) -> None:
    weight = 10.0**power
    result = rcp.solve(decaying(weight=weight, bound=1e3), options=options)
    assert result.solved or options
    if result.solved:
        assert result.objective == pytest.approx(weight * LEAST, rel=1e-4)


@pytest.mark.ipopt
@settings(max_examples=15, deadline=None)
@given(power=st.integers(-9, 9), guess=st.sampled_from([1.0, "unit"]))
def test_the_unit_of_a_state_changes_no_answer(power: int, guess: Any) -> None:
    unit = 10.0**power
    result = solution(decaying(unit if guess == "unit" else guess, unit=unit))
    assert result.objective == pytest.approx(LEAST, rel=1e-4)


@backends_in_turn("power", [(-12,), (-8,), (0,), (12,)])
def test_a_weight_changes_no_answer_of_a_model_with_pairs(power: int, backend: str) -> None:
    weight = 10.0**power
    m = corner((1, 2), (1.0, 8.2), weight)  # from far away
    result = solution(m, backend=backend)
    assert (m.x.value, m.y.value) == pytest.approx((0.0, 2.0), abs=1e-5)
    assert result.multipliers is not None
    assert result.multipliers.nu == pytest.approx([-2 * weight], rel=1e-5)  # of x: the derivative of (x - 1)^2


@pytest.mark.ipopt
@settings(max_examples=4, deadline=None)
@given(rate=st.floats(25, 40), elements=st.integers(5, 20))
def test_what_violates_its_rows_in_the_units_of_the_user_is_never_solved(rate: float, elements: int) -> None:
    m, b = one_phase("b", model="explosive", duration=1, elements=elements)
    b.x, b.u = rcp.State(initial=1, initial_guess=lambda t: np.exp(rate * t)), rcp.Control()
    b.ode(lambda b, t: {b.x: pyo.exp(b.x[t]) + b.u[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m, options={"max_iter": 100}, strategies=["solve", "straight lines"])
    terms = largest_terms(row.body for row in b.x_collocation.values())
    violations = np.abs([pyo.value(row.body) for row in b.x_collocation.values()])
    assert not result.solved or (violations <= 1e-6 * np.maximum(1.0, terms)).all()


# ------------------------------------------------------------------------------ what is compared


def test_a_row_is_of_the_size_of_what_it_adds_up_at_the_point() -> None:
    m = pyo.ConcreteModel()
    m.x, m.y, m.z = pyo.Var(initialize=2e6), pyo.Var(initialize=2e6 + 1), pyo.Var(bounds=(0, None), initialize=-0.5)
    m.large = pyo.Constraint(expr=m.x == m.y)
    m.product = pyo.Constraint(expr=1e-3 * (m.x - m.y) * m.x + 3 == 0)
    m.named = pyo.Expression(expr=m.x - m.y)
    m.small = pyo.Constraint(expr=-m.named <= 1)
    sizes = largest_terms(row.body for row in m.component_data_objects(pyo.Constraint))
    assert sizes == pytest.approx([2e6 + 1, 2e3, 2e6 + 1])
    assert ModelCheck(m).violations() == pytest.approx((1997.0, 1997.0 / 2e3))


def test_a_bound_at_zero_has_no_size() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2], bounds=(0, 1e9), initialize={1: 1e9, 2: -1e-3})
    assert ModelCheck(m).violations() == (1e-3, 1e-3)


@pytest.mark.casadi
@settings(deadline=None)
@given(powers=st.lists(st.integers(-6, 6), min_size=4, max_size=4), weight=POWERS, seed=st.integers(0, 99))
def test_stationarity_does_not_change_with_units(powers: list[int], weight: int, seed: int) -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(0, 5), initialize=1.5), pyo.Var(initialize=-2.0)
    m.equal = pyo.Constraint(expr=m.x * m.y + pyo.exp(m.y) == -3)
    m.above = pyo.Constraint(expr=m.x - m.y >= 1)
    m.cost = pyo.Objective(expr=m.x**2 + pyo.sin(m.y))
    compiled = CompiledModel(m, "vectorised")
    rng = np.random.default_rng(seed)
    point = PrimalDualPoint(compiled.current_point(), rng.standard_normal(2), rng.random(2), rng.random(2))
    sizes = variable_sizes(compiled)
    units = 10.0 ** np.array(powers)
    scales = Scales(units[:2], units[2:], 10.0**weight)
    there = stationarity(ScaledProgram(compiled.nlp, scales), scales.scaled(point), sizes / scales.x)
    assert there == pytest.approx(stationarity(compiled.nlp, point, sizes), rel=1e-6)


@pytest.mark.casadi
@pytest.mark.parametrize("weight", [1e-12, 1.0, 1e12])
def test_a_multiplier_far_from_its_bound_makes_nothing_stationary(weight: float) -> None:
    """At 8.2 a bound at zero balances the slope of (y - 2)^2, as on the central path with a large barrier."""
    m = pyo.ConcreteModel()
    m.y = pyo.Var(bounds=(0, None), initialize=8.2)
    m.cost = pyo.Objective(expr=weight * (m.y - 2) ** 2)
    compiled = CompiledModel(m, "vectorised")
    point = PrimalDualPoint(np.array([8.2]), np.zeros(0), np.array([weight * 12.4]), np.zeros(1))
    assert stationarity(compiled.nlp, point, variable_sizes(compiled)) > 0.1
    m.y.set_value(2.0)
    point = PrimalDualPoint(np.array([2.0]), np.zeros(0), np.zeros(1), np.zeros(1))
    assert stationarity(compiled.nlp, point, variable_sizes(compiled)) == 0.0


@pytest.mark.ipopt
@pytest.mark.parametrize(("least", "is_decided"), [(3.0, True), (1.0, False)])
def test_a_least_time_that_its_bound_decides_is_told(least: float, is_decided: bool) -> None:
    result = solution(rest_to_rest(duration=rcp.Duration(bounds=(least, 10.0))))
    told = "phase 'p' ends at its lower bound, 3: any values of 'p.u' that meet the constraints are an answer"
    assert (told in str(result)) is is_decided
