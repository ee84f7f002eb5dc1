"""Signed distances agree with programs and methods that know nothing of ours."""

import itertools
import math

import numpy as np
import pytest
from harness.random_bodies import gap, random_body, random_pose, touching
from hypothesis import example, given, settings
from hypothesis import strategies as some
from scipy.optimize import nnls

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import (
    PointSets,
    Polytope,
    distance_of_points,
    distances_of_points,
    planar_pose,
    separating_directions,
    signed_distance,
    spatial_pose,
)


def test_a_turned_asymmetric_body_has_the_footprint_that_is_drawn() -> None:
    """A mirrored rotation passes for symmetric bodies: this one has a long nose to the left of its front."""
    body = Polytope.from_vertices([(0, 0), (2, 0), (2, 1), (1, 0.5)], name="nose")
    pose = planar_pose(1.0, 2.0, np.pi / 6)
    tip = (1 + 2 * np.cos(np.pi / 6) - np.sin(np.pi / 6), 2 + 2 * np.sin(np.pi / 6) + np.cos(np.pi / 6))
    assert signed_distance(body, Polytope.point((tip[0] + 3, tip[1] + 4)), pose).distance == pytest.approx(
        5.0, abs=1e-12
    )


def test_boxes_apart_touching_and_overlapping() -> None:
    box = Polytope.box(2, 2)
    for shift in (3.0, 2.0, 1.5):
        found = signed_distance(box, box, planar_pose(shift, 0.25))
        assert found.distance == pytest.approx(shift - 2.0, abs=1e-14)
        assert found.normal == pytest.approx([1.0, 0.0], abs=1e-14)


# --------------------------------------------------------------------
# Distances of many pairs at once are those of each pair.


def without_rays(corners: np.ndarray) -> PointSets:
    return PointSets(corners, np.zeros((len(corners), 0, corners.shape[2])))


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
    distance, normal = distances_of_points(without_rays(p), without_rays(q))
    for k in range(20):
        assert distance[k] == pytest.approx(distance_of_points(p[k], q[k]).distance, abs=1e-9)
        assert np.linalg.norm(normal[k]) == pytest.approx(1.0, abs=1e-9)
        assert gap(normal[k], p[k], q[k]) == pytest.approx(distance[k], abs=1e-9)


def test_walls_without_end() -> None:
    wall = Polytope.from_halfspaces([[0, 1]], [0], bounded=False)
    p = np.array([Polytope.box(1, 1, center=(0, height)).vertices for height in (2.0, 0.5, 0.1)])
    q, rays = np.broadcast_to(wall.vertices, (3, 1, 2)), np.broadcast_to(wall.rays, (3, 3, 2))
    distance, normal = distances_of_points(without_rays(p), PointSets(q, rays))
    assert distance == pytest.approx([1.5, 0.0, -0.4], abs=1e-12)
    assert normal == pytest.approx(np.tile([0.0, 1.0], (3, 1)), abs=1e-12)


def test_no_pairs() -> None:
    distance, normal = distances_of_points(without_rays(np.zeros((0, 4, 2))), without_rays(np.zeros((0, 3, 2))))
    assert (distance.shape, normal.shape) == ((0,), (0, 2))


# --------------------------------------------------------------------
# The ways out of an overlap: facets of the differences, none left out and none too many.


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


def test_a_wall_leaves_one_way_out() -> None:
    wall = Polytope.from_halfspaces([[0, -1]], [-3], bounded=False)
    box = Polytope.box(2, 1).placed(planar_pose(100, 4, 0.3))
    directions = separating_directions(box.vertices, wall.vertices, None, wall.rays)
    directions = [
        tuple(d.round(9) + 0.0) for d in directions if gap(d, box.vertices, wall.vertices, None, wall.rays) > -np.inf
    ]
    assert directions == [(0, -1)]


# --------------------------------------------------------------------
# Signed distances agree with programs and methods that know nothing of ours, on hundreds of pairs of poses each.


pytestmark = pytest.mark.heavy

PAIRS = 400


def pairs(dimension: int, seed: int) -> list[tuple[Polytope, Polytope]]:
    """In the world: apart, overlapping, and every fifth touching in one corner."""
    random = np.random.default_rng(seed)
    made = []
    for k in range(PAIRS):
        first, second = random_body(random, dimension), random_body(random, dimension)
        first = first.placed(random_pose(random, dimension))
        made.append(touching(random, first, second) if k % 5 == 0 else (first, second))
    return made


