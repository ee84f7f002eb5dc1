"""A user's function is called while the model is being built, and never again, by whatever door."""

import math
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.scenes import at_place, keep_clear

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


class Asked:
    """Wraps functions of a user, and remembers which of them are called after the model is built."""

    def __init__(self) -> None:
        self.built, self.again = False, set[str]()

    def __call__(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def asked(*arguments: Any) -> Any:
            if self.built:
                self.again.add(name)
            return function(*arguments)

        asked.__name__ = name
        return asked


def moved(asked: Asked, ode: Callable[..., Any], bounds: Any = (-1, 1), duration: Any = 1.0) -> pyo.ConcreteModel:
    """On so coarse a mesh that a solve refines it, where it may."""
    m, b = one_phase(duration=duration, elements=4, x=rcp.State(initial=1.0))
    b.u = rcp.Control(bounds=bounds, initial_guess=asked("guess", lambda t: math.sin(t)))
    b.ode(asked("ode", ode))
    b.constraint(asked("constraint", lambda b, t: b.u[t] + b.x[t] <= 3))
    b.constraint_at_boundaries(asked("boundaries", lambda b, t: b.x[t] >= -5))
    m.cost = pyo.Objective(expr=b.integral(asked("cost", lambda b, t: (b.x[t] - 0.3) ** 2 + 0.01 * b.u[t] ** 2)))
    return m


def templates(asked: Asked) -> pyo.ConcreteModel:
    return moved(asked, lambda b, t: {b.x: b.u[t] - 20 * b.x[t] ** 2}, asked("bounds", lambda t: (-1 - t, 1)))


def functions_of_numbers(asked: Asked) -> pyo.ConcreteModel:
    """The time has to be known: the mesh stays."""
    bounds = asked("bounds", lambda t: (-1, 1 + math.sin(9 * t)))
    return moved(asked, lambda b, t: {b.x: b.u[t] - (20 * b.x[t] ** 2 if t < 0.3 else b.x[t])}, bounds)


def named_expressions(asked: Asked) -> pyo.ConcreteModel:
    m, b = one_phase(duration=1.0, elements=4)
    b.x, b.u = rcp.State(initial=1.0, history=asked("history", lambda t: pyo.cos(t))), rcp.Control(bounds=(-1, 1))
    b.drag = pyo.Expression(b.points, rule=asked("drag", lambda b, t: b.x[t] ** 2))
    b.parts = pyo.Expression([1, 2], b.points, rule=asked("parts", lambda b, i, t: i * b.drag[t]))
    b.ode(asked("ode", lambda b, t: {b.x: b.u[t] - b.parts[1, t] - b.parts[2, t] - b.x.delayed(t, 0.1)}))
    m.cost = pyo.Objective(expr=b.integral(asked("cost", lambda b, t: b.drag[t] + b.u[t] ** 2)))
    return m


def pairs_and_delays(asked: Asked) -> pyo.ConcreteModel:
    m, b = one_phase(duration=1.0, elements=5, x=rcp.State(initial=1.0, history=asked("history", lambda t: 1 + t)))
    b.u = rcp.Control(bounds=(-1, 1))
    b.z = rcp.Algebraic(bounds=(0, None))
    b.ode(asked("ode", lambda b, t: {b.x: b.u[t] + b.z[t] - b.x.delayed(t, 0.2)}))
    b.complementarity(asked("pair", lambda b, t: rcp.complements(b.z[t] >= 0, b.x[t] - 0.5 >= 0)))
    m.cost = pyo.Objective(expr=b.integral(asked("cost", lambda b, t: b.x[t] ** 2 + b.u[t] ** 2)))
    return m


def history_by_numbers(asked: Asked) -> pyo.ConcreteModel:
    """Before the start, it is known for the points of the mesh alone."""
    m, b = one_phase(duration=1.0, elements=5)
    b.x, b.u = rcp.State(initial=1.0, history=asked("history", math.cos)), rcp.Control(bounds=(-1, 1))
    b.ode(asked("ode", lambda b, t: {b.x: b.u[t] - b.x.delayed(t, 0.2)}))
    m.cost = pyo.Objective(expr=b.integral(asked("cost", lambda b, t: b.x[t] ** 2 + b.u[t] ** 2)))
    return m


def scene(asked: Asked) -> pyo.ConcreteModel:
    """Two blocks share one body, whose rule is asked once for each."""
    m = pyo.ConcreteModel()
    truck = rcp.Body(
        rcp.Polytope.box(0.2, 0.2), pose=asked("drift", lambda b, t: rcp.planar_pose(0.5, 0.05 + 0.1 * b.time_at(t)))
    )
    for name in ("first", "second"):
        b = rcp.PhaseBlock(duration=2.0, elements=6)
        m.add_component(name, b)
        b.x, b.y = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
        b.vx, b.vy = rcp.Control(bounds=(-2, 2)), rcp.Control(bounds=(-2, 2))
        b.ode(asked("ode", lambda b, t: {b.x: b.vx[t], b.y: b.vy[t]}))
        rules = asked("pose", at_place), asked("clearance", lambda b, t: 0.02)
        keep_clear(b, rcp.Polytope.box(0.1, 0.1), {"truck": truck}, *rules)
    m.cost = pyo.Objective(
        expr=sum(b.integral(asked("cost", lambda b, t: b.vx[t] ** 2 + b.vy[t] ** 2)) for b in (m.first, m.second))
    )
    return m


MODELS = {
    "templates": templates,
    "free duration": lambda asked: moved(
        asked, lambda b, t: {b.x: b.u[t] - 20 * b.x[t] ** 2}, duration=rcp.Duration(bounds=(0.9, 1.1))
    ),
    "functions of numbers": functions_of_numbers,
    "named expressions": named_expressions,
    "pairs and delays": pairs_and_delays,
    "history by numbers": history_by_numbers,
    "scene": scene,
}


def go_through(m: pyo.ConcreteModel, folder: Path) -> None:
    """Every door; what says that something is not known has not called anything either."""
    result = rcp.solve(m, progress=False)
    str(result), repr(result), result._repr_html_()
    copies = [m.clone()]
    if m.find_component("p.drag") is None:  # Pyomo pickles no Expression with a local function for its rule
        copies.append(pickle.loads(pickle.dumps(m)))
    for copy in copies:
        rcp.solve(copy, progress=False)
    pyo.SolverFactory("pyrobocop.mpcc").solve(m)
    rcp.diagnose(m)
    rcp.studies.multistart(m, 2)
    for b in m.component_data_objects(pyo.Block, descend_into=False):
        trajectory = b.trajectory()
        trajectory.save(folder / f"{b.local_name}.npz")
        trajectory.plot()
        b.verify(trajectory)
        b.initialize(trajectory)
        for act in (b.simulate, b.reintegrate, lambda b=b: rcp.remesh_phases({b: 16})):
            with suppress(rcp.errors.PyRobocopError):
                act()
        if b.component("avoid") is not None:
            b.avoid.initialize()
            b.avoid.verify()


def test_a_motion_that_reads_an_unknown_history_is_not_known() -> None:
    m = history_by_numbers(Asked())
    rcp.solve(m, progress=False)
    assert math.isnan(m.p.trajectory().verify().horizon_error or math.nan)
    with pytest.raises(rcp.errors.PyRobocopError, match=r"history of 'x' .*has to know the time as a number"):
        m.p.simulate()


@pytest.mark.parametrize("name", MODELS)
def test_no_function_is_called_after_the_model_is_built(name: str, tmp_path: Path) -> None:
    asked = Asked()
    m = MODELS[name](asked)
    asked.built = True
    go_through(m, tmp_path)
    assert asked.again == set()
