"""Derivatives of models whose Expressions use each other, by every source of derivatives."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.nested_models import EXPANDED, LARGEST_VALUE, NESTED, differ_from_differences, nested_model
from harness.quadratic_program import QuadraticProgram

from pyrobocop_pyomo.programs.compiled_model import CompiledModel


def test_nested_models_are_what_they_promise():
    model, again, written_out = nested_model(15), nested_model(15), nested_model(15, named=False)
    assert str(model.objective.expr) == str(again.objective.expr) != str(nested_model(16).objective.expr)
    assert pyo.value(model.objective) == pyo.value(written_out.objective)
    assert all(abs(pyo.value(row.body)) < LARGEST_VALUE for row in model.rows.values())
    assert any(
        part is other for e in model.e.values() for part in e.expr.args for other in model.e.values()
        if e.expr.is_expression_type()
    )  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize(
    "derivatives",
    [pytest.param("asl", marks=pytest.mark.asl), pytest.param("vectorised", marks=pytest.mark.casadi)],
)
def test_derivatives_are_those_of_the_functions(derivatives):
    """The first models are those that the library of 2019 gets wrong as Pyomo writes them, or even written out."""
    for seed in (*NESTED, *EXPANDED, *range(20)):
        compiled = CompiledModel(nested_model(seed), derivatives)
        assert differ_from_differences(compiled.nlp, compiled.current_point()) == [], seed


@pytest.mark.parametrize("wrong", ["gradient", "Jacobian", "Hessian"])
def test_the_check_notices_each_kind_of_wrong_derivative(wrong):
    program = QuadraticProgram([1.0, 2.0], H=[[2.0, 1.0], [1.0, 3.0]], A=[[1.0, -1.0]])
    x = np.array([0.7, 1.1])
    assert differ_from_differences(program, x) == []
    right = getattr(program, wrong.lower())
    setattr(program, wrong.lower(), lambda *given: right(*given) + 1e-3)
    assert wrong in differ_from_differences(program, x)
