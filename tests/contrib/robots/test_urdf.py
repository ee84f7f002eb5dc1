"""Robots from URDF: kinematics as yourdfpy's own, collision geometry, excluded pairs, refusals."""

import io
import logging
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError

yourdfpy = pytest.importorskip("yourdfpy")

CAPSULE = '<geometry><cylinder radius="0.05" length="0.4"/></geometry>'
ARM = f"""
<robot name="arm">
  <link name="base"><collision><geometry><box size="0.3 0.3 0.1"/></geometry></collision></link>
  <link name="turret"/>
  <link name="upper"><collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>{CAPSULE}</collision></link>
  <link name="lower"><collision><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/>{CAPSULE}</collision></link>
  <link name="hand"><collision><geometry><box size="0.1 0.2 0.05"/></geometry></collision>
    <collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.04"/></geometry></collision></link>
  <link name="left"><collision><geometry><box size="0.1 0.02 0.02"/></geometry></collision></link>
  <link name="right"><collision><geometry><box size="0.1 0.02 0.02"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="turret"/>
    <origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="turret"/><child link="upper"/>
    <axis xyz="0 -1 0"/><limit lower="-1.5" upper="2" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.45 0 0" rpy="0 0 0.5"/><axis xyz="0.6 0 0.8"/><limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="fixed"><parent link="lower"/><child link="hand"/>
    <origin xyz="0.5 0 0" rpy="0 0.3 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="hand"/><child link="left"/>
    <origin xyz="0.15 0.05 0"/><axis xyz="0 1 0"/><limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
  <joint name="grip_right" type="prismatic"><parent link="hand"/><child link="right"/>
    <origin xyz="0.15 -0.05 0"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.05" effort="1" velocity="1"/>
    <mimic joint="grip" multiplier="0.5" offset="0.01"/></joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0 0 0.1"/></joint>
</robot>
"""
ZERO = {"turn": 0.0, "shoulder": 0.0, "elbow": 0.0, "grip": 0.0}
# The reader leaves a joint where it is when a step is smaller than about 1e-8.
angles = some.integers(-3000, 3000).map(lambda thousandths: thousandths / 1000)


@settings(max_examples=25)
@given(
    turn=angles, shoulder=angles, elbow=angles, grip=some.integers(0, 50).map(lambda thousandths: thousandths / 1000)
)
def test_kinematics_are_those_of_the_reader(turn: float, shoulder: float, elbow: float, grip: float) -> None:
    coordinates = {"turn": turn, "shoulder": shoulder, "elbow": elbow, "grip": grip}
    robot = rcp.scenes.from_urdf(ARM, coordinates)
    reader = yourdfpy.URDF.load(io.BytesIO(ARM.encode()), load_meshes=False)
    reader.update_cfg(coordinates)
    for link, rule in robot.pose_rules.items():
        rotation, translation = rule(None, None).numbers()
        expected = reader.get_transform(link, "base")
        assert np.abs(rotation - expected[:3, :3]).max() < 1e-12
        assert np.abs(translation - expected[:3, 3]).max() < 1e-12


def test_rules_are_expressions_of_the_states() -> None:
    m = pyo.ConcreteModel()
    m.t = pyo.Set(initialize=[0.0, 1.0], ordered=True)
    m.q, m.turn = pyo.Var([1, 2], m.t, initialize=0.3), pyo.Var(m.t, initialize=-0.4)
    joints = {"turn": "turn", "shoulder": lambda m, t: m.q[1, t], "elbow": lambda m, t: m.q[2, t], "grip": 0.02}
    base = rcp.spatial_pose((1.0, 2.0, 3.0), euler=(0.1, 0.2, 0.3))
    robot = rcp.scenes.from_urdf(ARM, joints, base=base)
    at_rest = rcp.scenes.from_urdf(ARM, {"turn": -0.4, "shoulder": 0.3, "elbow": 0.3, "grip": 0.02}, base=base)
    for link, rule in robot.pose_rules.items():
        numbers = at_rest.pose_rules[link](None, None).numbers()
        for found, expected in zip(rule(m, 1.0).numbers(), numbers, strict=True):
            assert found == pytest.approx(expected, abs=1e-14)
    assert robot.bodies["base"].pose is None  # rests
    assert robot.bodies["base"].parts[0].center == pytest.approx([1.0, 2.0, 3.0])
    assert robot.bodies["upper"].moves
    assert robot.limits == {
        "turn": (-math.inf, math.inf),
        "shoulder": (-1.5, 2.0),
        "elbow": (-2.0, 2.0),
        "grip": (0.0, 0.05),
    }


def test_collision_geometry_and_pairs_that_are_left_out() -> None:
    robot = rcp.scenes.from_urdf(ARM, ZERO, srdf='<robot><disable_collisions link1="left" link2="right"/></robot>')
    assert list(robot.bodies) == ["base", "upper", "lower", "hand", "left", "right"]
    assert [part.radius for part in robot.bodies["hand"].parts] == [0.0, 0.04]
    (cylinder,) = robot.bodies["upper"].parts
    assert np.ptp(cylinder.vertices, axis=0)[0] == pytest.approx(0.4)
    assert 0.0 < cylinder.excess < 0.0011
    excluded = set(robot.exclude)
    # The turret has no geometry: base and upper arm are next to each other. The hand is fixed to the lower arm.
    adjacent = {("base", "upper"), ("upper", "lower"), ("upper", "hand"), ("lower", "hand")}
    fingers = {(link, finger) for link in ("lower", "hand") for finger in ("left", "right")}
    assert excluded == adjacent | fingers | {("left", "right")}


