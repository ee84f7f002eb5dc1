"""Distances of bodies without end, flat ones and padded ones prove themselves, and agree with enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from harness.random_bodies import gap, random_body, random_pose
from hypothesis import given
from hypothesis import strategies as some

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, distance_of_points, planar_pose, signed_distance, spatial_pose

seeds = some.integers(0, 2**32 - 1)
dimensions = some.integers(2, 3)


def edges(body: Polytope) -> list[np.ndarray]:
    return [*body.rays, *(a - b for a, b in itertools.combinations(body.vertices, 2))]


def widest_gap(first: Polytope, second: Polytope) -> float:
    """Over all directions that edges and rays of both span."""
    along = np.array(edges(first) + edges(second))
    if first.dimension == 2:
        normals = np.column_stack([-along[:, 1], along[:, 0]])
    else:
        i, j = np.triu_indices(len(along), 1)
        normals = np.cross(along[i], along[j])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    both = np.vstack([normals, -normals])
    return max(gap(n, first.vertices, second.vertices, first.rays, second.rays) for n in both)


def random_wedge(random: np.random.Generator, dimension: int) -> Polytope:
    """Up to as many half-spaces as dimensions: nothing they bound has an end."""
    count = random.integers(1, dimension + 1)
    return Polytope.from_halfspaces(random.normal(size=(count, dimension)), random.normal(size=count), bounded=False)


@given(seed=seeds, dimension=dimensions, turned_around=some.booleans())
def test_bodies_without_end(seed: int, dimension: int, turned_around: bool) -> None:
    random = np.random.default_rng(seed)
    wedge = random_wedge(random, dimension)
    body = random_body(random, dimension).placed(random_pose(random, dimension, 3.0))
    first, second = (wedge, body) if turned_around else (body, wedge)
    found = signed_distance(first, second)
    scale = max(1.0, float(np.abs(wedge.vertices).max()))  # corners of flat angles are far away
    proven = gap(found.normal, first.vertices, second.vertices, first.rays, second.rays)
    assert proven == pytest.approx(found.distance, abs=1e-9 * scale)
    assert found.first_point - found.second_point == pytest.approx(found.distance * found.normal, abs=1e-9 * scale)
    for one, place in ((first, found.first_point), (second, found.second_point)):
        normals, offsets = one.halfspaces
        assert (normals @ place - offsets).max() <= 1e-9 * scale
    if found.distance <= 0.0:
        assert found.distance == pytest.approx(widest_gap(first, second), abs=1e-9 * scale)


@given(seed=seeds, dimension=dimensions, corners=some.tuples(some.integers(1, 3), some.integers(1, 3)))
def test_flat_bodies_on_a_coarse_grid(seed: int, dimension: int, corners: tuple[int, int]) -> None:
    """Points, segments and triangles that touch, cross, or lie in one plane, more often than not."""
    random = np.random.default_rng(seed)
    p, q = (random.integers(-2, 3, size=(count, dimension)).astype(float) for count in corners)
    found = distance_of_points(p, q)
    assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-12)
    assert gap(found.normal, p, q) == pytest.approx(found.distance, abs=1e-9)
    assert found.first_point - found.second_point == pytest.approx(found.distance * found.normal, abs=1e-9)
    swapped = distance_of_points(q, p)
    assert swapped.distance == pytest.approx(found.distance, abs=1e-12)


@given(seed=seeds, dimension=dimensions, radii=some.tuples(some.floats(0, 2), some.floats(0, 2)))
def test_padding_takes_its_radius_off_the_distance(seed: int, dimension: int, radii: tuple[float, float]) -> None:
    random = np.random.default_rng(seed)
    first, second = random_body(random, dimension), random_body(random, dimension)
    pose = random_pose(random, dimension, 3.0)
    sharp, padded = (
        signed_distance(first, second, pose),
        signed_distance(first.padded(radii[0]), second.padded(radii[1]), pose),
    )
    assert padded.distance == pytest.approx(sharp.distance - sum(radii), abs=1e-12)
    assert padded.normal == pytest.approx(sharp.normal)
    assert padded.first_point - padded.second_point == pytest.approx(padded.distance * padded.normal, abs=1e-9)


@given(seed=seeds, dimension=dimensions)
def test_moving_both_together_changes_nothing(seed: int, dimension: int) -> None:
    random = np.random.default_rng(seed)
    first, second = random_body(random, dimension), random_body(random, dimension)
    one, other, common = (random_pose(random, dimension) for _ in range(3))
    here, there = (
        signed_distance(first, second, one, other),
        signed_distance(first, second, common @ one, common @ other),
    )
    assert there.distance == pytest.approx(here.distance, abs=1e-9)
    assert signed_distance(second, first, other, one).distance == pytest.approx(here.distance, abs=1e-9)


@given(seed=seeds, dimension=dimensions, size=some.sampled_from([1e-6, 1e-3, 1e3, 1e6]))
def test_units_of_length_do_not_matter(seed: int, dimension: int, size: float) -> None:
    random = np.random.default_rng(seed)
    p, q = random.normal(size=(5, dimension)) + random.normal(size=dimension), random.normal(size=(6, dimension))
    here, there = distance_of_points(p, q), distance_of_points(size * p, size * q)
    assert there.distance == pytest.approx(size * here.distance, abs=1e-9 * size)


def test_answers_are_the_same_each_time() -> None:
    box, pose = Polytope.box(1, 1, 1), spatial_pose((0.2, 0.2, 0.2))
    found = [signed_distance(box, box, pose) for _ in range(3)]
    assert len({(one.distance, *one.normal, *one.first_point) for one in found}) == 1


def test_bodies_that_have_no_distance_are_named() -> None:
    floor = Polytope.from_halfspaces([[0, 1]], [0], bounded=False, name="floor")
    wall = Polytope.from_halfspaces([[1, 0]], [0], bounded=False, name="wall")
    with pytest.raises(ObstacleError, match=r"'floor' and 'wall' overlap without end"):
        signed_distance(floor, wall)
    with pytest.raises(ObstacleError, match=r"'floor' has 2 dimensions and 'box' 3"):
        signed_distance(floor, Polytope.box(1, 1, 1))
    with pytest.raises(ObstacleError, match=r"'floor' has 2 dimensions and its pose 3"):
        signed_distance(floor, wall, spatial_pose((0, 0, 0)))


def test_two_walls_that_face_each_other() -> None:
    left = Polytope.from_halfspaces([[1, 0]], [0], bounded=False)
    right = Polytope.from_halfspaces([[-1, 0]], [-3], bounded=False)
    for shift, expected in ((0.0, 3.0), (4.0, -1.0)):
        found = signed_distance(right, left, None, planar_pose(shift, 7.0))
        assert found.distance == pytest.approx(expected, abs=1e-12)
        assert found.normal == pytest.approx([1.0, 0.0], abs=1e-12)
