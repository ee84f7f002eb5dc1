"""Cylinders, cones and ellipsoids lie within their polytopes, whose corners are at most the excess away."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, spatial_pose

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


@settings(max_examples=12)
@given(semi_axes=some.lists(lengths, min_size=2, max_size=3), seed=some.integers(0, 999))
def test_ellipses_and_ellipsoids(semi_axes: list[float], seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = Polytope.ellipsoid(semi_axes)
    unit = random.normal(size=(300, len(semi_axes)))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    assert inside(shape, unit * semi_axes)
    # The point of the ellipsoid below a corner is no farther than the excess.
    below = shape.vertices / np.linalg.norm(shape.vertices / semi_axes, axis=1)[:, None]
    assert np.linalg.norm(shape.vertices - below, axis=1).max() <= shape.excess * (1 + 1e-9)
    finer = Polytope.ellipsoid(semi_axes, sides=32)
    assert finer.excess < shape.excess
    assert inside(finer, unit * semi_axes)


def test_a_cone_has_its_tip_and_a_frustum_both_circles() -> None:
    cone = Polytope.cone(1.0, 2.0, (0, 0, 1), (1, 0, 0), sides=8)
    assert np.abs(cone.vertices - [2.0, 0.0, 1.0]).max(axis=1).min() < 1e-12
    assert len(cone.vertices) == 9
    angles = np.linspace(0, 2 * math.pi, 50)
    assert inside(cone, np.column_stack([0 * angles, np.cos(angles), 1 + np.sin(angles)]))
    frustum = Polytope.cone(1.0, 2.0, top_radius=3.0)
    assert inside(frustum, np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), 2 + 0 * angles]))
    assert frustum.excess == pytest.approx(3.0 * (1 / math.cos(math.pi / 16) - 1))


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
        lambda: Polytope.cylinder(1.0, math.inf),
        lambda: Polytope.cylinder(1.0, 1.0, sides=2),
        lambda: Polytope.cylinder(1.0, 1.0, axis=(0, 0, 0)),
        lambda: Polytope.cone(1.0, 1.0, top_radius=-1.0),
        lambda: Polytope.ellipsoid((1.0,)),
        lambda: Polytope.ellipsoid((1.0, -1.0)),
        lambda: Polytope.ellipsoid((1.0, 1.0), center=(0, 0, 0)),
    ],
)
def test_lengths_that_are_none_are_refused(make) -> None:
    with pytest.raises(ObstacleError, match="'(cylinder|cone|ellipsoid)'"):
        make()
