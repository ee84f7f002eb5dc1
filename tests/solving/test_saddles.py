"""A stationary point that is no minimum is not called optimal: runs go on from it, or the result says what it is."""

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.solving import procedure, runner
from pyrobocop_pyomo.solving.curvature import direction_of_descent

pytestmark = pytest.mark.casadi


def over_a_hill(elements=20, height=40.0):
    """A path from one side of a hill to the other, guessed straight over its top."""
    m = pyo.ConcreteModel(name="hill")
    m.path = b = rcp.PhaseBlock(duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0])
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: b.v[t]})
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: b.v[t] @ b.v[t] + height * pyo.exp(-(b.r[t][0] ** 2) - b.r[t][1] ** 2))
    )
    return m


def saddle(sense=pyo.minimize, limit=2.0):
    m = pyo.ConcreteModel(name="saddle")
    m.x, m.y = pyo.Var(initialize=0.0), pyo.Var(initialize=0.0, bounds=(-limit, limit))
    sign = 1.0 if sense is pyo.minimize else -1.0
    m.cost = pyo.Objective(expr=sign * ((m.x - 1) ** 2 - m.y**2), sense=sense)
    return m


def labels(result):
    return [step.label for step in result.steps]


def test_a_path_does_not_stay_on_the_ridge_where_its_guess_was():
    m = over_a_hill()
    result = rcp.solve(m, strategies=rcp.Strategy(exploration=0))
    assert result.solved
    assert labels(result) == ["solve", "beyond a saddle"]
    assert result.objective < result.steps[0].objective - 1.0
    assert max(abs(m.path.r[1, t].value) for t in m.path.time) > 0.5


@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize])
@pytest.mark.parametrize("options", [{}, {"nlp_scaling_method": "gradient-based"}])
def test_a_saddle_is_left_whatever_the_sense_and_the_scaling(sense, options):
    m = saddle(sense)
    result = rcp.solve(m, options=options)
    assert result.solved
    assert abs(m.y.value) == pytest.approx(2.0, rel=1e-6)


@pytest.mark.executable
def test_a_saddle_is_left_by_the_executable(monkeypatch):
    monkeypatch.setattr(procedure, "ITERATIONS_OF_ONE", 3000)  # so many come to rest on it
    m = saddle()
    result = rcp.solve(m, backend="executable")
    assert result.solved
    assert labels(result) == ["solve", "beyond a saddle"]


def test_a_saddle_from_which_nothing_better_is_found_is_no_solution(monkeypatch):
    """Starts beside the saddle that are the saddle again."""
    monkeypatch.setattr(runner, "STEP_FROM_SADDLE", 0.0)
    result = rcp.solve(over_a_hill())
    assert not result.solved
    assert result.quality is rcp.Quality.FEASIBLE
    assert "stationary, but no minimum" in result.report()
    assert "DOUBTFUL" in str(result)
    assert len(result.doubts) == 1


def test_a_line_of_minima_is_no_saddle():
    """Nothing changes along it: the curvature is zero."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=3.0)
    m.cost = pyo.Objective(expr=(m.x + m.y - 1) ** 2)
    result = rcp.solve(m)
    assert result.solved
    assert labels(result) == ["solve"]


def test_curvature_that_the_rows_forbid_does_not_count():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=0.5)
    m.row = pyo.Constraint(expr=m.y == m.x**2)
    m.again = pyo.Constraint(expr=2 * m.y == 2 * m.x**2)
    m.cost = pyo.Objective(expr=3 * m.y - m.x**2)
    result = rcp.solve(m)
    assert result.solved
    assert labels(result) == ["solve"]
    assert m.x.value == pytest.approx(0.0, abs=1e-4)


def test_a_bound_that_holds_a_variable_forbids_its_curvature():
    """Concave between its bounds: each of the ends is a minimum, also where a multiplier is small."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, 1), initialize=0.9)
    m.y = pyo.Var(bounds=(0, 1), initialize=0.2)
    m.cost = pyo.Objective(expr=-(m.x**2) - 1e-3 * m.x - (m.y - 0.5) ** 2)
    result = rcp.solve(m)
    assert result.solved
    assert labels(result) == ["solve"]


@pytest.mark.parametrize("seed", range(12))
def test_a_direction_is_found_where_the_hessian_is_not_convex_on_the_null_space_of_the_rows(seed):
    """Against eigenvalues of the reduced Hessian, with a row that is there twice to first order."""
    random = np.random.default_rng(seed)
    n, m = 8, 3
    hessian, jacobian = random.standard_normal((n, n)), random.standard_normal((m, n))
    hessian = hessian + hessian.T + random.uniform(0, 6) * np.eye(n)
    jacobian[2] = jacobian[1]
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(n), initialize=0.0)
    x = np.array(list(model.x.values()))
    model.rows = pyo.Constraint(range(m), rule=lambda model, i: jacobian[i] @ x + (-1) ** i * x[0] ** 2 == 0)
    model.cost = pyo.Objective(expr=0.5 * x @ hessian @ x)
    nlp = CompiledModel(model, "casadi").nlp
    # Those of the two rows that are the same to first order cancel in the Hessian.
    multipliers = np.array([0.0, 1e5, 1e5])
    point = PrimalDualPoint(np.zeros(n), multipliers, np.zeros(n), np.zeros(n))
    jacobian_here = np.zeros((m, n))
    np.add.at(jacobian_here, nlp.jacobian_structure, nlp.jacobian(point.x))
    space = np.linalg.svd(jacobian_here)[2][2:].T
    least = np.linalg.eigvalsh(space.T @ hessian @ space)[0]
    found = direction_of_descent(nlp, point)
    assert (found is not None) == (least < -1e-3)
    if found is not None:
        assert np.abs(found).max() == pytest.approx(1.0)
        assert found @ hessian @ found == pytest.approx(least * (found @ found), rel=0.3)
        assert np.abs(jacobian_here @ found).max() < 1e-4
