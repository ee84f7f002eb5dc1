"""What every convex shape answers, against points of its surface: heights, boxes, and distances."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from pyrobocop_pyomo.geometry import Polytope, Pose, planar_pose, signed_distance, spatial_pose

Maker = Callable[[np.random.Generator], Polytope]
PLANAR: dict[str, Maker] = {
    "polygon": lambda random: Polytope.hull(random.normal(size=(6, 2))),
    "rounded": lambda random: Polytope.hull(random.normal(size=(4, 2)), radius=random.uniform(0.1, 1.0)),
    "disc": lambda random: Polytope.ball(random.uniform(0.1, 2.0), random.normal(size=2)),
    "capsule": lambda random: Polytope.capsule(random.normal(size=2), random.normal(size=2), 0.3),
    "ellipse": lambda random: Polytope.ellipsoid(random.uniform(0.05, 3.0, 2), random.normal(size=2)),
    "padded ellipse": lambda random: Polytope.ellipsoid(random.uniform(0.05, 3.0, 2)).padded(0.4),
}
SPATIAL: dict[str, Maker] = {
    "polytope": lambda random: Polytope.hull(random.normal(size=(8, 3))),
    "ball": lambda random: Polytope.ball(random.uniform(0.1, 2.0), random.normal(size=3)),
    "ellipsoid": lambda random: Polytope.ellipsoid(random.uniform(0.05, 3.0, 3), random.normal(size=3)),
    "padded ellipsoid": lambda random: Polytope.ellipsoid(random.uniform(0.05, 3.0, 3)).padded(0.2),
    "swept ellipsoid": lambda random: Polytope.ellipsoid(random.uniform(0.05, 3.0, 3)).swept(
        [(np.eye(3), place) for place in random.normal(size=(2, 3))]
    ),
}
SHAPES = {**PLANAR, **SPATIAL}


def directions(random: np.random.Generator, dimension: int, count: int) -> np.ndarray:
    found = random.normal(size=(count, dimension))
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def pose_of(random: np.random.Generator, dimension: int) -> Pose:
    place = 2.0 * random.normal(size=dimension)
    if dimension == 2:
        return planar_pose(*place, random.uniform(0.0, 7.0))
    return spatial_pose(place, euler=random.uniform(0.0, 7.0, 3))


def surface(shape: Polytope, random: np.random.Generator) -> np.ndarray:
    """Points of the shape, made from its definition: a corner, a point of its ellipsoid, and one of the padding."""
    count = 4000
    corner = random.integers(len(shape.vertices), size=count)
    points = shape.vertices[corner] + shape.radius * directions(random, shape.dimension, count)
    if shape.ellipsoids is not None:
        unit = directions(random, shape.dimension, count)
        points = points + np.einsum("kdc,kc->kd", shape.ellipsoids[corner], unit)
    return np.asarray(points)


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=15)
@given(seed=some.integers(0, 2**32 - 1))
def test_heights_are_those_of_the_surface(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = SHAPES[name](random)
    shape = shape.placed(pose_of(random, shape.dimension))
    points, normals = surface(shape, random), directions(random, shape.dimension, 20)
    sampled = (points @ normals.T).max(axis=0)
    highest = shape.highest(normals)
    size = float(np.ptp(points, axis=0).max())
    assert (sampled <= highest + 1e-12 * (1.0 + size)).all()
    assert (sampled >= highest - 0.12 * size).all()
    assert shape.lowest(normals) == pytest.approx(-shape.highest(-normals))
    low, high = shape.bounding_box
    assert ((points >= low - 1e-9) & (points <= high + 1e-9)).all()
    assert np.linalg.norm(points, axis=1).max() <= shape.reach + 1e-9
    around = shape.covered
    assert (around.highest(normals) >= highest - 1e-9).all()
    assert (around.highest(normals) <= highest + around.excess + 1e-9).all()


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=8)
@given(seed=some.integers(0, 2**32 - 1))
def test_the_signed_distance_is_the_largest_gap(name: str, seed: int) -> None:
    """Among other shapes, apart and overlapping: no normal has a larger gap, and its own has that distance."""
    random = np.random.default_rng(seed)
    shape = SHAPES[name](random)
    family = PLANAR if shape.dimension == 2 else SPATIAL
    for other in (make(random) for make in family.values()):
        first, second = (each.placed(pose_of(random, shape.dimension)) for each in (shape, other))
        found = signed_distance(first, second)
        normals = directions(random, shape.dimension, 3000)
        gaps = first.lowest(normals) - second.highest(normals)
        size = first.reach + second.reach
        own = float(first.lowest(found.normal[None])[0] - second.highest(found.normal[None])[0])
        assert own == pytest.approx(found.distance, abs=1e-6 * size)
        exact = 1e-6 if found.distance > 0.0 else 2e-3  # depths of ellipsoids are found to a thousandth
        assert gaps.max() <= found.distance + exact * size
        assert found.first_point - found.second_point == pytest.approx(found.distance * found.normal, abs=1e-6 * size)
        for of, point in ((first, found.first_point), (second, found.second_point)):
            # Places are less exact than distances.
            assert found.distance <= 0.0 or (normals @ point <= of.highest(normals) + 1e-4 * size).all()
