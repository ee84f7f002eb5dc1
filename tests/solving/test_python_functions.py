"""Models with Python functions go through all that other models go through."""

import logging

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = pytest.mark.casadi


def pull(X: np.ndarray) -> np.ndarray:
    return -9.81 * np.sin(X[:, 0]) - 0.1 * X[:, 1]


def pull_slopes(X: np.ndarray) -> np.ndarray:
    return np.column_stack([-9.81 * np.cos(X[:, 0]), np.full(len(X), -0.1)])


PULL = rcp.Function(pull, pull_slopes, inputs=["angle", "rate"])
SQUARE = rcp.Function(lambda X: X[:, 0] ** 2, lambda X: 2 * X, lambda X: np.full((len(X), 1, 1), 2.0), name="square")
LOGARITHM = rcp.Function(lambda X: np.log(X[:, 0]), lambda X: 1 / X, lambda X: -1 / X[:, :, None] ** 2, name="ln")


def in_pyomo(angle, rate):
    return -9.81 * pyo.sin(angle) - 0.1 * rate


def pendulum(f, elements: int = 15) -> pyo.ConcreteModel:
    m, b = one_phase("swing", model="pendulum", duration=2.0, elements=elements, scheme="radau", stages=2)
    b.angle = rcp.State(initial=0, final=1.0)
    b.rate = rcp.State(initial=0, final=0)
    b.torque = rcp.Control(bounds=(-12, 12))

    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: f(b.angle[t], b.rate[t]) + b.torque[t]})

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.torque[t] ** 2))
    return m


def test_a_phase_is_solved_verified_simulated_cloned_and_drawn_alike() -> None:
    called, written_out = pendulum(PULL), pendulum(in_pyomo)
    first, second = rcp.solve(called), rcp.solve(written_out, backend="vectorised")
    assert first.quality is rcp.Quality.OPTIMAL
    assert "'pull' (second derivatives by differences) in Python" in first.derivatives
    assert first.objective == pytest.approx(second.objective, rel=1e-9)
    assert first.steps[0].iterations == second.steps[0].iterations
    for m in (called, called.clone()):
        verification = m.swing.trajectory().verify()
        assert verification.defect < 1e-8
    for name in ("angle", "rate"):
        np.testing.assert_allclose(
            getattr(called.swing.simulate(), name), getattr(written_out.swing.simulate(), name), atol=1e-6
        )
    assert not rcp.diagnose(called).errors


def test_sides_of_pairs_may_call_functions() -> None:
    def model(square):
        m = pyo.ConcreteModel(name="pairs")
        m.x = pyo.Var([0, 1, 2], bounds=(0, None), initialize=0.5)
        m.pairs = rcp.Complementarity([0, 1], rule=lambda m, i: rcp.complements(m.x[i] >= 0, square(m.x[i + 1]) >= 1))
        m.cost = pyo.Objective(expr=sum((m.x[i] - 0.3 * (i + 1)) ** 2 for i in m.x) + square(m.x[2]))
        return m

    first, second = rcp.solve(model(SQUARE)), rcp.solve(model(lambda x: x**2))
    assert first.solved
    assert first.objective == pytest.approx(second.objective, abs=1e-7)
    assert first.certificate is second.certificate


def test_a_function_outside_of_its_domain_shortens_the_step_and_is_named_at_the_first_point(caplog) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=3.0)
    m.cost = pyo.Objective(expr=m.x + 0.01 * m.x**2 - 0.1 * LOGARITHM(m.x))  # Newton's first step leads below zero
    assert rcp.solve(m, backend="vectorised").solved
    m.x.set_value(-1.0)
    with caplog.at_level(logging.WARNING):
        assert not rcp.solve(m, backend="vectorised").solved
    assert "'ln': its value is nan at (input 0 = -1)" in caplog.text


def test_pyomo_solvers_of_this_package_call_functions() -> None:
    for name in ("pyrobocop.ipopt", "pyrobocop.mpcc"):
        m = pyo.ConcreteModel()
        m.x = pyo.Var(initialize=1.0)
        m.cost = pyo.Objective(expr=SQUARE(m.x - 3) + 1)
        pyo.SolverFactory(name).solve(m)
        assert m.x.value == pytest.approx(3.0, abs=1e-6)


def test_multipliers_and_sensitivities_are_of_the_model_alone() -> None:
    found = []
    for square in (SQUARE, lambda x: x**2):
        m = pyo.ConcreteModel()
        m.p = pyo.Param(initialize=1.5, mutable=True)
        m.x, m.y = pyo.Var(initialize=1, bounds=(0, 5)), pyo.Var(initialize=1)
        m.dual, m.rc = (pyo.Suffix(direction=pyo.Suffix.IMPORT_EXPORT) for _ in range(2))
        m.row = pyo.Constraint(expr=square(m.x * m.p + 1) == m.y)
        m.least = pyo.Constraint(expr=m.y >= square(m.p) + 4)
        m.cost = pyo.Objective(expr=square(m.y) + m.x)
        sensitivity = rcp.studies.sensitivity(m, rcp.solve(m), [m.p])
        names = [part.name for part in (*m.dual, *sensitivity.variables)]
        assert sorted(part.name for part in m.rc) == ["x", "y"]
        numbers = [*m.dual.values(), *sensitivity.matrix.ravel(), sensitivity.objective_derivative(m.p)]
        found.append((sorted(names), sorted(numbers)))
    assert found[0][0] == found[1][0]
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-6)


def test_a_fixed_end_beyond_a_table_is_told_in_the_result_and_nowhere_else(caplog: pytest.LogCaptureFixture) -> None:
    wind = rcp.Table([0, 1, 2, 3], [1.0, 1.2, 1.1, 1.3], name="wind")
    m, b = one_phase(duration=2.0, elements=3)
    b.x, b.u = rcp.State(initial=0, final=6, initial_guess=lambda t: 3 * t), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t] * wind(b.x[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    with caplog.at_level(logging.ERROR, logger="pyomo"):
        result = rcp.solve(m)
    assert not result.solved
    assert "wind" in result.report()
    assert "derivatives by ." not in result.report()
    assert not caplog.records


@pytest.mark.parametrize("place", ["row", "argument"])
def test_discrete_variables_beside_a_function_are_named(place: str) -> None:
    m = pyo.ConcreteModel(name="steps")
    m.x, m.n = pyo.Var(initialize=1), pyo.Var(domain=pyo.Integers, initialize=1)
    m.row = pyo.Constraint(expr=SQUARE(m.x) + m.n == 2 if place == "row" else SQUARE(m.x + m.n) == 2)
    m.cost = pyo.Objective(expr=m.x**2)
    with pytest.raises(ModelError, match=r"'steps' has 1 discrete variables \('n'\)"):
        CompiledModel(m)
