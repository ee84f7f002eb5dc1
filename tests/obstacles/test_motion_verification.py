"""`verify_motion`: the proof for paths of numbers and for trajectories, without a model."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, on_a_phase, on_points
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import signed_distance

CART = rcp.Polytope.box(0.4, 0.2)
WALL = rcp.Polytope.box(0.1, 1.0, center=(1.5, 0.0))
STICK = rcp.Polytope.box(1.0, 0.1, 0.2)
seeds = st.integers(0, 10**6)


def proven(path: Any, poses: Any = None, **options: Any) -> Any:
    return rcp.verify_motion(path, poses, **{"body": CART, "obstacles": [WALL], "clearance": 0.05, **options})


@settings(max_examples=20)
@given(seed=seeds, turn=st.floats(0.0, 2.5))
def test_arrays_in_the_plane_are_the_motion_that_is_linear_between_points(seed: int, turn: float) -> None:
    random = np.random.default_rng(seed)
    poses = np.cumsum(random.normal(size=(5, 3)) * [0.6, 0.6, 0.0], axis=0)
    poses[:, 2] = np.cumsum(random.uniform(-turn, turn, 5))
    times = np.cumsum(random.uniform(0.1, 2.0, 5))
    (expected,) = check(on_points(poses, times.tolist()), CART, [WALL], 0.05).body_pairs
    (found,) = proven(times, poses).body_pairs
    assert found.distance == pytest.approx(expected.distance, abs=1e-12)
    assert found.proven == pytest.approx(expected.proven, abs=1e-12)
    matrices = [rcp.planar_pose(*pose) for pose in poses]
    (again,) = proven(times, matrices).body_pairs
    assert again.distance == pytest.approx(expected.distance, abs=1e-9)


@settings(max_examples=20)
@given(seed=seeds)
def test_in_space_bodies_turn_at_constant_rate_about_a_constant_axis(seed: int) -> None:
    """Against spherical interpolation by SciPy, at 60 instants of each interval."""
    random = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(random.normal(size=(4, 3)) * 0.8)
    times, positions = np.array([0.0, 1.0, 1.5, 3.0]), random.normal(size=(4, 3)) * 0.4
    ball = rcp.Polytope.ball(0.1, positions.mean(axis=0) + np.array([0.0, 0.0, random.uniform(0.2, 1.5)]))
    poses = [
        rcp.spatial_pose(place, quaternion=np.roll(quaternion, 1))  # SciPy's are xyzw
        for place, quaternion in zip(positions, turns.as_quat(), strict=True)
    ]
    report = rcp.verify_motion(times, poses, body=STICK, obstacles={"ball": ball}, clearance=0.03)
    dense = np.linspace(0.0, 3.0, 180)
    rotations = Slerp(times, turns)(dense).as_matrix()
    places = np.column_stack([np.interp(dense, times, column) for column in positions.T])
    distances = [
        signed_distance(STICK, ball, rcp.spatial_pose(place, matrix=rotation.tolist())).distance
        for place, rotation in zip(places, rotations, strict=True)
    ]
    (pair,) = report.body_pairs
    assert pair.proven <= min(distances) + 1e-9
    if min(distances) < 0.0297 - 1e-9:
        assert not report.safe
    if min(distances) > 0.031:
        assert report.safe


def test_a_collision_between_two_poses_is_found_and_the_first_line_says_which_motion_is_meant() -> None:
    report = proven([0, 1], [(0, 0), (3, 0)])
    assert not report.safe
    assert 0.4 < report.worst.time < 0.6
    assert str(report).startswith("NOT SAFE")
    assert "straight lines between the points" in str(report).splitlines()[0]
    above = proven([0, 1], [(0, 1), (3, 1)])
    assert above.safe
    assert "straight lines between the points" in str(above).splitlines()[0]


def test_headings_turn_the_shorter_way() -> None:
    poses = [(0.0, 0.0, 2.5), (0.0, 0.0, -2.5)]
    stick = rcp.Polytope.from_vertices([(0, -0.01), (1, -0.01), (1, 0.01), (0, 0.01)])
    east, west = rcp.Polytope.ball(0.1, (0.8, 0.0)), rcp.Polytope.ball(0.1, (-0.8, 0.0))
    report = rcp.verify_motion([0, 1], poses, body=stick, obstacles={"east": east, "west": west}, clearance=0.05)
    verdicts = {pair.second: pair.safe for pair in report.body_pairs}
    assert verdicts == {"east": True, "west": False}


def test_a_trajectory_moves_by_the_polynomials_of_its_states(tmp_path) -> None:
    m = on_a_phase(lambda t: (3 * t, math.sin(3 * t) + 0.9, t), duration=1.0, elements=4)
    expected = check(m, CART, [WALL], 0.05, points=m.move.time, pose=lambda m, t: by_states(m.move, t), equations=False)
    saved = m.move.trajectory().save(tmp_path / "move.npz")
    loaded = rcp.Trajectory.load(saved)
    report = rcp.verify_motion(
        loaded, bodies={"cart": rcp.Body(CART, pose=by_states)}, obstacles=[WALL], clearance=0.05
    )
    assert report.body_pairs[0].distance == pytest.approx(expected.body_pairs[0].distance, abs=1e-12)
    assert report.body_pairs[0].proven == pytest.approx(expected.body_pairs[0].proven, abs=1e-12)
    assert "polynomials of the states of trajectory 'move'" in str(report).splitlines()[0]


def test_several_bodies_and_rules_of_time() -> None:
    times = np.linspace(0.0, 4.0, 9)
    straight = np.column_stack([times, 0 * times])
    truck = np.column_stack([0 * times + 2.0, np.interp(times, [2.0, 4.0], [-3.0, 3.0])])
    options = {
        "bodies": {"cart": CART, "trailer": CART},
        "obstacles": {
            "truck": rcp.Polytope.box(1.0, 1.0),
            "drone": rcp.Body(CART, pose=lambda b, t: rcp.planar_pose(4.0, 5.0 - t * t / 4, pyo.sin(t))),
        },
        "exclude": [("cart", "trailer")],
        "clearance": 0.05,
    }
    poses = {"cart": straight, "trailer": straight - [0.5, 0.0], "truck": truck}
    report = rcp.verify_motion(times, poses, **options)
    verdicts = {(pair.first, pair.second): pair.verdict for pair in report.body_pairs}
    # The truck crosses y = 0 at t = 3, when the cart has just left; the trailer is still there.
    dense = np.linspace(0.0, 4.0, 2001)
    gaps = np.abs(np.interp(dense, times, truck[:, 1])) - 0.6
    for name, offset in (("cart", 0.0), ("trailer", -0.5)):
        apart = np.maximum(np.abs(dense + offset - 2.0) - 0.7, gaps).min()
        assert (verdicts[name, "truck"] == "clear") == (apart > 0.05)
    assert verdicts["cart", "drone"] == "clear"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": [0, 1]}, "3 poses for 2 times"),
        ({"path": ["a", "b", "c"]}, "expected numbers"),
        ({"path": np.zeros((3, 3))}, "expected a list of at least 2 numbers"),
        ({"poses": [(0, 0), (1, math.inf), (2, 0)]}, "'body': inf at .1, 1. is not finite"),
        ({"poses": [(0, 0, 0, 1)] * 3}, r"shape \(3, 4\); expected \(N, 2\)"),
        ({"poses": [(0, 0, 0), (1, 0, math.pi), (2, 0, 0)]}, "half a turn"),
        ({"poses": {"robot": np.zeros((3, 2))}}, "names 'robot'"),
        ({"poses": None}, "neither poses nor a pose rule"),
        ({"poses": [rcp.spatial_pose((0, 0, 0))] * 3}, "row 0 is a pose in 3 dimensions"),
        ({"clearance": 0.0}, "length > 0"),
        ({"bodies": {"cart": CART}}, "either body=shape"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_row(change: dict[str, Any], message: str) -> None:
    arguments = {"path": [0, 1, 2], "poses": [(0, 0), (0.5, 0), (1, 0)], **change}
    with pytest.raises(ObstacleError, match=message):
        proven(arguments.pop("path"), arguments.pop("poses"), **arguments)


def test_a_trajectory_takes_pose_rules_that_read_states() -> None:
    m = on_a_phase(lambda t: (3 * t, 1.0, 0.0), duration=1.0, elements=2)
    trajectory = m.move.trajectory()
    with pytest.raises(ObstacleError, match="both a trajectory and poses or signals"):
        proven(trajectory, [(0, 0)])
    with pytest.raises(ObstacleError, match="no state of trajectory"):
        proven(trajectory, body=rcp.Body(CART, pose=lambda b, t: rcp.planar_pose(b.v_x[t], 0)))
    with pytest.raises(ObstacleError, match="part of a model"):
        proven(m.move.time, [(0, 0)])


def test_frames_of_tables_and_lists_without_times_are_taken() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"t": [0.0, 1.0, 2.0], "x": [0.0, 1.0, 2.0], "y": 1.0, "yaw": 0.0})
    assert proven(table["t"], table[["x", "y", "yaw"]]).safe
    assert proven(range(3), table[["x", "y"]].to_numpy()).safe
