"""A plan is proven safe whatever the scheme, with free durations, moving elements and continuous sets alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.dae as dae
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs import compositions
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram

pytestmark = pytest.mark.casadi

BODY = rcp.Polytope.from_vertices([(-0.3, -0.2), (0.5, -0.2), (0.2, 0.3)], name="body")
WALL = rcp.Polytope.box(0.6, 1.0, center=(0.0, -0.3), name="wall")
CLEARANCE = 0.05

SCHEMES: list[tuple[str, int | None]] = [
    ("implicit_euler", None), ("implicit_midpoint", None), ("radau", 1), ("radau", 2), ("radau", 3), ("gauss", 2),
    ("gauss", 3), ("lobatto", 3), ("trapezoid", None), ("explicit", 1), ("explicit", 3),
]  # fmt: skip


def pose(b: Any, t: Any) -> rcp.scenes.Pose:
    return rcp.planar_pose(b.x[t], b.y[t], b.theta[t])


def build(**options: Any) -> pyo.ConcreteModel:
    """Over the wall, turning once on the way."""
    m = pyo.ConcreteModel(name="over the wall")
    m.move = b = rcp.PhaseBlock(**{"duration": 4.0, "elements": 12, **options})
    b.x = rcp.State(initial=-1.5, final=1.5)
    b.y = rcp.State(initial=0, final=0)
    b.theta = rcp.State(initial=0, final=2.0)
    kind = "piecewise_linear" if b.grid.elements_share_points else "piecewise_constant"
    for name in ("x_rate", "y_rate", "theta_rate"):
        b.declare(name, rcp.Control(bounds=(-3, 3), parametrization=kind))
    b.initialize_straight_lines()

    @b.ode
    def velocities(b, t):
        return {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]}

    m.effort = pyo.Objective(
        expr=b.integral(lambda b, t: b.x_rate[t] ** 2 + b.y_rate[t] ** 2 + b.theta_rate[t] ** 2) + b.duration
    )
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, bodies={"body": rcp.Body(BODY, pose=pose)}, obstacles=[WALL], clearance=CLEARANCE
    )
    return m


def closest(m: pyo.ConcreteModel) -> float:
    """By the judge, 400 times per element."""
    trajectory = m.move.trajectory()
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    times = np.unique(boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0, 1, 401))
    found = trajectory(times)
    poses = (rcp.planar_pose(*each) for each in zip(found["x"], found["y"], found["theta"], strict=True))
    return min(rcp.scenes.signed_distance(BODY, WALL, at).distance for at in poses)


@pytest.mark.parametrize(("scheme", "stages"), SCHEMES)
def test_every_scheme(scheme: str, stages: int | None) -> None:
    m = build(scheme=scheme, **({} if stages is None else {"stages": stages}))
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    assert result.safe
    assert closest(m) >= 0.99 * CLEARANCE - 1e-9


@pytest.mark.parametrize("moving", [None, (0.4, 2.5)])
def test_a_free_duration_and_moving_elements(moving: tuple[float, float] | None) -> None:
    m = build(duration=rcp.Duration(bounds=(1, 10), initial_guess=4), stages=2, free_element_widths=moving)
    rcp.solve(m, progress=False).raise_for_status()
    assert closest(m) >= 0.99 * CLEARANCE - 1e-9


@pytest.mark.parametrize("transformation", ["pyrobocop.collocation", "dae.collocation", "dae.finite_difference"])
def test_a_continuous_set(transformation: str) -> None:
    m = pyo.ConcreteModel(name="continuous")
    m.t = dae.ContinuousSet(bounds=(0, 4))
    for name, first, last in (("x", -1.5, 1.5), ("y", 0.0, 0.0), ("theta", 0.0, 2.0)):
        state = pyo.Var(m.t, initialize=lambda m, t, a=first, b=last: a + (b - a) * t / 4)
        m.add_component(name, state)
        m.add_component(f"{name}_dot", dae.DerivativeVar(state, wrt=m.t, initialize=0))
        m.add_component(f"{name}_rate", pyo.Var(m.t, bounds=(-3, 3), initialize=0))
        m.add_component(
            f"{name}_ode",
            pyo.Constraint(m.t, rule=lambda m, t, n=name: getattr(m, f"{n}_dot")[t] == getattr(m, f"{n}_rate")[t]),
        )
        state[0].fix(first)
        state[4].fix(last)
    options = {"nfe": 12} if transformation == "dae.finite_difference" else {"nfe": 12, "ncp": 2}
    pyo.TransformationFactory(transformation).apply_to(m, wrt=m.t, **options)
    for name in ("x", "y", "theta"):
        for t in m.t:
            variable = m.component(name)[t]
            if variable.value is None:
                first, last = m.component(name)[0].value, m.component(name)[4].value
                variable.set_value(first + (last - first) * t / 4)
    m.effort = pyo.Objective(
        expr=sum(each[t] ** 2 for each in (m.x_rate, m.y_rate, m.theta_rate) for t in m.t if each[t].value is not None)
    )
    m.avoid = rcp.ObstacleAvoidanceBlock(
        m.t, bodies={"body": rcp.Body(BODY, pose=pose)}, obstacles=[WALL], clearance=CLEARANCE
    )
    result = rcp.solve(m, progress=False, equations=False)
    result.raise_for_status()
    assert result.safe
    if transformation != "dae.finite_difference":  # rows at points alone; differences are lines, which is assumed
        result = rcp.solve(m, progress=False)
        assert not result.safe
        assert "rows at its points" in result.report()


@pytest.mark.asl
def test_what_vectorised_expressions_do_not_know_is_left_to_asl(monkeypatch: pytest.MonkeyPatch) -> None:
    m = build(elements=6, stages=2)
    assert "vectorised" in rcp.solve(m, progress=False).derivatives

    # What vectorised expressions do not know are external functions, which need a library of their own.
    class Refusing(VectorisedProgram):
        def __init__(self, *_: Any) -> None:
            raise ModelError("an expression holds an external function")

    monkeypatch.setattr(compositions, "VectorisedProgram", Refusing)
    result = rcp.solve(build(elements=6, stages=2), progress=False)
    assert "ASL" in result.derivatives
    assert result.safe
    with pytest.raises(ModelError, match="external function"):
        rcp.solve(build(elements=6, stages=2), backend="vectorised", progress=False)
