"""`solve` answers for containments as for obstacles: inside at all times, or said not to be."""

from math import pi

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.ipopt

BAR = rcp.Polytope.box(1, 0.2)


def pose(b, t):
    return rcp.planar_pose(0, b.y[t], b.theta[t])


def turning_over_a_floor(
    *, ceiling: float = 2.0, obstacle: bool = False, shape: rcp.Polytope = BAR
) -> pyo.ConcreteModel:
    """A bar makes half a turn between a floor and a ceiling and stays low: steepest between the boundaries."""
    m, b = one_phase("turn", model="half a turn", duration=1.0, elements=3, scheme="implicit_euler")
    b.y, b.theta = rcp.State(initial=0.2, final=0.2), rcp.State(initial=0, final=pi)
    b.climb, b.rate = rcp.Control(), rcp.Control(bounds=(pi, pi))
    b.ode(lambda b, t: {b.y: b.climb[t], b.theta: b.rate[t]})
    m.low = pyo.Objective(expr=b.integral(lambda b, t: b.y[t] ** 2 + 1e-3 * b.climb[t] ** 2))
    b.initialize_straight_lines()
    room = rcp.Polytope.from_halfspaces([[0, -1], [0, 1]], [0, ceiling], bounded=False)
    b.inside = rcp.Containment(b.time, body=shape, pose=pose, region=room)
    if obstacle:
        far = {"far": rcp.Polytope.box(1, 1, center=(5, 0))}
        b.avoid = rcp.ObstacleAvoidanceBlock(b.time, body=shape, pose=pose, obstacles=far, clearance=0.05)
    return m


@pytest.mark.parametrize("obstacle", [False, True], ids=["alone", "beside obstacles"])
def test_a_body_is_held_inside_between_the_points(obstacle: bool) -> None:
    m = turning_over_a_floor(obstacle=obstacle)
    result = rcp.solve(m)
    assert result.solved
    assert result.safe
    assert m.turn.inside.verify().safe
    assert not result.rounds[0].safe  # what the points alone give is not
    assert {pair.second for pair in result.safety.body_pairs} == {"side 1", "side 2"} | ({"far"} if obstacle else set())


def test_a_region_that_is_left_between_the_points_is_no_plan() -> None:
    m = turning_over_a_floor(ceiling=1.0)  # the bar reaches 1.02 from corner to corner
    result = rcp.solve(m)
    assert not result.safe
    assert not result.solved
    assert "side" in result.report()
    with pytest.raises(rcp.errors.SolveFailed):
        result.raise_for_status()


def test_a_fixed_pose_outside_is_refused_with_what_is_missing() -> None:
    m = turning_over_a_floor(ceiling=0.25)
    with pytest.raises(rcp.errors.ObstacleError, match=r"'turn.inside': at t = [01].0, .* is 0.05 beyond side 2"):
        rcp.solve(m)


def test_margins_of_the_best_round_are_left_on_the_model() -> None:
    m = turning_over_a_floor()
    inside = m.turn.inside
    assert rcp.solve(m).safe
    asked = {t: pyo.value(inside.margin[t]) for t in inside.times}
    assert max(asked.values()) > 0
    assert max(row.uslack() for row in inside.inside.values()) >= 0
    assert min(row.uslack() for row in inside.inside.values()) > -1e-6
    again = rcp.solve(m)  # starts without margins, and finds them anew
    assert again.safe


def test_a_pose_may_read_the_model_beside_its_first_argument() -> None:
    m = turning_over_a_floor()
    b = m.turn
    b.del_component("inside")
    b.inside = rcp.Containment(b.time, body=BAR, pose=lambda _, t: pose(b, t), region=rcp.Polytope.box(9, 9))
    assert rcp.solve(m).safe


def test_blocks_with_the_same_names_are_tightened_each_by_its_own_report() -> None:
    m = turning_over_a_floor(ceiling=1.5)
    b = m.turn
    floor = rcp.Polytope.from_halfspaces([[0, 1]], [0], bounded=False)
    far = rcp.Polytope.box(1, 1, center=(9, 0))
    b.del_component("inside")
    b.near = rcp.ObstacleAvoidanceBlock(b.time, body=BAR, pose=pose, obstacles=[floor], clearance=0.05)
    b.far = rcp.ObstacleAvoidanceBlock(b.time, body=BAR, pose=pose, obstacles=[far], clearance=0.05)
    result = rcp.solve(m)
    assert result.safe
    assert len(result.rounds) > 1
    sagging = max(pyo.value(b.near.margin[index]) for index in b.near.separations)
    assert sagging > 0
    # The far one is asked for its own sag only; what the near one missed would add 0.027.
    assert max(pyo.value(b.far.margin[index]) for index in b.far.separations) < 0.01
