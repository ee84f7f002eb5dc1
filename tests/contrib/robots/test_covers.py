"""Occupied cells and points lie within the shapes of their cover, which reach no farther than the tolerance."""

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.spatial import ConvexHull

from pyrobocop_pyomo.contrib.robots import cover_occupancy_grid, cover_point_cloud, decompose
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, signed_distance

seeds = some.integers(0, 2**32 - 1)


def polygons(parts: list[Polytope]) -> Any:
    return shapely.union_all([shapely.Polygon(part.vertices) for part in parts])


def cells(mask: np.ndarray, resolution: float, origin: Any = (0.0, 0.0)) -> Any:
    """The occupied cells of a grid whose first row is at the bottom."""
    boxes = [shapely.box(column, row, column + 1, row + 1) for row, column in np.argwhere(mask)]
    x, y, *yaw = origin
    union = shapely.affinity.scale(shapely.union_all(boxes), resolution, resolution, origin=(0, 0))
    turned = shapely.affinity.rotate(union, math.degrees(yaw[0] if yaw else 0.0), origin=(0, 0))
    return shapely.affinity.translate(turned, x, y)


@settings(max_examples=12)
@given(seed=seeds, share=some.floats(0.02, 0.6), cells_of_tolerance=some.sampled_from([0.0, 1.0, 2.5]))
def test_random_grids(seed: int, share: float, cells_of_tolerance: float) -> None:
    random = np.random.default_rng(seed)
    mask = random.random((12, 17)) < share
    origin = (*random.normal(size=2), random.uniform(-3, 3))
    parts = cover_occupancy_grid(mask, 0.1, origin, tolerance=0.1 * cells_of_tolerance)
    assert bool(parts) == bool(mask.any())
    if not parts:
        return
    occupied, covered = cells(mask, 0.1, origin), polygons(parts)
    assert occupied.difference(covered.buffer(1e-9)).area < 1e-12
    if cells_of_tolerance == 0.0:
        assert covered.area == pytest.approx(occupied.area, rel=1e-9)
    for part in parts:
        assert part.excess <= 0.1 * cells_of_tolerance + 1e-12
        assert shapely.Polygon(part.vertices).difference(occupied.buffer(part.excess + 1e-9, quad_segs=64)).area < 1e-6


