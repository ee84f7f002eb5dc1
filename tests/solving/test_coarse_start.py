"""Long plans among many obstacles start from a copy on fewer elements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, state_point

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.planning import safe_planning

pytestmark = [pytest.mark.ipopt, pytest.mark.slow]


def field(elements: int) -> Any:
    """A disc through a field of posts."""
    m = pyo.ConcreteModel(name="field")
    m.move = b = rcp.PhaseBlock(duration=2.0, elements=elements, stages=2)
    state_point(b)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2))
    b.initialize_straight_lines()
    posts = {f"post {x} {y}": rcp.Polytope.box(0.3, 0.3, center=(x, y)) for x in (1, 2, 3) for y in (-0.7, 0.1, 0.9)}
    keep_clear(b, rcp.Polytope.box(0.2, 0.2), posts)
    return m


def test_a_start_on_fewer_elements_leads_to_the_same_plan_and_keeps_the_users_variables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(safe_planning, "LEAST_PAIRS", 50)
    m = field(80)
    held = dict(m.move.x.items())
    result = rcp.solve(m)
    assert result.safe
    assert any(made.purpose.startswith("fewer elements: ") for made in result.rounds)
    assert any(made.purpose == "from a plan on 20 elements" for made in result.rounds)
    assert m.move.grid.mesh.elements == 80
    assert all(m.move.x[t] is variable for t, variable in held.items())
    monkeypatch.undo()
    directly = rcp.solve(field(80))
    assert directly.safe
    assert result.objective == pytest.approx(directly.objective, rel=2e-2)
    assert np.isfinite(result.objective)


def test_equations_are_looked_at_on_the_users_mesh_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safe_planning, "LEAST_PAIRS", 50)
    asked: set[tuple[int, bool]] = set()
    verify = ObstacleAvoidanceBlockData.verify

    def noted(block: Any, *, equations: bool) -> Any:
        asked.add((len(block.motion.intervals), equations))
        return verify(block, equations=equations)

    monkeypatch.setattr(ObstacleAvoidanceBlockData, "verify", noted)
    assert rcp.solve(field(80)).safe
    assert asked == {(20, False), (80, True)}
