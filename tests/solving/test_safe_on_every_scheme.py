"""A plan is proven safe whatever the scheme, with free durations, moving elements and continuous sets alike."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.scenes import effort_of, keep_clear, placed, rigid_body, sampled_distance

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs import function_rows
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram

pytestmark = pytest.mark.casadi

BODY = rcp.Polytope.from_vertices([(-0.3, -0.2), (0.5, -0.2), (0.2, 0.3)], name="body")
WALL = rcp.Polytope.box(0.6, 1.0, center=(0.0, -0.3), name="wall")
CLEARANCE = 0.05

SCHEMES: list[tuple[str, int | None]] = [
    ("implicit_euler", None), ("implicit_midpoint", None), ("radau", 1), ("radau", 2), ("radau", 3), ("gauss", 2),
    ("gauss", 3), ("lobatto", 3), ("trapezoid", None), ("explicit_euler", None),
]  # fmt: skip


def build(**options: Any) -> pyo.ConcreteModel:
    """Over the wall, turning once on the way."""
    m, b = one_phase("move", model="over the wall", **{"duration": 4.0, "elements": 12, **options})
    kind = "piecewise_linear" if b.grid.elements_share_points else "piecewise_constant"
    rigid_body(b, (-1.5, 0, 0), (1.5, 0, 2.0), bounds=(-3, 3), parametrization=kind)
    m.effort = pyo.Objective(expr=effort_of(b) + b.duration)
    keep_clear(b, BODY, [WALL], placed, CLEARANCE)
    return m


def closest(m: pyo.ConcreteModel) -> float:
    """By the judge, 400 times per element."""
    trajectory = m.move.trajectory()
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    times = np.unique(boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0, 1, 401))
    return sampled_distance(trajectory, BODY, [WALL], times)


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


@pytest.mark.asl
def test_what_vectorised_expressions_do_not_know_is_left_to_asl(monkeypatch: pytest.MonkeyPatch) -> None:
    m = build(elements=6, stages=2)
    assert "vectorised" in rcp.solve(m, progress=False).derivatives

    # What vectorised expressions do not know are external functions, which need a library of their own.
    class Refusing(VectorisedProgram):
        def __init__(self, *_: Any) -> None:
            raise ModelError("an expression holds an external function")

    monkeypatch.setattr(function_rows, "VectorisedProgram", Refusing)
    result = rcp.solve(build(elements=6, stages=2), progress=False)
    assert "ASL" in result.derivatives
    assert result.safe
    with pytest.raises(ModelError, match="external function"):
        rcp.solve(build(elements=6, stages=2), backend="vectorised", progress=False)
