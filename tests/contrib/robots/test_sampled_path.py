"""Paths of arms among random configurations: clear by exact distances, within bounds, from the start to the goal."""

import logging
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import avoiding, keep_clear, placed, turning_move
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.robots.configuration_space import ConfigurationSpace
from pyrobocop_pyomo.errors import InitialGuessError

LENGTHS = (0.5, 0.4)
BOX = rcp.Polytope.box(0.3, 0.5, center=(0.72, 0.0))
CLEARANCE = 0.02
START, GOAL = (-0.9, 0.1), (0.9, -0.1)


def arm(
    *, order: int = 1, hand: tuple[float, float] | None = None, box: rcp.Polytope = BOX, duration: Any = 2.0,
    bounds: tuple[float | None, float | None] = (-2.8, 2.8),
) -> pyo.ConcreteModel:  # fmt: skip
    """Two links in the plane around a box, from joint angles to joint angles, or to a place of the hand."""
    m = pyo.ConcreteModel(name="arm")
    m.reach = b = rcp.PhaseBlock(duration=duration, elements=10, stages=2)
    for k in range(2):
        final = {} if hand else {"final": GOAL[k]}
        b.declare(f"q{k}", rcp.State(initial=START[k], bounds=bounds, **final))
        if order == 1:
            b.declare(f"w{k}", rcp.Control(bounds=(-3, 3)))
        else:
            b.declare(f"w{k}", rcp.State(initial=0, final=0, bounds=(-3, 3)))
            b.declare(f"a{k}", rcp.Control(bounds=(-20, 20)))

    @b.ode
    def turning(b: Any, t: Any) -> dict[Any, Any]:
        rates = {b.q0: b.w0[t], b.q1: b.w1[t]}
        return rates if order == 1 else rates | {b.w0: b.a0[t], b.w1: b.a1[t]}

    def upper(b: Any, t: Any) -> rcp.scenes.Pose:
        return rcp.planar_pose(0, 0, b.q0[t])

    def lower(b: Any, t: Any) -> rcp.scenes.Pose:
        return upper(b, t) @ rcp.planar_pose(LENGTHS[0], 0, b.q1[t])

    b.initialize_straight_lines()
    links = [rcp.Polytope.capsule((0, 0), (length, 0), 0.03) for length in LENGTHS]
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, bodies={"upper": rcp.Body(links[0], pose=upper), "lower": rcp.Body(links[1], pose=lower)},
        obstacles={"box": box}, exclude=[("upper", "lower")], clearance=CLEARANCE,
    )  # fmt: skip
    if hand is not None:
        turned, place = lower(b, b.time.last()).apply((LENGTHS[1], 0.0)), hand
        m.hand = pyo.Constraint([0, 1], rule=lambda m, i: turned[i] == place[i])
    moved = "w" if order == 1 else "a"
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: sum(b.component(f"{moved}{k}")[t] ** 2 for k in range(2))))
    return m


def hand_at(q: Any) -> np.ndarray:
    angles = np.cumsum(q)
    return np.array([LENGTHS @ np.cos(angles), LENGTHS @ np.sin(angles)])


def distances(m: pyo.ConcreteModel, q: Any, box: rcp.Polytope = BOX) -> float:
    """Exact distance of the arm from the box, by other code than that of the search."""
    bodies = m.reach.avoid.record.scene.bodies
    upper = rcp.planar_pose(0, 0, q[0])
    poses = {"upper": upper, "lower": upper @ rcp.planar_pose(LENGTHS[0], 0, q[1])}
    return min(rcp.scenes.signed_distance(bodies[name].shape, box, pose).distance for name, pose in poses.items())


def test_configurations_are_clear_of_a_wedge_without_end() -> None:
    """Its corner and the far ones of its rays are more than the corners of the links."""
    wedge = rcp.Polytope.from_halfspaces([[-1, 0], [0, 1]], [-0.6, -0.2], bounded=False)
    m = arm(box=wedge)
    points = np.random.default_rng(0).uniform(-2.8, 2.8, (40, 2))
    clear = ConfigurationSpace(m.reach).are_clear(points)
    assert clear.tolist() == [distances(m, q, wedge) >= CLEARANCE for q in points]
    assert 0 < clear.sum() < len(clear)


@given(seed=st.integers(0, 10**6))
@settings(deadline=None, max_examples=8)
def test_a_path_is_clear_within_bounds_and_leads_from_start_to_goal(seed: int) -> None:
    m = arm()
    assert any(distances(m, q) < 0 for q in ConfigurationSpace(m.reach).guess())
    guess = rcp.scenes.sampled_path(m.reach, seed=seed)
    path = np.array([[guess[name](t) for name in ("q0", "q1")] for t in np.linspace(0.0, 2.0, 101)])
    assert np.allclose(path[[0, -1]], [START, GOAL])
    assert (np.abs(path) <= 2.8).all()
    # Between the configurations that were looked at a corner may come closer, by half of their spacing.
    spacing = ConfigurationSpace(m.reach).spacing
    assert min(distances(m, q) for q in path) >= CLEARANCE - 0.5 * spacing
    assert min(distances(m, q) for q in path) > 0.0


