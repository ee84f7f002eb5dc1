"""Bounds on the paths of corners hold at every instant of a subinterval, and are exact for parabolas."""

from typing import Any

import numpy as np
import pytest
from harness.moving import by_states, on_points, placed
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.clearance_proof import _Proof
from pyrobocop_pyomo.motion.equations_motion import EquationsMotion
from pyrobocop_pyomo.motion.moving_shapes import MovingShape, RequiredClearance, moving_shapes

SHAPE = Polytope.from_vertices([(-1.0, -0.5), (2.0, -0.5), (2.0, 0.25), (0.0, 1.0)])

seeds = st.integers(0, 10**6)
subintervals = st.tuples(st.floats(0, 0.95), st.floats(0.02, 1.0)).map(lambda pair: (pair[0], min(sum(pair), 1.0)))


def moving(m: Any, shape: Polytope, pose: Any = by_states) -> MovingShape:
    return moving_shapes(motion_of(m.t, m), {"body": Body(shape, pose)})["body"][0]


@given(
    seed=seeds, subinterval=subintervals, direction=st.floats(0, 6.3), turn=st.floats(0, 4), length=st.floats(0.1, 3)
)
def test_a_plane_proves_no_more_than_its_smallest_gap(
    seed: int, subinterval: tuple[float, float], direction: float, turn: float, length: float
) -> None:
    """eq-plane-bound and eq-converges: below the gap at every instant, and close to it on short subintervals."""
    random = np.random.default_rng(seed)
    poses, others = random.normal(size=(2, 3)) * [2, 2, turn], random.normal(size=(2, 3)) * [2, 2, turn]
    first = moving(on_points(poses), SHAPE.padded(0.1))
    second = moving(on_points(others), Polytope.box(0.5, 0.7).padded(0.2))
    proof = _Proof(first, second, RequiredClearance("", 0.0), 0.001, 5, 100, EquationsMotion(1))
    at = np.array([0]), np.array([subinterval[0]]), np.array([subinterval[1]])
    normal = np.array([[np.cos(direction), np.sin(direction)]])
    none = proof.clearance.bounds(*at)
    bound = proof._plane_bounds(length * normal, first.path_bounds(*at), second.path_bounds(*at), none)[0]
    fractions = np.linspace(*subinterval, 501)[:, None]
    p = placed(SHAPE.vertices, poses[0] + fractions * (poses[1] - poses[0])) @ normal[0]
    q = placed(second.shape.vertices, others[0] + fractions * (others[1] - others[0])) @ normal[0]
    gaps = p.min(axis=1) - q.max(axis=1) - 0.3
    assert bound <= gaps.min() + 1e-12
    # An angle that changes by a at constant rate curvatures the path of a corner at distance r by r a^2.
    curvatures = [
        np.linalg.norm(vertices, axis=1).max() * float(pair[1, 2] - pair[0, 2]) ** 2
        for vertices, pair in ((SHAPE.vertices, poses), (second.shape.vertices, others))
    ]
    assert bound >= min(gaps[0], gaps[-1]) - 3 * (subinterval[1] - subinterval[0]) ** 2 / 8 * sum(curvatures) - 1e-9


def test_the_chord_deviation_of_a_parabola_is_exact() -> None:
    """``h^2 / 8`` times the second derivative: the smallest constant that is right for all paths."""
    m = on_points([(0, 0, 0), (0, 0, 0)], [0.0, 1.0])
    body = moving(m, Polytope.point((0.0, 0.0)), lambda b, t: planar_pose(0, (2 * t - 1) ** 2))
    for start, end in ((0.0, 1.0), (0.2, 0.8), (0.375, 0.625)):
        found = body.path_bounds(np.array([0]), np.array([start]), np.array([end]))
        assert found.boxes().low[0, 1] == pytest.approx(0.0, abs=1e-12)
        assert found.boxes().high[0, 1] == pytest.approx((2 * end - 1) ** 2)