def nearest_by_quadratic_program(first: Polytope, second: Polytope) -> float:
    """The least of |V'a - W'b| over weights that sum to one each: non-negative least squares with heavy sums."""
    heavy = 1e7
    v, w = first.vertices.T, second.vertices.T
    sums = np.zeros((2, v.shape[1] + w.shape[1]))
    sums[0, : v.shape[1]], sums[1, v.shape[1] :] = heavy, heavy
    weights, _ = nnls(np.vstack([np.hstack([v, -w]), sums]), np.concatenate([np.zeros(len(v)), [heavy, heavy]]))
    a, b = weights[: v.shape[1]], weights[v.shape[1] :]
    return float(np.linalg.norm(v @ (a / a.sum()) - w @ (b / b.sum())))


def normals_across(edges: np.ndarray) -> np.ndarray:
    """Both unit normals of all directions that two edges span, in the plane one edge."""
    if edges.shape[1] == 2:
        normals = np.column_stack([-edges[:, 1], edges[:, 0]])
    else:
        i, j = np.triu_indices(len(edges), 1)
        normals = np.cross(edges[i], edges[j])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    return np.vstack([normals, -normals])


def depth_by_enumeration(first: Polytope, second: Polytope) -> float:
    """Largest gap over all directions that two edges (in the plane one) of all differences span: no hull, no search."""
    normals = normals_across(
        np.array([a - b for body in (first, second) for a, b in itertools.combinations(body.vertices, 2)])
    )
    gaps = (first.vertices @ normals.T).min(axis=0) - (second.vertices @ normals.T).max(axis=0)
    return float(gaps.max())


def proven_distance(first: Polytope, second: Polytope, scale: float = 1.0) -> float:
    """Points of both bodies bound the distance from above, the gap along the normal from below: they meet."""
    found = signed_distance(first, second)
    assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-12)
    proven = gap(found.normal, first.vertices, second.vertices, first.rays, second.rays)
    assert proven == pytest.approx(found.distance, abs=1e-9 * scale)
    assert found.first_point - found.second_point == pytest.approx(found.distance * found.normal, abs=1e-9 * scale)
    for body, place in ((first, found.first_point), (second, found.second_point)):
        normals, offsets = body.halfspaces
        assert (normals @ place - offsets).max() <= 1e-9 * scale
    return found.distance


@pytest.mark.parametrize("dimension", [2, 3])
def test_distances_agree_with_a_quadratic_program_and_depths_with_enumeration(dimension: int) -> None:
    overlapping = 0
    for first, second in pairs(dimension, seed=10 + dimension):
        distance = proven_distance(first, second)
        if distance > 1e-9:
            assert distance == pytest.approx(nearest_by_quadratic_program(first, second), abs=1e-9)
        else:
            overlapping += 1
            assert distance == pytest.approx(depth_by_enumeration(first, second), abs=1e-9)
    assert 0.1 * PAIRS < overlapping < 0.9 * PAIRS


# --------------------------------------------------------------------
# Distances of bodies without end, flat ones and padded ones prove themselves, and agree with enumeration.


seeds = some.integers(0, 2**32 - 1)
dimensions = some.integers(2, 3)


def edges(body: Polytope) -> list[np.ndarray]:
    return [*body.rays, *(a - b for a, b in itertools.combinations(body.vertices, 2))]


def widest_gap(first: Polytope, second: Polytope) -> float:
    """Over all directions that edges and rays of both span."""
    both = normals_across(np.array(edges(first) + edges(second)))
    return max(gap(n, first.vertices, second.vertices, first.rays, second.rays) for n in both)


def random_wedge(random: np.random.Generator, dimension: int) -> Polytope:
    """Up to as many half-spaces as dimensions: nothing they bound has an end."""
    count = random.integers(1, dimension + 1)
    return Polytope.from_halfspaces(random.normal(size=(count, dimension)), random.normal(size=count), bounded=False)


def test_rounding_keeps_nobody_apart_who_overlaps() -> None:
    """Of a body and a wedge whose corner is far away, however the corners of the body are rounded."""
    random = np.random.default_rng(214204)
    wedge = random_wedge(random, 3)
    body = random_body(random, 3).placed(random_pose(random, 3, 3.0))
    for seed in range(60):
        rounded = 1.0 + 1e-15 * np.random.default_rng(seed).integers(-3, 4, size=body.vertices.shape)
        found = signed_distance(Polytope.from_vertices(body.vertices * rounded, radius=body.radius), wedge)
        assert found.distance == pytest.approx(-2.6257766437, abs=1e-8)


