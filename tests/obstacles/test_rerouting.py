"""Grid paths around all obstacles step through no wall, however thin, and reroute guesses where poses allow it."""

from itertools import pairwise

import numpy as np
import pyomo.environ as pyo
from harness.scenes import through_a_wall, wall_with_opening
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles.rerouting import (
    InnerAndOuterBall,
    distance_lower_bounds,
    path_among_obstacles,
    reroute,
)

CLEARANCE = 0.05
BODY = rcp.Polytope.box(0.4, 0.2)


def region(*corners: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array(corners[:2]), np.array(corners[2:])


@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]), radius=st.floats(0, 0.5))
@settings(max_examples=60, deadline=None)
def test_lower_bounds_of_distances_are_never_more_than_the_true_ones(seed: int, dimension: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    shapes = [
        rcp.Polytope.hull(rng.normal(size=(7, dimension)) + rng.normal(size=dimension), radius=radius) for _ in range(2)
    ]
    points = 3.0 * rng.normal(size=(8, dimension))
    bounds = distance_lower_bounds(points, shapes)
    for point, bound in zip(points, bounds, strict=True):
        true = min(rcp.scenes.signed_distance(rcp.Polytope.point(point), shape).distance for shape in shapes)
        assert bound <= true + 1e-9


@given(gap=st.floats(-1.5, 1.5), width=st.floats(0.7, 1.5), thickness=st.floats(1e-3, 0.5), goal=st.floats(-1.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_path_passes_a_thin_wall_through_its_opening(gap: float, width: float, thickness: float, goal: float) -> None:
    balls, walls = InnerAndOuterBall.of(BODY), wall_with_opening(gap, width, thickness)
    ends = np.array([-2.0, 0.0]), np.array([2.0, goal])
    path = path_among_obstacles(*ends, balls, walls, CLEARANCE, *region(-3, -3, 3, 3))
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [[-2.0, 0.0], [2.0, goal]])
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(path)])
    clear = [rcp.scenes.signed_distance(rcp.Polytope.point(point), box).distance for point in dense for box in walls]
    assert min(clear) > 0.0


def test_a_path_prefers_an_opening_with_room_to_one_that_barely_fits() -> None:
    # The tight opening is straight ahead, the wide one a little aside.
    walls = [
        rcp.Polytope.box(0.2, 10.0, center=(0, 5.16)),
        rcp.Polytope.box(0.2, 0.3, center=(0, -0.31)),
        rcp.Polytope.box(0.2, 10.0, center=(0, -6.7)),
    ]
    ends = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
    path = path_among_obstacles(*ends, InnerAndOuterBall.of(BODY), walls, CLEARANCE, *region(-3, -3, 3, 3))
    at_wall = path[np.abs(path[:, 0]).argmin()]
    assert -1.7 < at_wall[1] < -0.46


def test_a_guess_is_rerouted_through_the_opening_and_turns_as_before() -> None:
    m = through_a_wall()
    b = m.move
    turned = [b.theta[t].value for t in b.time]
    assert reroute(b.avoid) == ["body"]
    at_wall = [b.y[t].value for t in b.time if abs(b.x[t].value) < 0.3]
    assert at_wall
    assert 0.8 < min(at_wall) <= max(at_wall) < 1.6
    assert [b.theta[t].value for t in b.time] == turned
    first, last = b.time.first(), b.time.last()
    assert (b.x[first].value, b.y[first].value, b.x[last].value, b.y[last].value) == (-2, 0, 2, 0.3)


def test_a_rerouted_guess_keeps_the_bounds_of_its_variables() -> None:
    m = through_a_wall(bounds=(-2, 2))
    reroute(m.move.avoid)
    for t in m.move.time:
        assert -2 <= m.move.x[t].value <= 2
        assert -2 <= m.move.y[t].value <= 2


def test_poses_that_are_computed_from_variables_are_left_alone() -> None:
    m = through_a_wall(lambda b, t: rcp.planar_pose(b.x[t] + 0.1 * pyo.cos(b.theta[t]), b.y[t], b.theta[t]))
    before = [m.move.y[t].value for t in m.move.time]
    assert reroute(m.move.avoid) == []
    assert [m.move.y[t].value for t in m.move.time] == before


def test_a_guess_that_leads_nowhere_is_left_alone() -> None:
    m = through_a_wall(bounds=(-2.1, 2.1), at=8.0)
    before = [m.move.y[t].value for t in m.move.time]
    assert reroute(m.move.avoid) == []
    assert [m.move.y[t].value for t in m.move.time] == before
