"""Distances of many pairs at once are those of each pair."""

from __future__ import annotations

import numpy as np
import pytest
from harness.random_bodies import gap
from hypothesis import given
from hypothesis import strategies as some

from pyrobocop_pyomo.geometry import Polytope, distance_of_points, distances_of_points


@given(
    seed=some.integers(0, 2**32 - 1),
    dimension=some.integers(2, 3),
    corners=some.tuples(some.integers(1, 9), some.integers(1, 9)),
    rounded=some.booleans(),
)
def test_many_at_once_are_each_alone(seed: int, dimension: int, corners: tuple[int, int], rounded: bool) -> None:
    """Points on a coarse grid touch, and are flat, often."""
    random = np.random.default_rng(seed)
    p = 2.0 * random.normal(size=(20, corners[0], dimension)) + 4.0 * random.normal(size=(20, 1, dimension))
    q = 2.0 * random.normal(size=(20, corners[1], dimension))
    if rounded:
        p, q = p.round(), q.round()
    distance, normal = distances_of_points(p, q)
    for k in range(20):
        assert distance[k] == pytest.approx(distance_of_points(p[k], q[k]).distance, abs=1e-9)
        assert np.linalg.norm(normal[k]) == pytest.approx(1.0, abs=1e-9)
        assert gap(normal[k], p[k], q[k]) == pytest.approx(distance[k], abs=1e-9)


def test_walls_without_end() -> None:
    wall = Polytope.from_halfspaces([[0, 1]], [0], bounded=False)
    p = np.array([Polytope.box(1, 1, center=(0, height)).vertices for height in (2.0, 0.5, 0.1)])
    q, rays = np.broadcast_to(wall.vertices, (3, 1, 2)), np.broadcast_to(wall.rays, (3, 3, 2))
    distance, normal = distances_of_points(p, q, None, rays)
    assert distance == pytest.approx([1.5, 0.0, -0.4], abs=1e-12)
    assert normal == pytest.approx(np.tile([0.0, 1.0], (3, 1)), abs=1e-12)


def test_no_pairs() -> None:
    distance, normal = distances_of_points(np.zeros((0, 4, 2)), np.zeros((0, 3, 2)))
    assert (distance.shape, normal.shape) == ((0,), (0, 2))