@given(seed=seeds, dimension=dimensions, turned_around=some.booleans())
@example(seed=214204, dimension=3, turned_around=False)  # two planes that meet far away
def test_bodies_without_end(seed: int, dimension: int, turned_around: bool) -> None:
    random = np.random.default_rng(seed)
    wedge = random_wedge(random, dimension)
    body = random_body(random, dimension).placed(random_pose(random, dimension, 3.0))
    first, second = (wedge, body) if turned_around else (body, wedge)
    scale = max(1.0, float(np.abs(wedge.vertices).max()))  # corners of flat angles are far away
    distance = proven_distance(first, second, scale)
    if distance <= 0.0:
        assert distance == pytest.approx(widest_gap(first, second), abs=1e-9 * scale)


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


@given(seed=seeds, dimension=dimensions, size=some.sampled_from([1e-6, 1e-3, 1e3, 1e6]))
def test_units_of_length_do_not_matter(seed: int, dimension: int, size: float) -> None:
    random = np.random.default_rng(seed)
    p, q = random.normal(size=(5, dimension)) + random.normal(size=dimension), random.normal(size=(6, dimension))
    here, there = distance_of_points(p, q), distance_of_points(size * p, size * q)
    assert there.distance == pytest.approx(size * here.distance, abs=1e-9 * size)


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


# --------------------------------------------------------------------
# Cylinders and cones lie within their polytopes, whose corners are at most the excess away.


lengths = some.floats(0.05, 20.0)
directions = some.tuples(*[some.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1)


def inside(shape: Polytope, points: np.ndarray) -> bool:
    normals, offsets = shape.halfspaces
    size = 1.0 + np.abs(shape.vertices).max()
    return bool((points @ normals.T <= offsets + 1e-9 * size).all())


@settings(max_examples=30)
@given(radius=lengths, height=lengths, axis=directions, sides=some.integers(3, 24), seed=some.integers(0, 999))
def test_a_cylinder_in_any_direction(radius: float, height: float, axis: tuple, sides: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    center = random.normal(size=3)
    shape = Polytope.cylinder(radius, height, center, axis, sides=sides)
    unit = np.array(axis) / np.linalg.norm(axis)
    around = np.cross(random.normal(size=(200, 3)), unit)
    around *= radius / np.linalg.norm(around, axis=1)[:, None]
    surface = center + around + random.uniform(-0.5, 0.5, (200, 1)) * height * unit
    assert inside(shape, surface)
    offset = shape.vertices - center
    along = offset @ unit
    beyond = np.hypot(
        np.maximum(np.linalg.norm(offset - along[:, None] * unit, axis=1) - radius, 0.0),
        np.maximum(np.abs(along) - height / 2, 0.0),
    )
    assert beyond.max() == pytest.approx(shape.excess, abs=1e-9 * (radius + height))
    assert shape.excess == pytest.approx(radius * (1 / math.cos(math.pi / sides) - 1), rel=1e-6)


def test_a_cone_has_its_tip_and_its_circle() -> None:
    cone = Polytope.cone(1.0, 2.0, (0, 0, 1), (1, 0, 0), sides=8)
    assert np.abs(cone.vertices - [2.0, 0.0, 1.0]).max(axis=1).min() < 1e-12
    assert len(cone.vertices) == 9
    angles = np.linspace(0, 2 * math.pi, 50)
    assert inside(cone, np.column_stack([0 * angles, np.cos(angles), 1 + np.sin(angles)]))


def test_the_excess_stays_with_a_shape_that_is_padded_named_or_placed() -> None:
    shape = Polytope.cylinder(1.0, 1.0)
    again = shape.padded(0.1).named("tin").placed(spatial_pose((1, 2, 3), euler=(0.1, 0.2, 0.3)))
    assert again.excess == shape.excess > 0.0
    assert Polytope.box(1, 1).excess == 0.0
    assert Polytope.capsule((0, 0), (1, 0), 0.1).excess == 0.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Polytope.cylinder(0.0, 1.0),
        lambda: Polytope.cylinder(1.0, 1.0, sides=2),
        lambda: Polytope.cylinder(1.0, 1.0, axis=(0, 0, 0)),
        lambda: Polytope.ellipsoid((1.0,)),
        lambda: Polytope.ellipsoid((1.0, 1.0), center=(0, 0, 0)),
    ],
)
def test_lengths_that_are_none_are_refused(make) -> None:
    with pytest.raises(ObstacleError, match="'(cylinder|cone|ellipsoid)'"):
        make()
