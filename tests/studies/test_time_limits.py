"""A time limit is for the whole study, and no study goes on for long beyond it."""

import time
from functools import partial
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import integrator

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = [pytest.mark.casadi, pytest.mark.slow]

# What a limit does not cut off, in units of making and compiling a model with 8,000 variables on the same machine: the
# user's own function makes the model of a case, and the point is checked at the end. A function or a derivative of
# these models takes milliseconds.
TOLERATED_MODELS = 2.0
ENDLESS = {"tol": 1e-300, "dual_inf_tol": 1e-300, "acceptable_iter": 0, "acceptable_tol": 1e-300, "max_iter": 10**6}


def slow_cost(x: Any, factor: Any = 1.0) -> Any:
    """Rosenbrock's function, chained: on any machine Newton's method takes more iterations than there are variables."""
    return sum(100 * factor * (x[i + 1] - x[i] ** 2) ** 2 + (1 - x[i]) ** 2 for i in range(len(x) - 1))


def endless(_: Any = None) -> Any:
    """Ipopt takes some 12,000 iterations, longer than any limit here, if nobody stops it."""
    m = pyo.ConcreteModel(name="endless")
    m.p = pyo.Param(initialize=1.0, mutable=True)
    m.x = pyo.Var(range(8000), initialize=-1.0)
    m.cost = pyo.Objective(expr=slow_cost(m.x, m.p))
    return m


def endless_phase() -> Any:
    m, b = integrator(x={"initial": 0, "final": 1}, elements=10)
    m.rest = pyo.Var(range(4000), initialize=-1.0)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2) + slow_cost(m.rest))
    return m


@pytest.fixture(scope="module")
def tolerated() -> float:
    """Processor time after the limit of each solve; what is imported once is imported by the first solve."""
    rcp.solve(endless(), time_limit=0.1)
    return TOLERATED_MODELS * max(seconds_of(lambda: CompiledModel(endless()))[0] for _ in range(3))


def seconds_of(study: Any) -> tuple[float, Any]:
    """Processor time, which is at most the time elapsed."""
    started = time.process_time()
    answer = study()
    return time.process_time() - started, answer


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("limit", [1.0, 3.0])
def test_sweeps(limit: float, workers: int, tolerated: float) -> None:
    solve = partial(rcp.sweep, endless, [1, 2, 3], start_from=None, workers=workers, options=ENDLESS)
    taken, found = seconds_of(lambda: solve(time_limit=limit))
    assert taken < limit + tolerated
    assert len(found) + len(found.remaining) == 3


def test_one_case(tolerated: float) -> None:
    solve = partial(rcp.sweep, endless, [1, 2], start_from=None, options=ENDLESS)
    taken, found = seconds_of(lambda: solve(time_limit_per_case=0.5))
    assert taken < 2 * (0.5 + tolerated)
    assert [outcome.cut_short for outcome in found] == [True, True]
    assert found.remaining == ()


def test_steps_of_a_receding_horizon(tolerated: float) -> None:
    m = endless_phase()
    controller = rcp.studies.RecedingHorizon(m, m.p, options=ENDLESS)
    taken, step = seconds_of(lambda: controller.step({"x": 0.0}, time_limit=1.0))
    assert taken < 1.0 + tolerated
    assert not step.solved
