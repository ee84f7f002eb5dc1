"""One table of nodes and one evaluator for every kind of number."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.expression_zoo import UNARY, trees
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps

MODEL = pyo.ConcreteModel()
MODEL.x = pyo.Var(range(3), initialize=dict(enumerate((0.3, -0.8, 1.1))))
MODEL.p = pyo.Param(initialize=-0.4, mutable=True)
LEAVES = st.one_of(st.sampled_from([*MODEL.x.values(), MODEL.p]), st.floats(-2, 2), st.integers(-3, 3))


@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(expression=trees(LEAVES))
def test_values_are_those_of_pyomo(expression: object) -> None:
    assert ExpressionSteps([expression]).evaluate_at({})[0] == pytest.approx(
        pyo.value(expression), rel=1e-12, abs=1e-12
    )


@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(expression=trees(LEAVES), seed=st.integers(0, 1000))
def test_arrays_are_evaluated_elementwise(expression: object, seed: int) -> None:
    samples = np.random.default_rng(seed).uniform(-1, 1, (3, 4))
    leaves = {id(variable): samples[i] for i, variable in MODEL.x.items()}
    found = np.broadcast_to(ExpressionSteps([expression]).evaluate_at(leaves, ARRAY_FUNCTIONS)[0], 4)
    for column, value in zip(samples.T, found, strict=True):
        single = {id(variable): float(column[i]) for i, variable in MODEL.x.items()}
        assert value == pytest.approx(ExpressionSteps([expression]).evaluate_at(single)[0], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", UNARY)
def test_every_function_has_its_name_in_numpy(name: str) -> None:
    expression = getattr(pyo, name)(MODEL.x[0])
    array = ExpressionSteps([expression]).evaluate_at({id(MODEL.x[0]): np.array([0.3])}, ARRAY_FUNCTIONS)[0]
    assert array[0] == pytest.approx(pyo.value(expression))


def test_what_cannot_be_evaluated_is_named() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var()
    m.f = pyo.ExternalFunction(function=lambda x: x)
    with pytest.raises(ValueError, match="'x' has no value"):
        ExpressionSteps([m.x + 1]).evaluate_at({})[0]
    with pytest.raises(ValueError, match="is a ExternalFunctionExpression"):
        ExpressionSteps([m.f(m.x)]).evaluate_at({})[0]
    with pytest.raises(ValueError, match="'tanh'"):
        ExpressionSteps([pyo.tanh(MODEL.x[0])]).evaluate_at({}, {})[0]
