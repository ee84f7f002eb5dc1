"""Every way of writing a rule is judged by what it says, or refused: never by something else.

The catalogue states ``x' = -k x + u`` (or a relative of it) in all the ways that Pyomo allows. What a rule says at the
points of the grid stands in the rows that were made of it, so these are the judge of the judges.
"""

import copy
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, PyRobocopError, SimulationFailed, TrajectoryError

K = 0.7
HORIZONS = {"fixed": 1.5, "free": rcp.Duration(bounds=(1.5, 1.5))}

# These state other equations: they read other times.
OTHER_TIMES = {"final value", "previous value", "delay", "nearest", "mean"}
# Refused where indices are no times.
COMPUTES_WITH_INDICES = {"delay", "nearest"}


def writing(name: str) -> Callable[..., Any]:
    def keep(state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        WRITINGS[name] = state
        return state

    return keep


def rate(x: Any, u: Any) -> Any:
    return -K * x + u


WRITINGS: dict[str, Callable[[Any, Any], Any]] = {
    "plain": lambda m, b: lambda b, t: {b.x: rate(b.x[t], b.u[t])},
    "closure over the model": lambda m, b: lambda _, t: {m.p.x: rate(m.p.x[t], m.p.u[t])},
    "find_component": lambda m, b: (
        lambda b, t: {"x": rate(b.find_component("x")[t], b.model().find_component("p.u")[t])}
    ),
    "initial value": lambda m, b: lambda b, t: {b.x: rate(b.x[t], b.u[t]) * b.x[b.time.first()]},
    "duration by a closure": lambda m, b: lambda b, t: {b.x: rate(b.x[t], b.u[t]) * m.p.duration / 1.5},
    "a value asked in the rule": lambda m, b: (
        lambda b, t: {b.x: rate(b.x[t], b.u[t]) if pyo.value(b.x[t]) > -1000.0 else 0}
    ),
    "final value": lambda m, b: lambda b, t: {b.x: rate(b.x[b.final_time], b.u[t])},
    "previous value": lambda m, b: lambda b, t: {b.x: rate(b.x[b.time.prev(t)], b.u[t])},
    "nearest": lambda m, b: lambda b, t: {b.x: rate(b.x[max(s for s in b.time if s <= t)], b.u[t])},
    "mean": lambda m, b: lambda b, t: {b.x: rate(b.x[t], b.u[t]) + sum(m.p.x[:]) / len(b.time)},
}


@writing("a cache")
def _(m, b):
    x = functools.lru_cache(None)(lambda t: m.p.x[t])
    return lambda b, t: {b.x: rate(x(t), b.u[t])}


@writing("expression with a rule")
def _(m, b):
    b.e = pyo.Expression(b.points, rule=lambda b, t: rate(b.x[t], b.u[t]))
    return lambda b, t: {b.x: b.e[t]}


@writing("expression from a dict")
def _(m, b):
    b.e = pyo.Expression(b.points, initialize={t: rate(b.x[t], b.u[t]) for t in b.points})
    return lambda b, t: {b.x: b.e[t]}


@writing("expression with other values than its rule's")
def _(m, b):
    b.e = pyo.Expression(b.points, rule=lambda b, t: 0.0 * b.x[t])
    for t in b.points:
        b.e[t].set_value(rate(b.x[t], b.u[t]))
    return lambda b, t: {b.x: b.e[t]}


@writing("expression with another value at one point")
def _(m, b):
    odd = b.points.at(3)
    b.e = pyo.Expression(b.points, rule=lambda b, t: rate(b.x[t], b.u[t]) + (9 if t == odd else 0))
    b.e[odd].set_value(rate(b.x[odd], b.u[odd]))
    return lambda b, t: {b.x: b.e[t]}


@writing("reference")
def _(m, b):
    m.r = pyo.Reference(b.x[:])
    return lambda b, t: {b.x: rate(m.r[t], b.u[t])}


@writing("parameter over time")
def _(m, b):
    b.k = pyo.Param(b.points, initialize=K, mutable=True)
    return lambda b, t: {b.x: -b.k[t] * b.x[t] + b.u[t]}


@writing("parameter for anything")
def _(m, b):
    m.k = pyo.Param(pyo.Any, default=K, mutable=True)
    return lambda b, t: {b.x: -m.k[t] * b.x[t] + b.u[t]}


@writing("variable of the user's over the points")
def _(m, b):
    b.k = pyo.Var(b.points, initialize=K)
    return lambda b, t: {b.x: -b.k[t] * b.x[t] + b.u[t]}


@writing("delay")
def _(m, b):
    late = b.time.at(3)
    return lambda b, t: {b.x: rate(b.x[t - late] if t - late in b.x else b.x[0.0], b.u[t])}


def model(name: str, horizon: str = "fixed", elements: int = 2) -> pyo.ConcreteModel:
    m, b = one_phase(model="writing", duration=HORIZONS[horizon], elements=elements, stages=2)
    b.x = rcp.State(initial=1.0, initial_guess=lambda t: 1 - 0.3 * t)
    b.u = rcp.Control(initial_guess=lambda t: 0.2 + 0.1 * t)
    b.ode(WRITINGS[name](m, b))
    return m


def disturb(m: Any) -> None:
    """Another plan on the model."""
    for variable in (*m.p.x.values(), *m.p.u.values()):
        if not variable.fixed:
            variable.set_value(3 * variable.value - 2, skip_validation=True)


def defect_of_rows(b: Any) -> float:
    """What the rows that were made of the rule say about the values on the model."""
    grid, width = b.grid, 1.5 / b.grid.mesh.elements
    rates = b.derivative(b.x)
    return max(
        float(
            np.abs(grid.scheme.D @ [b.x[t].value for t in nodes] / width - [pyo.value(rates[t]) for t in stages]).max()
        )
        for nodes, stages in zip(grid.node_times, grid.stage_times, strict=True)
    )


def values(m: Any) -> list[Any]:
    return [(v.name, v.value, v.fixed, v.stale) for v in m.component_data_objects(pyo.Var)]


every_writing = pytest.mark.parametrize("name", WRITINGS)


@every_writing
def test_a_verdict_is_what_the_rows_say_of_a_copy_too_and_whatever_is_on_the_model(name: str) -> None:
    horizon = "free" if len(name) % 2 and name not in COMPUTES_WITH_INDICES else "fixed"
    m = model(name, horizon)
    trajectory, expected = m.p.trajectory(), defect_of_rows(m.p)
    twin = copy.deepcopy(m) if len(name) % 3 else m.clone()
    disturb(m)
    before = values(m)
    assert twin.p.trajectory().verify().defect == pytest.approx(expected, rel=1e-9)
    verdict = trajectory.verify()
    assert verdict.defect == pytest.approx(expected, rel=1e-9)
    assert values(m) == before
    if verdict.element_error is None:
        assert len(verdict.remarks) == 1
        assert "rule" in verdict.remarks[0]
    elif name not in OTHER_TIMES:
        plain = model("plain", horizon).p.trajectory().verify()
        assert (verdict.element_error, verdict.horizon_error) == pytest.approx(
            (plain.element_error, plain.horizon_error), rel=1e-6
        )


@pytest.mark.parametrize("method", ["DOP853", "scheme"])
@every_writing
def test_a_simulation_knows_nothing_of_what_is_on_the_model_or_says_what_it_lacks(name: str, method: str) -> None:
    m = model(name)
    disturb(m)
    before = values(m)
    found, reason = None, "rule"
    try:
        found = m.p.simulate({"u": 0.4}, method=method)
    except (TrajectoryError, SimulationFailed, InitialGuessError) as error:
        reason = str(error)
    assert "rule" in reason or "knows no later value" in reason or "reads later elements" in reason
    assert values(m) == before
    if found is not None and name not in OTHER_TIMES:
        np.testing.assert_allclose(found.x, model("plain").p.simulate({"u": 0.4}, method=method).x, atol=1e-9)
    elif found is not None:  # it is a solution of the rows
        m.p.initialize(found)
        assert defect_of_rows(m.p) < 1e-8


@every_writing
def test_on_another_mesh_a_rule_is_judged_by_one_formula_or_refused(name: str) -> None:
    trajectory = model("plain").p.trajectory()
    m = model(name, elements=3)
    disturb(m)
    try:
        verdict = trajectory.verify(m.p)
    except TrajectoryError:
        return
    if name not in OTHER_TIMES:
        assert verdict.defect == pytest.approx(trajectory.verify().defect, rel=1e-9)


KINDS = {
    "residual": lambda b, t, x: x + b.z[t] == 2,
    "constraint": lambda b, t, x: x <= 0.9,
    "complementarity": lambda b, t, x: rcp.complements(x >= 0.5, b.z[t] >= 0),
}
READINGS = {
    "plain": lambda b, t, m, kept: b.x[t],
    "kept": lambda b, t, m, kept: kept[t],
    "expression of the phase": lambda b, t, m, kept: b.e[t],
    "doubled expression": lambda b, t, m, kept: b.doubled[t],
}


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("kind", KINDS)
def test_residuals_constraints_and_pairs_are_judged_by_what_they_say(kind: str, reading: str) -> None:
    m, b = one_phase(duration=1.0, elements=2, stages=2, x=rcp.State(initial=1.0, initial_guess=lambda t: 1 + t))
    b.z = rcp.Algebraic(initial_guess=lambda t: 0.25 * t)
    b.ode(lambda b, t: {b.x: 1.0})
    b.e = pyo.Expression(b.points, rule=lambda b, t: b.x[t])
    b.doubled = pyo.Expression(b.points, rule=lambda b, t: 2 * b.x[t])
    for t in b.points:
        b.doubled[t].set_value(m.p.x[t])
    kept = {t: b.x[t] for t in b.points}

    def rule(b: Any, t: float) -> Any:
        return KINDS[kind](b, t, READINGS[reading](b, t, m, kept))

    getattr(b, kind)(rule)
    trajectory = b.trajectory()
    for variable in (*b.x.values(), *b.z.values()):
        if not variable.fixed:
            variable.set_value(-7.0, skip_validation=True)
    verdict = trajectory.verify()
    at_the_end = {
        "residual": ("equations", 1 - 1.25 / 6),
        "constraint": ("equations", 1.1),
        "complementarity": ("product", 0.375),
    }
    name, expected = at_the_end[kind]
    assert getattr(verdict, name) == pytest.approx(expected, abs=1e-12)


def test_a_rule_of_another_model_is_refused() -> None:
    other = model("plain")
    part = pyo.Block(concrete=True)  # to be assigned to a model later, which may be the one that is read
    part.p = b = rcp.PhaseBlock(duration=1.5, elements=2, stages=2)
    b.x = rcp.State(initial=1.0, initial_guess=1.0)
    b.ode(lambda b, t: {b.x: other.p.x[t]})
    m = pyo.ConcreteModel()
    m.part = part
    with pytest.raises(PyRobocopError, match="rule '<lambda>' reads 'p.x' of another model"):
        b.trajectory().verify()
