"""The best round is always given back, whatever happens to the rounds after it."""

import math
from collections.abc import Iterator

import pyomo.environ as pyo
import pytest
from harness.scenes import avoiding, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import check_pose
from pyrobocop_pyomo.planning.recovery import PlanningPoint, PlanStart, Recovery


def flight() -> pyo.ConcreteModel:
    """Half a turn in two elements: a quaternion that has length one at the nodes, and less between them."""
    m = pyo.ConcreteModel()
    m.fly = f = rcp.PhaseBlock(duration=1.0, elements=2, stages=1)
    for name in ("x", "qw", "qz"):
        setattr(f, name, rcp.State())
    for k, t in enumerate(f.time):
        f.x[t], f.qw[t], f.qz[t] = float(k), math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)
    f.avoid = rcp.ObstacleAvoidanceBlock(
        f.time,
        body=rcp.Polytope.box(1, 0.6, 0.1),
        pose=lambda f, t: rcp.spatial_pose((f.x[t], 0, 0), quaternion=(f.qw[t], 0, 0, f.qz[t])),
        obstacles={"post": rcp.Polytope.box(0.3, 0.3, 4, center=(1, 5, 0))},
        clearance=0.05,
    )
    return m


def test_poses_between_nodes_are_not_judged_when_a_round_is_restored() -> None:
    m = flight()
    block = m.fly.avoid
    block.initialize()
    point = PlanningPoint(m)
    first, second, start = next(iter(block.separations))
    _, right = block.split(first, second, start)
    between = block.record.poses[first, right[2]]
    with pytest.raises(ObstacleError, match="differs from the identity"):
        check_pose(between, "body")
    m.fly.x[0.0] = 7.0
    point.restore()
    assert m.fly.x[0.0].value == 0.0
    assert all(variable.value is not None for variable in block.component_data_objects(pyo.Var))
    block.initialize()


@pytest.mark.ipopt
def test_a_start_that_cannot_be_made_does_not_lose_the_rounds_before(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    m = turning_move(elements=2)
    avoiding(m, obstacles={"wall": rcp.Polytope.box(0.2, 40, center=(2, 0))})

    def starts(self: Recovery) -> Iterator[PlanStart]:
        yield PlanStart("first")
        raise ObstacleError("no such start")

    monkeypatch.setattr(Recovery, "starts", starts)
    result = rcp.solve(m, options={"max_iter": 3})
    assert not result.safe
    assert result.rounds
    assert "no such start" in caplog.text
