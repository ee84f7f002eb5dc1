"""The ways out of an overlap: facets of the differences, none left out and none too many."""

from __future__ import annotations

import numpy as np
import pytest
from harness.random_bodies import gap, random_body, random_pose
from hypothesis import given
from hypothesis import strategies as some

from pyrobocop_pyomo.geometry import Polytope, planar_pose, separating_directions, signed_distance


@given(seed=some.integers(0, 2**32 - 1), dimension=some.integers(2, 3))
def test_the_widest_gap_among_them_is_the_depth(seed: int, dimension: int) -> None:
    random = np.random.default_rng(seed)
    first = random_body(random, dimension).placed(random_pose(random, dimension, spread=0.5))
    second = random_body(random, dimension)
    directions = separating_directions(first.vertices, second.vertices)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    widest = max(gap(direction, first.vertices, second.vertices) for direction in directions)
    distance = signed_distance(first, second).distance
    if distance <= 0.0:
        assert widest == pytest.approx(distance, abs=1e-9)
    else:  # apart, no direction has a gap wider than the distance, and one has a gap
        assert 0.0 <= widest <= distance + 1e-12


@given(seed=some.integers(0, 2**32 - 1))
def test_moving_out_along_any_of_them_separates(seed: int) -> None:
    random = np.random.default_rng(seed)
    first = random_body(random, 3).placed(random_pose(random, 3, spread=0.5))
    second = random_body(random, 3)
    for direction in separating_directions(first.vertices, second.vertices)[:5]:
        depth = -gap(direction, first.vertices, second.vertices)
        moved = Polytope(first.vertices + depth * direction, first.rays)
        assert signed_distance(moved, second).distance >= -1e-9


def test_two_boxes_that_are_not_turned_have_four_ways_out() -> None:
    box = Polytope.box(2, 1)
    directions = separating_directions(box.vertices, box.vertices + 0.3)
    assert sorted(map(tuple, directions.round(9) + 0.0)) == [(-1, 0), (0, -1), (0, 1), (1, 0)]


def test_crossing_segments_leave_across_the_plane_that_holds_them() -> None:
    along_x, along_y = np.array([[-1.0, 0, 0], [1, 0, 0]]), np.array([[0.0, -1, 0], [0, 1, 0]])
    directions = separating_directions(along_x, along_y)
    assert sorted(map(tuple, directions.round(9) + 0.0)) == [(0, 0, -1), (0, 0, 1)]


def test_a_wall_leaves_one_way_out() -> None:
    wall = Polytope.from_halfspaces([[0, -1]], [-3], bounded=False)
    box = Polytope.box(2, 1).placed(planar_pose(100, 4, 0.3))
    directions = separating_directions(box.vertices, wall.vertices, None, wall.rays)
    directions = [
        tuple(d.round(9) + 0.0) for d in directions if gap(d, box.vertices, wall.vertices, None, wall.rays) > -np.inf
    ]
    assert directions == [(0, -1)]
