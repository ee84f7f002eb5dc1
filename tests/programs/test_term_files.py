"""A file that is written by the terms of a model holds the same program as the one that Pyomo writes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs import compiled_model, model_terms, term_files
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = pytest.mark.asl

# Functions, and what keeps their arguments where they are defined.
FUNCTIONS = {
    **dict.fromkeys(("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "asinh", "exp"), lambda a: a),
    **dict.fromkeys(("log", "log10", "sqrt", "acosh"), lambda a: 1.5 + a**2),
    **dict.fromkeys(("asin", "acos", "atanh"), lambda a: 0.5 * pyo.tanh(a)),
}


@st.composite
def models(draw: st.DrawFn) -> pyo.ConcreteModel:
    """Rows of a few shapes over some variables, with parameters, fixed variables and constants."""
    m = pyo.ConcreteModel()
    count = draw(st.integers(2, 6))
    values = st.floats(-1.0, 1.0).map(lambda number: round(number, 3))
    m.x = pyo.Var(range(count), bounds=draw(st.sampled_from([(None, None), (-2, None), (None, 3), (-2, 3)])))
    for variable in m.x.values():
        variable.set_value(draw(values))
    # Pyomo's writer leaves out variables whose coefficients are zero at these numbers.
    m.fixed = pyo.Var(initialize=draw(st.sampled_from([0.37, -0.83])))
    m.fixed.fix()
    m.p = pyo.Param(initialize=draw(st.sampled_from([0.41, -0.79])), mutable=True)
    # At points of three decimals no condition is just met.
    parts = [
        lambda a, b: 2.0 * a - b,
        lambda a, b: a * b + m.p,
        lambda a, b: -(a**2) / (2.0 + b**2) + 0.3,
        lambda a, b: m.fixed * a + 1.7,
        lambda a, b: pyo.Expr_if(a <= b + 0.0137, a * a, b * a),
        lambda a, b: abs(a - 0.0507) + m.p * b,
        *(
            lambda a, b, name=name, inside=inside: getattr(pyo, name)(inside(a)) * b - m.p
            for name, inside in FUNCTIONS.items()
        ),
    ]
    shapes = st.sampled_from(parts)

    m.rows = pyo.ConstraintList()
    for _ in range(draw(st.integers(0, 5))):
        a, b = (m.x[draw(st.integers(0, count - 1))] for _ in range(2))
        body = draw(shapes)(a, b) + draw(shapes)(b, a)
        relations = [body == m.p, body >= -1.5, body <= 2 * m.p, (-4.0, body, 4.0)]
        m.rows.add(relations[draw(st.integers(0, 3))])
    sense = draw(st.sampled_from([pyo.minimize, pyo.maximize]))
    m.cost = pyo.Objective(expr=draw(shapes)(m.x[0], m.x[1]) + draw(values), sense=sense)
    return m


def numbers(model: pyo.ConcreteModel) -> list[Any]:
    """Bounds, values and derivatives at the point of the model, by the names of variables and rows."""
    compiled = CompiledModel(model, "asl")
    nlp, x = compiled.nlp, compiled.current_point()
    order = np.argsort([variable.name for variable in compiled.variables])
    rows = np.argsort([row.name for row in compiled.constraints])
    weights = np.array([0.3 + 0.1 * int(row.name[-2]) for row in compiled.constraints])
    jacobian, hessian = np.zeros((nlp.m, nlp.n)), np.zeros((nlp.n, nlp.n))
    np.add.at(jacobian, nlp.jacobian_structure, nlp.jacobian(x))
    np.add.at(hessian, nlp.hessian_structure, nlp.hessian(x, 0.7, weights))
    hessian = hessian + np.tril(hessian, -1).T
    missed = [(nlp.constraints(x) - bounds)[rows] for bounds in (nlp.g_lower, nlp.g_upper)]
    return [
        [variable.name for variable in np.array(compiled.variables, dtype=object)[order]], nlp.x_start[order],
        nlp.x_lower[order], nlp.x_upper[order], nlp.objective(x), nlp.gradient(x)[order], *missed,
        jacobian[np.ix_(rows, order)], hessian[np.ix_(order, order)],
    ]  # fmt: skip


@given(model=models())
@settings(max_examples=150, deadline=None)
def test_both_files_hold_the_same_program(model: pyo.ConcreteModel) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_model, "LEAST_ROWS", 0)
        found = numbers(model)
        patch.setattr(compiled_model, "LEAST_ROWS", np.inf)
        expected = numbers(model)
    assert found[0] == expected[0]
    for mine, pyomos in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(mine, pyomos, rtol=1e-9, atol=1e-9)


def test_a_phase_is_written_by_its_terms() -> None:
    """So that the law above is about what users solve."""
    m = pyo.ConcreteModel()
    m.phase = b = rcp.PhaseBlock(elements=10, duration=1.0)
    b.angle, b.rate = rcp.State(initial=0.1), rcp.State(initial=0)
    b.torque = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: pyo.sin(b.angle[t]) + b.torque[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.torque[t] ** 2))
    assert term_files.term_file(model_terms.collect_terms(m)) is not None


def test_what_is_shared_too_often_is_left_to_names() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(2), initialize=0.3)
    node = m.x[0]
    for _ in range(60):
        node = node * node + 0.1 * pyo.sin(m.x[1])
    m.row = pyo.Constraint(expr=node == 0)
    m.cost = pyo.Objective(expr=m.x[0] ** 2)
    assert term_files.term_file(model_terms.collect_terms(m)) is None
