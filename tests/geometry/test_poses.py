"""Poses turn counter-clockwise, compose, and hold numbers and expressions alike."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as some
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, check_pose, planar_pose, spatial_pose

angle = some.floats(-7.0, 7.0)
length = some.floats(-10.0, 10.0)
triple = some.tuples(length, length, length)


@given(x=length, y=length, theta=angle, point=some.tuples(length, length))
def test_the_plane_is_complex_numbers(x: float, y: float, theta: float, point: tuple[float, float]) -> None:
    expected = complex(x, y) + complex(math.cos(theta), math.sin(theta)) * complex(*point)
    assert planar_pose(x, y, theta).apply(point) == pytest.approx((expected.real, expected.imag), abs=1e-12)


@given(position=triple, euler=some.tuples(angle, angle, angle))
def test_roll_first_then_pitch_then_yaw(position: tuple, euler: tuple) -> None:
    roll, pitch, yaw = euler
    cos, sin = math.cos, math.sin
    about_x = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    about_y = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    about_z = np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])
    rotation, translation = spatial_pose(position, euler=euler).numbers()
    assert rotation == pytest.approx(about_z @ about_y @ about_x, abs=1e-12)
    assert translation == pytest.approx(position)


@given(axis=some.tuples(length, length, length).filter(lambda a: np.linalg.norm(a) > 0.1), theta=angle)
def test_quaternions_turn_about_their_axis(axis: tuple, theta: float) -> None:
    unit = np.array(axis) / np.linalg.norm(axis)
    pose = spatial_pose((0, 0, 0), quaternion=(math.cos(theta / 2), *(math.sin(theta / 2) * unit)))
    rotation, _ = pose.numbers()
    cross = np.array([[0, -unit[2], unit[1]], [unit[2], 0, -unit[0]], [-unit[1], unit[0], 0]])
    expected = np.eye(3) + math.sin(theta) * cross + (1 - math.cos(theta)) * cross @ cross
    assert rotation == pytest.approx(expected, abs=1e-12)
    check_pose(pose, "body")


@given(a=some.tuples(length, length, angle), b=some.tuples(length, length, angle), point=some.tuples(length, length))
def test_composition_is_one_after_the_other(a: tuple, b: tuple, point: tuple) -> None:
    outer, inner = planar_pose(*a), planar_pose(*b)
    assert (outer @ inner).apply(point) == pytest.approx(outer.apply(inner.apply(point)), abs=1e-9)


def test_the_identity_leaves_all_in_place() -> None:
    pose = spatial_pose((1.0, 2.0, 3.0), euler=(0.1, 0.2, 0.3))
    assert Pose.identity(3) @ pose == pose
    assert pose @ Pose.identity(3) == pose


def test_numbers_stay_numbers() -> None:
    pose = planar_pose(1, 2, 0.3) @ planar_pose(0.5, 0, np.float64(0.1))
    assert pose.is_constant
    assert all(isinstance(entry, float) for row in pose.rotation for entry in row)


def test_an_angle_of_zero_costs_nothing() -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=2.0)
    pose = planar_pose(m.x, m.y)
    assert pose.rotation == ((1.0, 0.0), (0.0, 1.0))
    first, second = pose.apply((3.0, 0.0))
    assert second is m.y
    assert str(first) == "3.0 + x"


def test_expressions_follow_their_variables() -> None:
    m = pyo.ConcreteModel()
    m.q = pyo.Var(range(3), initialize=0.0)
    arm = planar_pose(0, 0, m.q[0]) @ planar_pose(1.0, 0, m.q[1]) @ planar_pose(1.0, 0, m.q[2])
    assert not arm.is_constant
    tip = arm.apply((1.0, 0.0))
    assert {v.name for v in identify_variables(tip[0])} == {"q[0]", "q[1]", "q[2]"}
    for values in ((0.1, 0.2, 0.3), (-1.0, 2.0, 0.5)):
        m.q.set_values(dict(enumerate(values)))
        sums = np.cumsum(values)
        assert [pyo.value(entry) for entry in tip] == pytest.approx([np.cos(sums).sum(), np.sin(sums).sum()])
        rotation, translation = arm.numbers()
        assert rotation @ (1.0, 0.0) + translation == pytest.approx([np.cos(sums).sum(), np.sin(sums).sum()])


def test_a_variable_without_a_value_is_named() -> None:
    m = pyo.ConcreteModel()
    m.theta = pyo.Var()
    with pytest.raises(ObstacleError, match=r"'car': the pose's entry .*theta.* has no value"):
        check_pose(planar_pose(0, 0, m.theta), "car")


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (Pose(((1.0, 0.0), (0.0, -1.0)), (0.0, 0.0)), r"'car': .*mirrors the body"),
        # The footprint that a slip of sign makes: sines with the same sign.
        (Pose(((0.8, 0.6), (0.6, 0.8)), (0.0, 0.0)), r"'car': .*is none: R R' differs from the identity by 0\.96"),
        (spatial_pose((0, 0, 0), quaternion=(1.0, 0.5, 0.0, 0.0)), r"'car': .*quaternion must have length one"),
        (planar_pose(math.nan, 0.0), r"'car': the pose has entries that are not finite"),
        (spatial_pose((0, 0, 0), matrix=-np.eye(3)), r"'car': .*mirrors"),
    ],
)
def test_rotations_that_are_none(pose: Pose, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        check_pose(pose, "car")


def test_degrees_are_noticed(caplog: pytest.LogCaptureFixture) -> None:
    check_pose(planar_pose(0, 0, 4.0 * math.pi), "car")
    assert caplog.text == ""
    check_pose(planar_pose(0, 0, 90.0), "car")
    assert "'car': an angle of its pose is 90; angles are in radians" in caplog.text


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: spatial_pose((0, 0, 0), euler=(0, 0, 0), matrix=np.eye(3)), "euler and matrix are given; give one"),
        (lambda: spatial_pose((0, 0)), r"position: \(x, y, z\) was expected, and 2 were given"),
        (lambda: spatial_pose((0, 0, 0), quaternion=(1, 0, 0)), r"quaternion: \(w, x, y, z\) was expected"),
        (lambda: spatial_pose((0, 0, 0), matrix=np.eye(2)), "matrix: three rows was expected"),
        (lambda: planar_pose(0, 0).apply((1, 2, 3)), "2 dimensions was applied to a point with 3 coordinates"),
        (lambda: planar_pose(0, 0) @ spatial_pose((0, 0, 0)), "2 dimensions was applied to a point with 3"),
    ],
)
def test_poses_that_are_none(make: Any, message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        make()