def test_the_same_seed_gives_the_same_path() -> None:
    first, second = (rcp.scenes.sampled_path(arm().reach, seed=5) for _ in range(2))
    assert [first["q0"](t) for t in (0.3, 1.1)] == [second["q0"](t) for t in (0.3, 1.1)]


@pytest.mark.parametrize("bounds", [(-2.8, 2.8), (None, None)])
def test_a_goal_of_the_hand_is_reached_by_inverse_kinematics(bounds: tuple[float | None, float | None]) -> None:
    goal = hand_at((0.9, -0.1))
    m = arm(hand=tuple(goal), bounds=bounds)
    guess = rcp.scenes.sampled_path(m.reach)
    end = [guess[name](2.0) for name in ("q0", "q1")]
    assert np.allclose(hand_at(end), goal, atol=1e-5)
    assert distances(m, end) >= CLEARANCE - 1e-5


def test_a_body_that_flies_freely_finds_its_way_through_a_gap() -> None:
    m = turning_move(height=0.0, turn=0.0)
    long = rcp.Polytope.box(1.0, 0.2)
    walls = {"low": rcp.Polytope.box(0.1, 4, center=(2, -1.6)), "high": rcp.Polytope.box(0.1, 4, center=(2, 3.0))}
    avoiding(m, bodies={"long": rcp.Body(long, pose=placed)}, obstacles=walls)
    guess = rcp.scenes.sampled_path(m.move)
    for t in np.linspace(0.0, 1.0, 81):
        pose = rcp.planar_pose(*(guess[name](t) for name in ("x", "y", "theta")))
        assert min(rcp.scenes.signed_distance(long, wall, pose).distance for wall in walls.values()) > 0.0


def test_where_no_path_exists_the_number_of_samples_is_said() -> None:
    """A ring of walls around the arm, with the goal outside of it."""
    m = arm(box=rcp.Polytope.box(0.2, 4.0, center=(0.5, 0.0)))
    with pytest.raises(InitialGuessError, match="no clear configuration for its start"):
        rcp.scenes.sampled_path(m.reach)
    m = arm(bounds=(-1.0, 1.0))  # it would have to fold farther, or to go round behind
    with pytest.raises(InitialGuessError, match="30 random configurations of q0, q1"):
        rcp.scenes.sampled_path(m.reach, samples=30)


@pytest.mark.ipopt
@pytest.mark.parametrize(
    ("hand", "why"),
    [((0.7, 0.0), "'lower' and 'box' are too close there"), ((2.0, 0.0), "no values within their bounds")],
)
def test_a_goal_of_an_arm_that_is_never_clear_is_said_after_one_round(hand: tuple[float, float], why: str) -> None:
    result = rcp.solve(arm(hand=hand), time_limit=10)
    assert not result.solved
    assert why in str(result)
    assert len(result.rounds) == 1


def test_poses_of_quaternions_are_refused() -> None:
    m = pyo.ConcreteModel()
    m.fly = b = rcp.PhaseBlock(duration=1.0, elements=4)
    b.w, b.x = rcp.State(initial=1, final=math.sqrt(0.5)), rcp.State(initial=0, final=math.sqrt(0.5))
    b.u, b.v = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.w: b.u[t], b.x: b.v[t]})
    b.initialize_straight_lines()
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, body=rcp.Polytope.box(1, 1, 1), obstacles={"far": rcp.Polytope.box(1, 1, 1, center=(9, 0, 0))},
        pose=lambda b, t: rcp.spatial_pose((0, 0, 0), quaternion=(b.w[t], b.x[t], 0, 0)), clearance=0.1,
    )  # fmt: skip
    with pytest.raises(InitialGuessError, match="rotations at some values"):
        rcp.scenes.sampled_path(b)


def test_an_obstacle_that_moves_by_itself_is_left_out() -> None:
    m = arm()
    b = m.reach
    b.del_component("avoid")
    moving = rcp.Body(rcp.Polytope.box(0.1, 0.1), pose=lambda b, t: rcp.planar_pose(5 + t, 0))
    keep_clear(b, rcp.Polytope.box(1, 0.1), {"cart": moving}, lambda b, t: rcp.planar_pose(0, 0, b.q0[t]), 0.02)
    with pytest.raises(InitialGuessError, match="nothing that rests"):
        ConfigurationSpace(b)


@pytest.mark.ipopt
@pytest.mark.parametrize("order", [1, 2])
def test_solve_leads_an_arm_along_the_path_and_says_so(order: int, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "pyrobocop_pyomo")
    goal = hand_at((0.9, -0.1))
    m = arm(order=order, hand=tuple(goal))
    result = rcp.solve(m, progress=False)
    assert result.safe
    assert any("random configurations" in each.purpose for each in result.rounds)
    end = [m.reach.component(f"q{k}")[2.0].value for k in range(2)]
    assert np.allclose(hand_at(end), goal, atol=1e-5)
    times = sorted(m.reach.time)
    path = [[m.reach.component(f"q{k}")[t].value for k in range(2)] for t in times]
    assert all(distances(m, np.array(q) * (1 - s) + np.array(p) * s) > 0
               for q, p in pairwise(path) for s in (0.0, 0.5))  # fmt: skip