def only_moving(robot: Any) -> dict[str, rcp.Body]:
    return {name: body for name, body in robot.bodies.items() if body.moves}


def test_a_table_of_joints_is_verified_without_a_model() -> None:
    """Joints are linear between the rows."""
    robot = rcp.scenes.from_urdf(ARM, {name: name for name in ZERO})
    bodies, ball = only_moving(robot), rcp.Polytope.ball(0.2, (0.7, 0.4, 0.2))
    times = np.array([0.0, 1.0, 2.5])
    joints = {"turn": [0.0, 0.3, 1.0], "shoulder": [0.2, 0.6, 0.5], "elbow": [0.0, -0.5, 0.4], "grip": [0.0, 0.02, 0.0]}
    options = {"bodies": bodies, "obstacles": {"ball": ball}, "body_pairs": [(name, "ball") for name in bodies]}
    report = rcp.verify_motion(times, signals=joints, clearance=0.01, **options)
    for pair in report.body_pairs:
        name = pair.first.partition("[")[0]
        shape = dict(robot.bodies[name].named_parts(name))[pair.first]
        sampled = []
        for t in np.linspace(0.0, 2.5, 60):
            now = SimpleNamespace(**{joint: {t: float(np.interp(t, times, row))} for joint, row in joints.items()})
            pose = robot.pose_rules[name](now, t)
            sampled.append(rcp.scenes.signed_distance(shape, ball, pose).distance)
        assert pair.proven <= min(sampled) + 1e-9
        assert pair.safe == (min(sampled) > 0.01) or abs(min(sampled) - 0.01) < 1e-3
    whole = {"bodies": robot.bodies, "obstacles": {"ball": ball}, "exclude": robot.exclude}
    base = rcp.verify_motion(times, signals=joints, clearance=0.01, **whole)
    assert {("base", "hand[1]"), ("base", "lower")} <= {(pair.first, pair.second) for pair in base.body_pairs}
    with pytest.raises(ObstacleError, match="signal 'turn' has the shape"):
        rcp.verify_motion(times, signals={**joints, "turn": [0.0]}, clearance=0.01, **options)
    with pytest.raises(ObstacleError, match="name 'a b'"):
        rcp.verify_motion(times, signals={**joints, "a b": times}, clearance=0.01, **options)


def test_meshes_become_hulls_boxes_or_parts(tmp_path) -> None:
    trimesh = pytest.importorskip("trimesh")
    corner = trimesh.util.concatenate([trimesh.creation.box((2, 1, 1)), trimesh.creation.icosphere(subdivisions=1)])
    (tmp_path / "meshes").mkdir()
    corner.export(tmp_path / "meshes" / "part.stl")
    text = """<robot name="r"><link name="a"><collision><geometry>
      <mesh filename="package://mine/meshes/part.stl" scale="0.1 0.1 0.1"/></geometry></collision></link></robot>"""
    (tmp_path / "r.urdf").write_text(text)
    where = {"packages": {"mine": tmp_path}}
    with pytest.raises(ObstacleError, match="package 'mine'"):
        rcp.scenes.from_urdf(tmp_path / "r.urdf", {})
    with pytest.raises(ObstacleError, match="no file"):
        rcp.scenes.from_urdf(tmp_path / "r.urdf", {}, packages={"mine": tmp_path / "elsewhere"})
    (hull,) = rcp.scenes.from_urdf(tmp_path / "r.urdf", {}, **where).bodies["a"].parts
    (box,) = rcp.scenes.from_urdf(tmp_path / "r.urdf", {}, meshes="box", **where).bodies["a"].parts
    normals, offsets = hull.halfspaces
    assert (corner.vertices * 0.1 @ normals.T <= offsets + 1e-7).all()  # such files hold single precision
    assert np.ptp(box.vertices, axis=0) == pytest.approx(np.ptp(corner.vertices, axis=0) * 0.1)


def changed(old: str, new: str) -> str:
    assert old in ARM
    return ARM.replace(old, new, 1)


@pytest.mark.parametrize(
    ("text", "change", "message"),
    [
        (ARM, {"joints": {"turn": 0.0}}, "says nothing about 'shoulder', 'elbow', 'grip'"),
        (ARM, {"joints": {**ZERO, "knee": 0.0}}, "'knee', which do not move"),
        (ARM, {"joints": {**ZERO, "turn": None}}, "joint 'turn' is given None"),
        (ARM, {"base": (0, 0, 0)}, "base="),
        (ARM, {"meshes": "sphere"}, "meshes="),
        (ARM, {"srdf": "<robot>"}, "SRDF"),
        ("missing.urdf", {}, "no file"),
        (changed('<mimic joint="grip"', '<mimic joint="wrist"'), {}, "mimics 'wrist'"),
        (changed('<child link="tool"/>', '<child link="left"/>'), {}, r"no tree .* several move \['left'\]"),
        (changed('<joint name="grip" type="prismatic">', '<joint name="grip" type="floating">'), {}, "base="),
    ],
)
def test_what_does_not_fit_is_refused_by_name(text: str, change: dict[str, Any], message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        rcp.scenes.from_urdf(text, **{"joints": ZERO, **change})


def test_links_of_pictures_alone_are_logged(caplog) -> None:
    text = changed('<link name="tool"/>', f'<link name="tool"><visual>{CAPSULE}</visual></link>')
    with caplog.at_level(logging.WARNING):
        rcp.scenes.from_urdf(text, ZERO)
    messages = [record.getMessage() for record in caplog.records]
    assert any("'tool' has no collision geometry" in message for message in messages)
