"""Signed distances agree with programs and methods that know nothing of ours."""

from __future__ import annotations

import numpy as np
import pytest

from pyrobocop_pyomo.geometry import Polytope, distance_of_points, planar_pose, signed_distance, spatial_pose


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


def test_a_box_above_a_half_space() -> None:
    floor = Polytope.from_halfspaces([[0, 0, 1]], [0], bounded=False, name="floor")
    for height in (2.0, 0.5, 0.2):
        found = signed_distance(Polytope.box(1, 1, 1), floor, spatial_pose((100.0, -50.0, height)))
        assert found.distance == pytest.approx(height - 0.5, abs=1e-12)
        assert found.normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def test_flat_bodies() -> None:
    point = np.array([[1.0, 2.0]])
    segment = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert distance_of_points(point, segment).distance == pytest.approx(2.0)
    assert distance_of_points(segment + np.array([2.0, 0.0]), segment).distance == 0.0
    assert distance_of_points(segment + np.array([5.0, 0.0]), segment).distance == pytest.approx(1.0)
    assert distance_of_points(point, point).distance == 0.0
