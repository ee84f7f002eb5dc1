"""Models without pairs: what follows where the first run fails, and starts that cannot be evaluated."""

from __future__ import annotations

import math

import pyomo.environ as pyo
import pytest
from harness.routes import every_backend

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.solving.iterates import Iterate
from pyrobocop_pyomo.solving.strategies import STRATEGIES

pytestmark = pytest.mark.casadi


def _goddard(elements: int = 12) -> pyo.ConcreteModel:
    """A rocket that climbs as high as it can: mass and height divide, and start at 0 where no guess is given."""
    m = pyo.ConcreteModel(name="rocket")
    m.climb = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.01, 1)), elements=elements)
    b.height = rcp.State(initial=1)
    b.speed = rcp.State(initial=0)
    b.mass = rcp.State(initial=1, final=0.6)
    b.thrust = rcp.Control(bounds=(0, 3.5))

    @b.ode
    def flight(b, t):
        drag = 310 * b.speed[t] ** 2 * pyo.exp(-500 * (b.height[t] - 1))
        acceleration = (b.thrust[t] - drag) / b.mass[t] - 1 / b.height[t] ** 2
        return {b.height: b.speed[t], b.speed: acceleration, b.mass: -b.thrust[t] / 0.5}

    m.cost = pyo.Objective(expr=b.height[b.points.last()], sense=pyo.maximize)
    return m


@every_backend
def test_a_start_without_a_value_is_moved_and_named(backend: str) -> None:
    m = _goddard()
    m.climb.initialize({"height": 0.0})
    # From there Ipopt comes to one of two local optima, by its last digits.
    result = rcp.solve(m, backend=backend, strategies=rcp.Strategy(exploration=float("inf")))
    assert result.solved
    assert result.objective == pytest.approx(1.01283, abs=2e-4)
    assert "could not be evaluated: division by climb.height" in result.report()
    assert "in right-hand side of 'speed' of phase 'climb' at t = " in result.remarks[0]
    assert "element 0" in result.remarks[0]


def test_what_cannot_be_moved_ends_in_a_result_that_names_it() -> None:
    m = pyo.ConcreteModel(name="log")
    m.x = pyo.Var(initialize=-1.0, bounds=(None, -0.5))
    m.y = pyo.Var(initialize=0.0)
    m.row = pyo.Constraint(expr=pyo.log(m.x) + m.y == 0)
    m.cost = pyo.Objective(expr=m.y**2)
    result = rcp.solve(m)
    assert result.quality is rcp.Quality.INFEASIBLE
    assert "log(...) of x = -1, in constraint 'row'" in result.report()
    assert m.x.value == -1.0
    with pytest.raises(rcp.errors.SolveFailed, match=r"log\(\.\.\.\) of x = -1"):
        result.raise_for_status()


def test_what_has_no_solution_ends_after_a_few_tries() -> None:
    m = pyo.ConcreteModel(name="apart")
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=2.0)
    m.circle = pyo.Constraint(expr=m.x**2 + m.y**2 <= 1)
    m.outside = pyo.Constraint(expr=m.x + m.y >= 4)
    m.cost = pyo.Objective(expr=m.x)
    result = rcp.solve(m)
    assert result.quality is rcp.Quality.INFEASIBLE
    assert result.stop_reason is rcp.StopReason.INFEASIBLE
    assert [step.label for step in result.steps] == ["solve", "own units", "elastic rows", "solve from there"]
    assert sum(step.iterations for step in result.steps[1:]) <= max(1500, 2 * result.steps[0].iterations)
    alone = rcp.solve(m, strategies="solve")
    assert len(alone.steps) == 1


def test_rows_that_repeat_each_other_are_solved_with_elastic_rows() -> None:
    """Two equations of one variable: Ipopt refuses more equations than variables."""
    m = pyo.ConcreteModel(name="repeated")
    m.x = pyo.Var(initialize=0.5)
    m.first = pyo.Constraint(expr=m.x**2 == 4)
    m.second = pyo.Constraint(expr=m.x**3 == 8)
    m.cost = pyo.Objective(expr=m.x)
    result = rcp.solve(m)
    assert result.solved, str(result)
    assert result.strategy == "elastic rows"
    assert m.x.value == pytest.approx(2.0, abs=1e-7)
    assert math.isclose(result.objective, 2.0, abs_tol=1e-7)


def test_a_limit_of_the_caller_is_the_end() -> None:
    result = rcp.solve(_goddard(), options={"max_iter": 3})
    assert result.stop_reason is rcp.StopReason.ITERATION_LIMIT
    assert result.iterations == 3


@pytest.mark.parametrize("unit", [1.0, 1e3])
@pytest.mark.parametrize("kink", [0.0, 1.0], ids=["smooth", "with an absolute value"])
def test_one_run_solves_where_a_large_state_lies_at_zero(kink: float, unit: float) -> None:
    """A climb stays on the ground for half of its time: by what Ipopt loosens that bound no row is violated."""
    m = pyo.ConcreteModel(name="late climb")
    m.b = b = rcp.PhaseBlock(duration=100, elements=20)
    b.height = rcp.State(initial=0, final=5e4 * unit, bounds=(0, 2.5e5 * unit))
    b.path = rcp.Control(bounds=(-1.5, 1.5))
    b.ode(lambda b, t: {b.height: 1e3 * unit * pyo.sin(b.path[t])})
    cost = b.integral(lambda b, t: b.height[t] + kink * 0.1 * abs(b.height[t] - 3e4 * unit))
    m.cost = pyo.Objective(expr=cost / (1e3 * unit) + b.integral(lambda b, t: b.path[t] ** 2))
    result = rcp.solve(m, strategies=rcp.Strategy(exploration=0), mesh_tolerance=None)
    assert [step.label for step in result.steps] == ["solve"]
    assert result.solved, str(result)
    assert min(b.trajectory().height) >= 0.0


@pytest.mark.parametrize(("status", "first"), [("SOLVED", "tighter"), ("STEP_FAILED", "absolute values as pairs")])
def test_a_run_that_converged_met_no_kink(status: str, first: str) -> None:
    """Smaller tolerances take a few iterations, absolute values in two parts hundreds."""
    ended = Iterate.of_run("solve", IpoptStatus[status], iterations=26, seconds=0.1, delta=None, mu=None)
    assert next(row.name for row in STRATEGIES if ended.stop_reason in row.follows) == first
