"""What a convex shape looks like: outlines and faces hold the shape, no less and not much more."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import ConvexHull

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.plotting.scenes import convex_faces, convex_outline, faces, outline

# Whole numbers: many of them on one line, which is what goes wrong in hulls.
planar = arrays(float, st.tuples(st.integers(3, 12), st.just(2)), elements=st.integers(-3, 3).map(float))
spatial = arrays(float, st.tuples(st.integers(4, 12), st.just(3)), elements=st.integers(-3, 3).map(float))


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def volume_behind(polygons: list[np.ndarray], inside: np.ndarray) -> float:
    """Of the pyramids between the faces and a point."""
    return sum(
        abs(np.linalg.det(np.array([face[0], face[i], face[i + 1]]) - inside)) / 6
        for face in polygons
        for i in range(1, len(face) - 1)
    )


@given(planar)
def test_an_outline_turns_left_at_each_corner_and_holds_all_points(points: np.ndarray) -> None:
    corners = convex_outline(points)
    assert {tuple(corner) for corner in corners} <= {tuple(point) for point in points}
    if np.linalg.matrix_rank(points - points[0]) < 2:
        assert len(corners) <= 2
        return
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    assert ((points[:, None] - corners[None]) * normals).sum(axis=-1).max() <= 1e-12
    assert area(corners) == pytest.approx(ConvexHull(points).volume, rel=1e-9)


@given(spatial)
def test_faces_enclose_the_hull(points: np.ndarray) -> None:
    found = convex_faces(points)
    if np.linalg.matrix_rank(points - points[0]) < 3:
        assert len(found) == 1
        return
    hull = ConvexHull(points)
    assert volume_behind(found, points.mean(axis=0)) == pytest.approx(hull.volume, rel=1e-7)
    corners = {tuple(np.round(corner, 6) + 0.0) for face in found for corner in face}
    assert {tuple(point) for point in points[hull.vertices]} >= corners


@pytest.mark.parametrize("radius", [0.1, 0.5])
def test_padding_rounds_the_outline_and_keeps_to_the_radius(radius: float) -> None:
    corners = outline(rcp.Polytope.box(1, 1).padded(radius))
    beyond = np.linalg.norm(np.maximum(np.abs(corners) - 0.5, 0), axis=1)
    assert beyond == pytest.approx(radius)
    assert area(corners) == pytest.approx(1 + 4 * radius + np.pi * radius**2, rel=1e-2)


def test_a_ball_in_space_is_about_round() -> None:
    found = faces(rcp.Polytope.ball(0.5, center=(1, 2, 3)))
    corners = np.concatenate(found)
    assert np.linalg.norm(corners - [1, 2, 3], axis=1) == pytest.approx(0.5)
    assert volume_behind(found, np.array([1.0, 2, 3])) == pytest.approx(np.pi / 6, rel=0.1)


VIEW = np.array([[-2.0, -1.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("normals", "offsets", "seen"),
    [
        ([[0, -1]], [-3], 5 * 1),  # half-plane y >= 3
        ([[1, 0], [0, 1]], [1, 1], 3 * 2),  # wedge x <= 1, y <= 1
        ([[1, 0], [-1, 0]], [1, 0], 1 * 5),  # strip 0 <= x <= 1
        ([[-1, -1]], [0], 25 - 0.5 * 3**2),  # slanted half-plane x + y >= 0
    ],
)
def test_what_never_ends_is_drawn_to_the_edge_of_the_view_and_a_little_further(
    normals: list, offsets: list, seen: float
) -> None:
    corners = outline(rcp.Polytope.from_halfspaces(normals, offsets, bounded=False), VIEW)
    assert (np.array(normals) @ corners.T - np.array(offsets)[:, None]).max() <= 1e-9 * 5
    assert (corners >= VIEW[0] - 0.2).all()
    assert (corners <= VIEW[1] + 0.2).all()
    assert seen < area(corners) < seen * 1.15 + 0.3


def test_a_floor_in_space_is_cut_at_the_view() -> None:
    view = np.array([[-1.0, -1, -1], [1, 1, 1]])
    floor = rcp.Polytope.from_halfspaces([[0, 0, 1]], [-0.5], bounded=False)
    found = faces(floor, view)
    assert volume_behind(found, np.array([0, 0, -0.75])) == pytest.approx(2 * 2 * 0.5)
    wall = faces(rcp.Polytope.box(0.1, 10, 10), view)
    assert volume_behind(wall, np.zeros(3)) == pytest.approx(0.1 * 2 * 2)