def test_walls_of_stairs_become_few_straight_ones() -> None:
    mask = np.zeros((60, 60), dtype=bool)
    for k in range(50):
        mask[5 + k // 2 : 8 + k // 2, 5 + k] = True
    assert len(cover_occupancy_grid(mask, 0.05, tolerance=0.0)) > 20
    assert len(cover_occupancy_grid(mask, 0.05)) <= 2


def test_conventions_of_ros_and_of_images() -> None:
    ros = np.zeros((4, 6), dtype=np.int8)
    ros[0, 5], ros[3, 0], ros[2, 2] = 100, 50, -1
    unknown, lower_right = cover_occupancy_grid(ros, 1.0, (10.0, 20.0))
    assert lower_right.vertices.min(axis=0).tolist() == [15.0, 20.0]
    assert unknown.vertices.min(axis=0).tolist() == [12.0, 22.0]
    (known,) = cover_occupancy_grid(ros, 1.0, unknown="free")
    assert known.vertices.max(axis=0).tolist() == [6.0, 1.0]
    assert len(cover_occupancy_grid((ros >= 50) | (ros < 0), 1.0, tolerance=0.0)) == 3
    picture = np.full((4, 6), 254)
    picture[0, 5] = 0
    (dark,) = cover_occupancy_grid(picture[::-1] < 128, 1.0)
    assert dark.vertices.max(axis=0).tolist() == [6.0, 4.0]
    assert cover_occupancy_grid(np.zeros((3, 3)), 1.0) == []


@settings(max_examples=10)
@given(seed=seeds)
def test_grids_in_space_are_filled_by_boxes(seed: int) -> None:
    random = np.random.default_rng(seed)
    mask = random.random((5, 6, 4)) < 0.3
    parts = cover_occupancy_grid(mask, 0.5, (1.0, 2.0, 3.0))
    filled = np.zeros(mask.shape, dtype=bool)
    for part in parts:
        low = ((part.vertices.min(axis=0) - [1.0, 2.0, 3.0]) / 0.5).round().astype(int)
        high = ((part.vertices.max(axis=0) - [1.0, 2.0, 3.0]) / 0.5).round().astype(int)
        filled[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
        assert part.excess == 0.0
    assert np.array_equal(filled, mask)


@pytest.mark.parametrize(
    ("grid", "options", "message"),
    [
        (np.full((3, 3), 254), {}, r"picture\[::-1\] < 128"),
        (np.full((3, 3), 3.5), {}, "grid >= least"),
        (np.eye(3), {}, "expected booleans"),
        (np.zeros(9), {}, "Reshape"),
        (np.ones((2, 2), dtype=bool), {"resolution": 0.0}, "resolution"),
        (np.ones((2, 2), dtype=bool), {"origin": (1, 2, 3, 4)}, r"\(x, y, yaw\)"),
        (np.ones((2, 2), dtype=bool), {"unknown": "maybe"}, "unknown"),
        (np.ones((2, 2), dtype=bool), {"tolerance": -1.0}, "tolerance"),
    ],
)
def test_what_is_no_occupancy_is_refused(grid: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        cover_occupancy_grid(grid, **{"resolution": 1.0, **options})


def farthest_outside(parts: list[Polytope], points: np.ndarray) -> float:
    """Largest distance of a point from the nearest part."""
    return max(min(signed_distance(Polytope.point(point), part).distance for part in parts) for point in points)


@settings(max_examples=10)
@given(seed=seeds, dimension=some.sampled_from([2, 3]), radius=some.sampled_from([0.0, 0.05]))
def test_points_lie_within_the_shapes_and_boundaries_are_near_points(seed: int, dimension: int, radius: float) -> None:
    random = np.random.default_rng(seed)
    walls = [random.normal(size=dimension) + random.random((12, 1)) * random.normal(size=dimension) for _ in range(2)]
    cloud = np.vstack([*walls, random.normal(size=(8, dimension)) * 0.1])
    parts = cover_point_cloud(cloud, 0.2, radius=radius)
    assert farthest_outside(parts, cloud) <= -radius + 1e-9
    for part in parts:
        for corner in part.vertices:
            assert np.linalg.norm(cloud - corner, axis=1).min() < 1e-9
        middles = 0.5 * (part.vertices + np.roll(part.vertices, -1, axis=0))
        if dimension == 2:  # sides are boundary
            assert all(np.linalg.norm(cloud - middle, axis=1).min() <= 0.2 for middle in middles)


def test_a_corner_of_two_walls_is_two_segments_and_a_closed_outline_is_filled() -> None:
    along = np.linspace(0.0, 2.0, 41)
    corner = np.vstack([np.column_stack([along, 0 * along]), np.column_stack([0 * along, along])])
    parts = cover_point_cloud(corner, 0.1, radius=0.03)
    assert len(parts) == 2
    assert all(signed_distance(Polytope.point((1.0, 1.0)), part).distance > 0.5 for part in parts)
    outline = np.vstack([corner, corner[:, ::-1] * 0 + np.column_stack([2 - 0 * corner[:, 0], corner.max(axis=1)])])
    outline = np.vstack([outline, np.column_stack([along, 2 + 0 * along])])
    (filled,) = cover_point_cloud(outline, 0.1)
    assert len(filled.vertices) == 4


def test_two_clouds_far_apart_are_two_shapes_and_one_point_is_one() -> None:
    random = np.random.default_rng(0)
    cloud = random.random((60, 2))
    parts = cover_point_cloud(np.vstack([cloud, cloud + np.array([5.0, 0.0])]), 0.5)
    assert len(parts) == 2
    (point,) = cover_point_cloud([(1.0, 2.0), (1.0, 2.0)], 0.1, radius=0.2)
    assert (len(point.vertices), point.radius) == (1, 0.2)
    assert cover_point_cloud(np.zeros((0, 2)), 0.1) == []
    with pytest.raises(ObstacleError, match="tolerance"):
        cover_point_cloud([(0.0, 0.0)], 0.0)
    with pytest.raises(ObstacleError, match="not finite"):
        cover_point_cloud([(0.0, math.nan)], 0.1)


# --------------------------------------------------------------------
# Parts are convex, fill the shape exactly, and overlap in nothing but their boundaries.


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
