"""A body stays inside the union of convex regions: in one of them on each interval, and in both where it changes."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, on_points, placed, sampled
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.containment_proof import verify_inside

BAR = rcp.Polytope.box(0.6, 0.4)
BEND = [rcp.Polytope.box(4, 1, center=(2, 0)), rcp.Polytope.box(1, 4, center=(3.5, 1.5))]
SNAKE = [*BEND, rcp.Polytope.box(4, 1, center=(2, 3)), rcp.Polytope.box(1, 4, center=(0.5, 4.5))]


def corridor(
    regions: Any, goal: tuple[float, float], elements: int = 8, body: Any = BAR, **options: Any
) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(duration=2.0, elements=elements)
    b.x, b.y = rcp.State(initial=0.5, final=goal[0]), rcp.State(initial=0, final=goal[1])
    b.theta = rcp.State(initial=0)
    b.vx, b.vy, b.turn = rcp.Control(), rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.vx[t], b.y: b.vy[t], b.theta: b.turn[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.vx[t] ** 2 + b.vy[t] ** 2 + 0.1 * b.turn[t] ** 2))
    b.initialize_straight_lines()
    b.inside = rcp.Containment(b.time, body=body, pose=by_states, region=regions, **options)
    return m


@pytest.mark.ipopt
def test_a_union_of_one_region_is_the_region() -> None:
    room = rcp.Polytope.box(4, 1, center=(2, 0))
    single, union = (corridor(regions, (3.0, 0.2), elements=4) for regions in (room, [room]))
    assert rcp.solve(single).objective == rcp.solve(union).objective
    assert list(single.move.inside.inside) == list(union.move.inside.inside)


@pytest.mark.ipopt
def test_a_straight_line_through_walls_becomes_a_plan_around_the_bend() -> None:
    m = corridor(BEND, (3.5, 3.0), clearance=0.01)
    result = rcp.solve(m)
    assert result.safe
    assert sorted(set(m.move.inside.record.choice)) == [0, 1]
    path = m.move.trajectory()(np.linspace(0, 2, 400))
    corners = placed(BAR.vertices, np.stack([path["x"], path["y"], path["theta"]], axis=1))
    rooms = [(region.halfspaces[1] - corners @ region.halfspaces[0].T).min(axis=(1, 2)) for region in BEND]
    assert np.max(rooms, axis=0).min() >= 0.0099 - 1e-9


@pytest.mark.ipopt
def test_revised_changes_of_region_never_cost_more() -> None:
    m = corridor(SNAKE, (0.5, 6.0))
    first = corridor(SNAKE, (0.5, 6.0))
    pyo.SolverFactory("pyrobocop.ipopt").solve(first)
    result = rcp.solve(m)
    assert result.safe
    assert m.move.inside.record.choice != first.move.inside.record.choice
    assert result.objective < 0.95 * pyo.value(first.cost)
    # The best round is on the model, with its choice.
    assert pyo.value(m.cost) == pytest.approx(result.objective)
    assert m.move.inside.verify().safe


@given(seed=st.integers(0, 10**6))
def test_inside_is_never_said_of_a_motion_that_leaves_all_regions(seed: int) -> None:
    random = np.random.default_rng(seed)
    poses = random.normal(size=(4, 3)) * [1.2, 1.2, 1.0] + [2.5, 0.8, 0.0]
    regions = [region.placed(rcp.planar_pose(0, 0)) for region in BEND]
    m = on_points(poses)
    body = Body(rcp.Polytope.box(0.3, 0.2, name="bar").padded(0.05), by_states)
    (pair,) = verify_inside(motion_of(m.t, m), body, regions, 0.1, 0.001).body_pairs
    corners = placed(body.parts[0].vertices, sampled(poses, 500))
    rooms = [(region.halfspaces[1] - corners @ region.halfspaces[0].T).min(axis=(1, 2)) - 0.05 for region in regions]
    room = np.max(rooms, axis=0).min()
    assert pair.proven <= room + 1e-9
    if room > 0.1 + 1e-4:
        assert pair.safe
    if not pair.safe and not pair.undecided:
        assert pair.distance == pytest.approx(room, abs=0.1)


def test_a_body_too_large_for_an_overlap_is_said_with_the_distance(caplog: pytest.LogCaptureFixture) -> None:
    rooms = [rcp.Polytope.box(2, 1, center=(1, 0)), rcp.Polytope.box(2, 1, center=(2.6, 0))]  # they share 0.4
    with caplog.at_level(logging.WARNING):
        corridor(rooms, (3.0, 0.0))
    # Half of what is missing on each side.
    assert "an overlap is too narrow by 0.1" in caplog.text


def test_a_fixed_pose_outside_all_regions_is_refused_with_the_distance() -> None:
    m = corridor(BEND, (3.5, 5.0))
    m.move.theta[2.0].fix(0.0)
    with pytest.raises(rcp.errors.ObstacleError, match=r"at t = 2.0, .* none of the 2 regions: region 2 lacks 1.7"):
        rcp.solve(m)


def test_a_time_between_two_regions_has_the_rows_of_both() -> None:
    m = corridor(BEND, (3.5, 3.0), elements=2)
    inside = m.move.inside
    inside.choose([0, 1])
    at = {time: {side for t, _, side in inside.inside if t == time} for time in inside.times}
    start, middle, end = at[0.0], at[1.0], at[2.0]
    assert (len(start), len(middle), len(end)) == (4, 8, 4)
    assert middle == start | end
    for wrong in ([0], [0, 2], [0, -1]):
        with pytest.raises(rcp.errors.ObstacleError, match="choose"):
            inside.choose(wrong)
    copied = m.clone()
    copied.move.inside.choose([1, 1])
    assert inside.record.choice == [0, 1]


def test_points_without_order_choose_one_by_one() -> None:
    m = on_points([[0.5, 0.0, 0.0], [3.5, 3.0, 0.0], [1.0, 2.0, 0.0]])
    m.names = pyo.Set(initialize=["a", "b", "c"], ordered=False)
    m.inside = rcp.Containment(
        m.names, body=BAR, pose=lambda m, name: by_states(m, {"a": 0, "b": 1, "c": 2}[name]), region=BEND
    )
    assert dict(zip(m.inside.record.times, m.inside.record.choice, strict=True))["b"] == 1
    report = m.inside.verify()
    assert not report.safe
    assert report.worst.time == "c"
    assert report.worst.distance == pytest.approx(-1.7)


@pytest.mark.parametrize("regions", [[], "room", [BEND[0], 3], [BEND[0], rcp.Polytope.box(1, 1, 1)]])
def test_what_is_no_region_is_refused(regions: Any) -> None:
    with pytest.raises(rcp.errors.ObstacleError, match="region"):
        corridor(regions, (3.0, 0.0))
