"""Shapes: corners and half-spaces are two names of one set, and what is no shape is refused by name."""

import logging
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from scipy.spatial import ConvexHull

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose, spatial_pose


def same_rows(left: np.ndarray, right: np.ndarray, tolerance: float) -> bool:
    """Whether two lists hold the same rows, in any order."""
    return left.shape == right.shape and near_rows(left, right, tolerance)


def near_rows(left: np.ndarray, right: np.ndarray, tolerance: float) -> bool:
    """Whether each row of one list is near one of the other."""
    apart = np.abs(left[:, None, :] - right[None, :, :]).max(axis=2)
    return bool(apart.min(axis=0).max() <= tolerance and apart.min(axis=1).max() <= tolerance)


# Conversions.


@given(dimension=some.integers(2, 3), seed=some.integers(0, 2**32 - 1), shift=some.sampled_from([0.0, 10.0, -1000.0]))
def test_corners_to_half_spaces_and_back(dimension: int, seed: int, shift: float) -> None:
    random = np.random.default_rng(seed)
    body = Polytope.hull(random.normal(size=(random.integers(dimension + 2, 15), dimension)) + shift)
    normals, offsets = body.halfspaces
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-12)
    again = Polytope.from_halfspaces(normals, offsets)
    # A corner where facets are nearly parallel moves far when they move by a rounding, or is two.
    assert near_rows(again.vertices, body.vertices, 1e-6 * (1.0 + abs(shift)))
    assert (normals @ again.vertices.T).max(axis=1) == pytest.approx(offsets, abs=1e-10 * (1.0 + abs(shift)))


@pytest.mark.parametrize("apart", [1.0, 1e-6, 1e-9, 1e-12, 2e-15])
def test_two_points_are_a_segment_however_near_they_are(apart: float) -> None:
    ends = [(3.0, 3.0), (3.0 + apart, 3.0 - 2.0 * apart)]
    assert len(Polytope.hull(ends, allow_flat=True, radius=0.1).vertices) == 2


@given(seed=some.integers(0, 2**32 - 1), dimension=some.integers(2, 3))
def test_half_spaces_hold_what_the_corners_span_and_each_is_a_facet(seed: int, dimension: int) -> None:
    random = np.random.default_rng(seed)
    points = random.integers(-2, 3, size=(12, dimension)).astype(float)  # many in one plane
    if np.linalg.matrix_rank(points - points[0]) < dimension:
        return
    body = Polytope.hull(points)
    normals, offsets = body.halfspaces
    assert (points @ normals.T <= offsets + 1e-12).all()
    for normal, offset in zip(normals, offsets, strict=True):
        on_facet = body.vertices[np.abs(body.vertices @ normal - offset) < 1e-9]
        assert np.linalg.matrix_rank(on_facet - on_facet[0]) == dimension - 1
    assert len({tuple(row) for row in normals.round(9)}) == len(normals)


@pytest.mark.parametrize(
    ("normals", "offsets", "corners", "rays"),
    [
        ([[1, 0]], [2], 1, 3),  # half-plane: one ray inwards, two along its edge
        ([[1, 0], [-1, 0]], [2, 1], 2, 2),  # slab
        ([[1, 0], [0, 1]], [2, 1], 1, 2),  # wedge
        ([[1, 1], [-1, 1], [0, -1]], [2, 2, 1], 3, 0),
        ([[0, 1], [-1, 0], [1, 0]], [2, 1, 1], 2, 1),  # a half-strip
        ([[0, 0, 3]], [6], 1, 5),  # half-space
        ([[0, 0, 1], [0, 0, -1]], [2, 1], 2, 4),
        ([[0, 0, 1], [0, 1, 0]], [2, 1], 1, 4),
        ([[0, 0, 1], [0, 1, 0], [1, 1, 1]], [2, 1, 3], 1, 3),
        ([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], [1, 1, 1, 1], 4, 2),  # an endless square bar
    ],
)
def test_sets_without_end(normals: Any, offsets: Any, corners: int, rays: int) -> None:
    body = Polytope.from_halfspaces(normals, offsets, bounded=False)
    assert (len(body.vertices), len(body.rays)) == (corners, rays)
    assert body.is_bounded == (rays == 0)
    lengths = np.linalg.norm(normals, axis=1)
    found_normals, found_offsets = body.halfspaces
    expected = np.column_stack([normals / lengths[:, None], offsets / lengths])
    assert same_rows(np.column_stack([found_normals, found_offsets]), expected, 1e-9)
    for reach in (0.0, 3.0, 1e3):  # points of the set, by the corners and rays, are in the half-spaces
        for ray in [*body.rays, np.zeros(body.dimension)]:
            assert (np.asarray(normals) @ (body.vertices + reach * ray).T <= np.array(offsets)[:, None] + 1e-9).all()


