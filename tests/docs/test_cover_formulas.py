"""The page's formulas for shapes that stand for others are those of the code."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.motion.given_motions import motion_along_paths
from pyrobocop_pyomo.motion.sampled_paths import read_path


@pytest.mark.parametrize("sides", [3, 8, 16, 40])
def test_excess_of_polygons(sides: int) -> None:
    expected = 0.7 * (1 / np.cos(np.pi / sides) - 1)
    assert rcp.Polytope.cylinder(0.7, 2.0, sides=sides).excess == pytest.approx(expected)
    assert rcp.Polytope.cone(0.7, 2.0, sides=sides).excess == pytest.approx(expected)
    assert rcp.Polytope.ellipsoid((0.2, 0.7), sides=sides).excess == pytest.approx(expected)


def test_excess_of_ellipsoids() -> None:
    ball = rcp.Polytope.ellipsoid((1.0, 1.0, 1.0))
    distances = ball.halfspaces[1]
    assert distances.min() == pytest.approx(1.0)
    assert np.linalg.norm(ball.vertices, axis=1).max() - 1.0 == pytest.approx(ball.excess)
    assert rcp.Polytope.ellipsoid((1.0, 3.0, 2.0)).excess == pytest.approx(3.0 * ball.excess)


def test_excess_of_grids() -> None:
    stairs = np.eye(4, dtype=bool)
    (part,) = rcp.scenes.cover_occupancy_grid(stairs, 0.5, tolerance=0.5)
    assert part.excess == pytest.approx(0.5)
    assert len(rcp.scenes.cover_occupancy_grid(stairs, 0.5, tolerance=0.49)) == 4


def test_rotation_at_constant_rate() -> None:
    random = np.random.default_rng(3)
    turns = Rotation.from_rotvec(random.normal(size=(3, 3)))
    times = np.array([0.0, 1.0, 3.0])
    poses = np.column_stack([random.normal(size=(3, 3)), turns.as_quat()])
    path = read_path(poses, times, 3, "body", quaternion_order="xyzw")
    motion, rules = motion_along_paths(times, {"body": path})
    for interval in range(2):
        step = (turns[interval].inv() * turns[interval + 1]).as_rotvec()
        for s in (0.0, 0.3, 1.0):
            rotation, translation = motion.pose_at(rules["body"], interval, s).numbers()
            expected = (turns[interval] * Rotation.from_rotvec(s * step)).as_matrix()
            assert rotation == pytest.approx(expected, abs=1e-12)
            assert translation == pytest.approx((1 - s) * poses[interval, :3] + s * poses[interval + 1, :3])
