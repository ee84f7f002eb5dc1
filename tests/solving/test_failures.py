"""What a failure or an interruption may not cost, and what may not end in one."""

from __future__ import annotations

import contextlib
import math
import pathlib
import subprocess
import sys
import textwrap
from functools import partial
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import interrupt_run, observe_options
from harness.timed_models import belt_drive
from known_mpccs import mpcc_problem
from test_finer_meshes import forced
from test_robust_procedure import LOOSE, RANK, Broken, without_derivative

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable

solve = partial(rcp.solve, progress=False)


@pytest.mark.asl
@pytest.mark.parametrize(("elements", "duration"), [(10, 6.0), (10, 3.0), (8, 6.0)])
def test_a_failed_polish_keeps_the_better_point_before_it(elements: int, duration: float) -> None:
    """Where the belt touches the pulley, the distance has no derivative, and the polish ends without multipliers."""
    rough = solve(belt_drive(elements, duration), strategies=rcp.Strategy("barrier", polish=False), backend="asl")
    polished = solve(belt_drive(elements, duration), strategies=rcp.Strategy("barrier", exploration=0), backend="asl")
    assert rough.quality is rcp.Quality.OPTIMAL
    assert RANK[polished.quality] >= RANK[rough.quality], str(polished)
    assert polished.objective <= rough.objective + 1e-4 * abs(rough.objective)


@pytest.mark.asl
@pytest.mark.slow
def test_the_belt_drive_is_optimal_after_the_whole_procedure() -> None:
    result = solve(belt_drive(10, 3.0), backend="asl", time_limit=60.0)
    assert result.quality is rcp.Quality.OPTIMAL, str(result)
    assert result.objective <= 58.785


@pytest.mark.casadi
@pytest.mark.parametrize("paired", [True, False], ids=["paired", "plain"])
@pytest.mark.parametrize("name", ["steep tanh", "tanh out of range"])
def test_the_first_backend_has_derivatives_that_others_lack(name: str, paired: bool) -> None:
    """ASL has no derivative of tanh where its square overflows; CasADi has."""
    result = solve(without_derivative(name, paired))
    assert result.solved, str(result)


@pytest.mark.asl
@pytest.mark.parametrize("backend", ["asl", "executable"])
def test_a_python_function_does_not_end_the_interpreter(backend: str) -> None:
    script = textwrap.dedent(
        f"""
        import pyomo.environ as pyo
        import pyrobocop_pyomo as rcp

        m = pyo.ConcreteModel(name="external")
        m.x = pyo.Var(initialize=1.0)
        m.f = pyo.ExternalFunction(lambda x: (x - 2) ** 2, lambda x, fixed: [2 * (x - 2)], lambda x, fixed: [2.0])
        m.cost = pyo.Objective(expr=m.f(m.x))
        try:
            print(rcp.solve(m, backend={backend!r}))
        except rcp.errors.PyRobocopError as error:
            print("refused:", error)
        """
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=900)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    if backend == "asl":
        assert "refused:" in ended.stdout


@pytest.mark.casadi
@pytest.mark.parametrize(
    "error", [ValueError("not finite"), ZeroDivisionError()], ids=lambda error: type(error).__name__
)
def test_an_error_of_other_code_leaves_the_best_point_on_the_model(error: Exception) -> None:
    first = solve(mpcc_problem("bard1").build(), strategies=LOOSE)
    model = mpcc_problem("bard1").build()
    with contextlib.suppress(type(error)):
        solve(model, strategies=[LOOSE, rcp.Strategy("broken", Broken(error))])
    (cost,) = model.component_data_objects(pyo.Objective)
    assert pyo.value(cost) == pytest.approx(first.objective)


@pytest.mark.executable
@pytest.mark.parametrize("name", ["bard1", "crossed qpec 2x4"])
def test_the_tolerance_is_the_users_on_the_executables_path(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = observe_options(monkeypatch)
    result = solve(mpcc_problem(name).build(), strategies="barrier", backend="executable", options={"tol": 1e-9})
    assert {options["tol"] for options in seen} == {1e-9}
    assert {step.options["tol"] for step in result.steps if step.status is not None} == {1e-9}


@pytest.mark.executable
def test_an_executable_may_take_its_time_to_say_its_version(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pyomo waits for two seconds, which a machine under load needs to load the libraries of Ipopt."""
    slow = tmp_path / "ipopt"
    slow.write_text(f'#!/bin/sh\n[ "$1" = --version ] && sleep 3\nexec {find_ipopt_executable()} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", str(slow))
    assert solve(mpcc_problem("bard1").build(), strategies="barrier", backend="executable").solved


def weighted() -> pyo.ConcreteModel:
    """A problem with pairs and a number to be changed."""
    m = mpcc_problem("bard1").build()
    m.weight = pyo.Param(initialize=1.0, mutable=True)
    (cost,) = m.component_data_objects(pyo.Objective)
    cost.set_value(m.weight * cost.expr)
    return m


@pytest.mark.casadi
@pytest.mark.parametrize("run", [0, 3, 7])
def test_a_path_of_data_ends_where_it_was_interrupted(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = interrupt_run(monkeypatch, run)
    with pytest.raises(SolveFailed, match="Ctrl-C") as failed:
        rcp.studies.homotopy(weighted(), {"weight": (0.5, 1.0)}, 4, progress=False)
    assert len(runs) == run + 1
    *others, last = [step.result.stop_reason is rcp.StopReason.INTERRUPTED for step in failed.value.result]
    assert (any(others), last) == (False, True)


@pytest.mark.casadi
def test_refinement_ends_with_the_mesh_that_was_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    options: Any = {"strategies": rcp.Strategy(exploration=0), "mesh_tolerance": 1e-8}
    assert len(rcp.solve(forced(), **options).steps) > 2
    runs = interrupt_run(monkeypatch, 1)
    found = rcp.solve(forced(), **options)
    assert len(runs) == 2
    assert found.stop_reason is rcp.StopReason.INTERRUPTED
    assert found.quality is not rcp.Quality.INFEASIBLE


@pytest.mark.casadi
def test_an_infinite_guess_is_no_guess_and_nothing_is_to_be_built(caplog: pytest.LogCaptureFixture) -> None:
    m = pyo.ConcreteModel(name="far")
    m.x = pyo.Var(initialize=math.inf)
    m.row = pyo.Constraint(expr=m.x >= 0)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    result = rcp.solve(m, progress=False)
    assert result.solved
    assert m.x.value == pytest.approx(1.0, abs=1e-6)
    assert "build_asl" not in result.report() + caplog.text


@pytest.mark.casadi
def test_a_power_of_a_negative_state_is_named() -> None:
    m = pyo.ConcreteModel(name="drag")
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.v, b.u = rcp.State(initial=-1), rcp.Control(bounds=(-5, 5))
    b.ode(lambda b, t: {b.v: b.u[t] - b.v[t] ** 1.5})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    text = str(rcp.solve(m, progress=False, time_limit=5))
    assert "= -1 to the power 1.5, in right-hand side of 'v' of phase 'p'" in text