def test_thin_sets_far_from_the_origin_keep_their_corners() -> None:
    normals = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    center = np.array([1000.0, -1000.0])
    body = Polytope.from_halfspaces(normals, np.array([0.5, 0.5, 5e-7, 5e-7]) + normals @ center)
    assert same_rows(body.vertices, Polytope.box(1, 1e-6, center=center).vertices, 1e-12)


def test_redundant_half_spaces_are_dropped() -> None:
    normals = [[2, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, 0]]
    body = Polytope.from_halfspaces(normals, [2, 1, 1, 1, 2, 1], name="crate")
    assert len(body.halfspaces[0]) == 4


# Constructors.


def test_shapes_in_the_plane_run_counter_clockwise() -> None:
    outline = [(0, 0), (0, 2), (3, 2), (3, 0), (0, 0)]
    for body in (
        Polytope.from_vertices(outline), Polytope.from_vertices(outline[::-1]), Polytope.hull(outline),
        Polytope.box(3, 2), Polytope.regular_polygon(7, 2.0, (1, 5)),
        Polytope.from_halfspaces([[1, 1], [-1, 0], [0, -1]], [1, 0, 0]),
    ):  # fmt: skip
        edges = np.roll(body.vertices, -1, axis=0) - body.vertices
        following = np.roll(edges, -1, axis=0)
        assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0).all()


def test_boxes_take_full_sides() -> None:
    assert np.ptp(Polytope.box(4.0, 2.0, center=(7, 8)).vertices, axis=0) == pytest.approx([4.0, 2.0])
    box = Polytope.box(1.0, 2.0, 3.0, center=(1, 1, 1))
    assert ConvexHull(box.vertices).volume == pytest.approx(6.0)
    assert box.center == pytest.approx([1, 1, 1])
    assert box.reach == pytest.approx(np.linalg.norm([1.5, 2.0, 2.5]))


def test_padding_adds_up_and_leaves_the_core() -> None:
    capsule = Polytope.capsule((0, 0, 0), (0, 0, 2), 0.5, name="arm").padded(0.25)
    assert (capsule.radius, capsule.name, capsule.is_flat, len(capsule.vertices)) == (0.75, "arm", True, 2)
    assert capsule.reach == 2.75
    assert Polytope.ball(2.0, (0, 0, 0)).dimension == 3
    assert Polytope.from_halfspaces([[0, 1]], [0], bounded=False).reach == np.inf


def test_a_shape_is_carried_by_its_pose() -> None:
    wedge = Polytope.from_halfspaces([(-1, 0), (0, -1)], [-1, 0], bounded=False, radius=0.1, name="corner")
    placed = wedge.placed(planar_pose(10, 20, np.pi / 2))
    assert placed.vertices == pytest.approx(np.array([[10, 21]]))
    assert placed.rays == pytest.approx(np.array([[0, 1], [-1, 0]]))
    assert (placed.radius, placed.name) == (0.1, "corner")
    with pytest.raises(ObstacleError, match=r"'corner' has 2 dimensions and its pose 3"):
        wedge.placed(spatial_pose((0, 0, 0)))


def test_arrays_are_read_only() -> None:
    box = Polytope.box(1, 1)
    for array in (box.vertices, box.rays, *box.halfspaces):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_the_callers_array_stays_his_own() -> None:
    mine = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    body = Polytope.from_vertices(mine)
    mine[0] = 5.0
    assert body.vertices.max() == 1.0


# What is left out with a warning.


