"""A controller in C makes the plans of the one in Python."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.export import export_controller
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.ipopt.backends import load_ipopt_library
from pyrobocop_pyomo.native.shared_library import FLAGS

pytestmark = pytest.mark.casadi


def regulator(parametrization: str = "collocated", scheme: str = "radau", **of_v: Any) -> pyo.ConcreteModel:
    """What is measured stands in linear and in nonlinear terms, and in the cost."""
    m = pyo.ConcreteModel(name="regulator")
    m.gain = pyo.Param(initialize=1.0, mutable=True)
    m.ahead = b = rcp.PhaseBlock(duration=3.0, elements=12, scheme=scheme)
    b.v, b.x = rcp.State(initial=0, **of_v), rcp.State(initial=1.0)
    b.u = rcp.Control(bounds=(-2, 2), parametrization=parametrization)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: m.gain * pyo.sin(b.x[t]) + b.u[t]})
    b.gentle = pyo.Constraint(expr=b.x[0.0] ** 2 * pyo.exp(b.v[b.points.first()]) <= 5)
    running = b.integral(lambda b, t: b.x[t] ** 2 + b.v[t] ** 2 + 0.1 * b.u[t] ** 2)
    m.cost = pyo.Objective(expr=running + 0.01 * b.x[0.0] * pyo.cos(b.v[b.points.first()]))
    return m


Step = Callable[[Mapping[str, float]], tuple[int, dict[str, float], np.ndarray]]


def compiled(source: Path) -> Step:
    """As the header says it, but with the Ipopt that is found here."""
    library, ipopt = source.with_name("controller.so"), Path(load_ipopt_library().path)
    compiler = shutil.which("cc") or shutil.which("gcc")
    assert compiler is not None
    files = [str(file) for file in source.parent.glob("*.c")]
    link = [str(ipopt), f"-Wl,-rpath,{ipopt.parent}", "-ldl", "-lm"]
    # Symbols are bound within the library: those of the linear solver stand in others of this process as well. The
    # results are those of -O3, which takes longer to compile.
    subprocess.run([compiler, *FLAGS[:-1], "-O1", "-Wl,-Bsymbolic", *files, "-o", str(library), *link], check=True)
    functions = ctypes.CDLL(str(library))
    functions.controller_plan.restype = ctypes.POINTER(ctypes.c_double)
    states, controls, variables = (
        ctypes.c_int.in_dll(functions, f"controller_{what}").value for what in ("states", "controls", "variables")
    )
    names = (ctypes.c_char_p * states).in_dll(functions, "controller_state_names")
    control_names = (ctypes.c_char_p * controls).in_dll(functions, "controller_control_names")

    def step(measured: Mapping[str, float]) -> tuple[int, dict[str, float], np.ndarray]:
        state = (ctypes.c_double * states)(*(measured[name.decode()] for name in names if name))
        control = (ctypes.c_double * controls)()
        status = functions.controller_step(state, control)
        plan = np.array(functions.controller_plan()[:variables])
        return status, {name.decode(): u for name, u in zip(control_names, control, strict=True) if name}, plan

    return step


@pytest.mark.parametrize(
    ("parametrization", "scheme"),
    [("collocated", "radau"), ("piecewise_linear", "trapezoid")],
)
def test_plans_are_those_of_the_controller_in_python(parametrization: str, scheme: str, tmp_path: Path) -> None:
    m = regulator(parametrization, scheme)
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    exported = compiled(export_controller(controller, tmp_path / "robot", advance=0.2))
    state = {"x": 0.5, "v": 0.2}
    for k in range(5):
        step = controller.step(state, advance=0.2 if k else 0.0)
        status, controls, plan = exported(state)
        assert step.solved
        assert status == 0
        np.testing.assert_allclose(plan, controller.program.compiled.current_point(), rtol=0, atol=1e-12)
        first = pyo.value(m.ahead.u[m.ahead.points.first()])
        assert controls == {"u": pytest.approx(first, abs=1e-12)}
        state = {name: step.plan(0.2)[name] + 0.01 * k for name in state}


def test_a_plan_that_fails_leaves_the_rest_of_the_one_before(tmp_path: Path) -> None:
    m = regulator()
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    first = controller.step({"x": 0.5, "v": 0.2})
    exported = compiled(export_controller(controller, tmp_path / "robot", advance=0.2))
    for known in ({"x": 0.4, "v": 0.1}, {"x": 10.0, "v": 0.0}, {"x": 0.3, "v": 0.0}):
        step = controller.step(known, advance=0.2)
        status, _, plan = exported(known)
        assert (status in (0, 1)) == step.solved == (known["x"] < 1)
        np.testing.assert_allclose(plan, controller.program.compiled.current_point(), rtol=0, atol=1e-9)
    assert first.solved


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    m = regulator()
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    with pytest.raises(ModelError, match=r"advance = 4; expected a time from 0 to 3"):
        export_controller(controller, tmp_path / "robot", advance=4)
    assert not (tmp_path / "robot").exists()
    m.ahead.u[m.ahead.points.first()].fix(0.0)
    with pytest.raises(ModelError, match="'regulator': the first value of 'u' is fixed"):
        export_controller(rcp.studies.RecedingHorizon(m, m.ahead), tmp_path / "robot", advance=0.2)
    with pytest.raises(ModelError, match="'regulator': the first value of 'u' is fixed"):
        export_controller(controller, tmp_path / "robot", advance=0.2)  # prepared before that was fixed
    kept = regulator(derivative_bounds=(-3, 3))
    controller = rcp.studies.RecedingHorizon(kept, kept.ahead)
    with pytest.raises(ModelError, match="exact_pairs=True or kept derivatives cannot be exported"):
        export_controller(controller, tmp_path / "robot", advance=0.2)
