"""Parts are convex, fill the shape exactly, and overlap in nothing but their boundaries."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scipy.spatial import ConvexHull

from pyrobocop_pyomo.contrib.robots import decompose
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, signed_distance

shapely = pytest.importorskip("shapely")

ANGLE = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
FRAME = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (1, 3), (3, 3), (3, 1)]])


def prism(polygon: Any, height: float) -> SimpleNamespace:
    """Mesh of an outline pulled up, its triangles' normals outwards."""
    places: dict[tuple[float, ...], int] = {}
    faces = []

    def row(*place: float) -> int:
        return places.setdefault(place, len(places))

    for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)):
        around = shapely.get_coordinates(shapely.geometry.polygon.orient(triangle))[:3]
        faces += [[row(x, y, height) for x, y in around], [row(x, y, 0.0) for x, y in around[::-1]]]
    oriented = shapely.geometry.polygon.orient(polygon)
    for ring in (oriented.exterior, *oriented.interiors):
        for (a, b), (c, d) in itertools.pairwise(shapely.get_coordinates(ring)):
            faces += [
                [row(a, b, 0.0), row(c, d, 0.0), row(c, d, height)],
                [row(a, b, 0.0), row(c, d, height), row(a, b, height)],
            ]
    return SimpleNamespace(vertices=np.array(list(places)), faces=np.array(faces))


def overlap_in_nothing(parts: list[Polytope]) -> bool:
    return all(signed_distance(a, b).distance > -1e-9 for a, b in itertools.combinations(parts, 2))


@given(seed=some.integers(0, 2**32 - 1), corners=some.integers(3, 20))
def test_random_outlines(seed: int, corners: int) -> None:
    random = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(corners) + random.uniform(0.0, 0.4, corners)) / corners
    outline = random.uniform(0.3, 2.0, corners)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    polygon = shapely.Polygon(outline)
    parts = decompose(outline)
    shapes = [shapely.Polygon(part.vertices) for part in parts]
    assert sum(shape.area for shape in shapes) == pytest.approx(polygon.area, rel=1e-9)
    assert shapely.union_all(shapes).symmetric_difference(polygon).area < 1e-9
    assert overlap_in_nothing(parts)
    assert len(parts) <= corners - 2


@pytest.mark.parametrize(
    ("shape", "number", "area"),
    [
        (ANGLE, 2, 7),
        (ANGLE[::-1], 2, 7),
        (FRAME, 4, 12),
        ([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], 1, 1),
        (shapely.MultiPolygon([FRAME, shapely.box(5, 0, 6, 1)]), 5, 13),
    ],
)
def test_known_outlines(shape: Any, number: int, area: float) -> None:
    parts = decompose(shape, name="wall")
    assert len(parts) == number
    assert sum(ConvexHull(part.vertices).volume for part in parts) == pytest.approx(area)
    assert [part.name for part in parts] == (["wall"] if number == 1 else [f"wall[{k + 1}]" for k in range(number)])


@pytest.mark.parametrize(("outline", "number"), [(shapely.Polygon(ANGLE), 2), (FRAME, 4)])
def test_meshes(outline: Any, number: int) -> None:
    parts = decompose(prism(outline, 2.0), name="bracket")
    assert len(parts) == number
    assert sum(ConvexHull(part.vertices).volume for part in parts) == pytest.approx(2.0 * outline.area)
    assert overlap_in_nothing(parts)
    free = Polytope.point((2, 2, 1))
    assert min(signed_distance(free, part).distance for part in parts) == pytest.approx(1.0)


def test_a_mesh_of_trimesh() -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=1)
    (part,) = decompose(ball, name="ball")
    assert len(part.vertices) == len(ball.vertices)
    assert ConvexHull(part.vertices).volume == pytest.approx(ball.volume)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], r"'wall': the outline is none: Self-intersection"),
        ([(0, 0), (1, 1)], r"'wall': an outline is a list of three or more points"),
        (np.zeros((5, 3)), r"'wall': an outline .* in the plane"),
        (shapely.Point(0, 0), r"'wall': cannot cut a Point"),
        (shapely.Polygon(), r"'wall': cannot cut a Polygon into parts; give a polygon that is not empty"),
        (
            SimpleNamespace(vertices=np.eye(4)[:, :3], faces=[[0, 1, 2], [0, 2, 3], [0, 3, 1]]),
            r"'wall': the mesh is not closed: 3 of the sides",
        ),
    ],
)
def test_shapes_that_cannot_be_cut(shape: Any, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        decompose(shape, name="wall")


@pytest.mark.heavy
def test_a_finely_curved_mesh_is_refused() -> None:
    trimesh = pytest.importorskip("trimesh")
    ring = trimesh.creation.torus(major_radius=1.0, minor_radius=0.3, major_sections=24, minor_sections=12)
    with pytest.raises(ObstacleError, match=r"'ring': the mesh of 576 triangles needs more than 200 convex cells"):
        decompose(ring, name="ring")