@pytest.mark.parametrize(
    ("vertices", "left", "said"),
    [
        ([(0, 0), (1, 0), (1, 0), (0, 1)], 3, "1 of its points are repeated"),
        ([(0, 0), (1, 0), (2, 0), (0, 1)], 3, "1 of its 4 points are no corners"),
        ([*Polytope.box(1, 1, 1).vertices.tolist(), (0, 0, 0.1)], 8, "1 of its 9 points are no corners"),
    ],
)
def test_points_that_are_no_corners_are_told(
    vertices: Any, left: int, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    body = Polytope.from_vertices(vertices, name="stone")
    assert len(body.vertices) == left
    assert f"'stone': {said}" in caplog.text


def test_a_closed_ring_is_nothing_to_talk_about(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        assert len(Polytope.from_vertices([(0, 0), (1, 0), (0, 1), (0, 0)]).vertices) == 3
    assert caplog.text == ""


# What is refused.

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([(0, 0), (1, np.nan), (0, 1)], r"'stone': vertices: nan at \[1, 1\] is not finite"),
        ([(0,), (1,)], r"'stone': vertices have the shape \(2, 1\); expected one row per point"),
        ([(0, 0), (1, 0, 0)], r"'stone': vertices: expected numbers"),
        (np.zeros((0, 2)), r"'stone': there are no points"),
        ([(0, 0), (1, 1), (2, 2)], r"'stone': its 3 distinct points lie in a line; .* needs 3 points that do not"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], r"'stone': its 3 distinct points lie in a plane; .*allow_flat=True"),
        (
            [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)],
            r"'stone': the outline is not convex.* at its point 3.*decompose",
        ),
        ([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], r"'stone': the outline .*crosses itself.*Polytope\.hull"),
    ],
)
def test_lists_of_corners_that_are_none(vertices: Any, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        Polytope.from_vertices(vertices, name="stone")


@given(some.permutations(range(6)))
def test_an_outline_is_accepted_exactly_if_it_goes_around(order: list[int]) -> None:
    """Of all orders of a hexagon's corners, those that go around it once, either way."""
    ring = Polytope.regular_polygon(6, 1.0).vertices[order]
    steps = {(b - a) % 6 for a, b in zip(order, [*order[1:], order[0]], strict=True)}
    if steps in ({1}, {5}):
        assert len(Polytope.from_vertices(ring).vertices) == 6
    else:
        with pytest.raises(ObstacleError, match="crosses itself"):
            Polytope.from_vertices(ring)
    assert same_rows(Polytope.hull(ring).vertices, ring, 0.0)


@pytest.mark.parametrize(
    ("normals", "offsets", "message"),
    [
        ([[1, 0], [0, 0]], [1, 1], r"'wall': row 1 of the normals is zero"),
        ([[1, 0], [-1, 0]], [1], r"'wall': 2 normals need as many offsets"),
        ([[1, 0], [-1, 0]], [1, np.nan], r"'wall': offsets: nan at \[1\] is not finite"),
        ([[1, np.inf]], [1], r"'wall': normals: inf at \[0, 1\] is not finite"),
        # The unit square with all its normals turned inwards.
        ([[-1, 0], [1, 0], [0, -1], [0, 1]], [-1, -1, -1, -1], r"'wall': the set .* is empty.*check their signs"),
        ([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, -1, 1, 1], r"'wall': the set .* has no interior"),
        ([[1, 0], [0, 1], [-1, 0]], [1, 1, 1], r"has no end in the direction \[ *0\. +-1\.\]"),
    ],
)
def test_half_spaces_that_bound_nothing(normals: Any, offsets: Any, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        Polytope.from_halfspaces(normals, offsets, name="wall")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Polytope.box(1, -1, name="a"), r"'a': a box has 2 or 3 sides of positive length"),
        (lambda: Polytope.box(1, 1, center=(0, 0, 0), name="a"), r"'a': the position has 3 coordinates; expected 2"),
        (lambda: Polytope.regular_polygon(2, 1.0, name="a"), r"'a': 2 corners; expected a whole number, 3 or more"),
        (lambda: Polytope.regular_polygon(5, 0.0, name="a"), r"'a': circumradius 0.0; expected a positive length"),
        (lambda: Polytope.ball(-1.0, name="a"), r"'a': its radius is -1.0"),
        (lambda: Polytope.box(1, 1, name="a").padded(np.inf), r"'a': its radius is inf"),
        (lambda: Polytope.point((0, 0, 0, 0), name="a"), r"'a': positions have the shape \(1, 4\)"),
        (lambda: Polytope.point((0, 0), name="a").halfspaces, r"'a' is flat and has no half-spaces"),
    ],
)
def test_shapes_that_are_none(make: Any, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        make()
