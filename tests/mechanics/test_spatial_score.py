"""The physical score in space passes a plan that was made by hand from the laws of motion, and finds faults in it."""

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mechanics.bodies import SPACE
from pyrobocop_pyomo.mechanics.plan_score import PlannedBody
from pyrobocop_pyomo.mechanics.rotations import rotation_matrix, tangents_across

spatial = rcp.mechanics.spatial
ROTATION = SPACE.orientation
BALL = spatial.RigidBody(spatial.Sphere(0.2), mass=0.6, inertia=0.4 * 0.6 * 0.2**2)
QUAD = spatial.SphereRobot(spatial.Sphere(0.12), mass=0.8, force_limit=((-10, 10), (-10, 10), (0, 20)), speed_limit=4.0)
STEP, STEPS, SQUEEZE, START = 0.07, 20, 9.0, (0.1, -0.2, 0.3)
SCORE = spatial.Score(BALL, QUAD, friction=0.7, step=STEP, goal=(0.0, 0.0, 0.35, *START))

Plans = dict[str, dict[str, np.ndarray]]


def lifting() -> Plans:
    """Two robots press a ball from both sides and lift it by friction; forces follow from Newton's law."""
    speed = np.sin(np.linspace(0, math.pi, STEPS + 1))
    speed *= 0.35 / (STEP * speed[1:].sum())
    path = STEP * np.concatenate([[0.0], np.cumsum(speed[1:])])
    acceleration = np.diff(speed) / STEP
    still = np.zeros(STEPS + 1)
    share = 0.6 * (acceleration + 9.81) / 2
    ball = dict.fromkeys(("qx", "qy", "ux", "uy", "wx", "wy", "wz"), still) | {"qz": path, "uz": speed}
    ball |= {n: np.full(STEPS + 1, e) for n, e in zip(ROTATION, rotation_matrix(START).ravel(), strict=True)}
    plans: Plans = {"ball": {f"body.{name}": values for name, values in ball.items()}}
    for name, side in (("left", -1.0), ("right", 1.0)):
        on_robot = [along[2] * -share for along in tangents_across((side, 0.0, 0.0), SCORE.never_normal)]
        robot = {
            "x": still + side * 0.32,
            "y": still,
            "z": path,
            "vx": still,
            "vy": still,
            "vz": speed,
            "tau_x": np.full(STEPS, -side * SQUEEZE),
            "tau_y": still[1:],
            "tau_z": 0.8 * (acceleration + 9.81) + share,
            "c": np.full(STEPS, SQUEEZE),
        }
        for j, force in enumerate(on_robot, start=1):
            robot |= {f"alpha_{j}": np.maximum(force, 0.0), f"alpha_{j + 2}": np.maximum(-force, 0.0)}
        plans[name] = {f"me.{component}": values for component, values in robot.items()}
    return plans


def test_a_plan_made_by_hand_passes() -> None:
    score = SCORE(lifting())
    assert score.misses("strict") == []
    assert score.practical
    products = score.gap_product, score.friction_product, score.separation_product
    assert max(score.object_force, score.object_moment, score.robot_force, *products) < 1e-9
    assert max(score.goal_distance, score.goal_angle, score.gap_at_force, score.simulated_penetration) < 1e-6
    assert score.distance == pytest.approx(0.64)


def friction_flipped(plans: Plans) -> None:
    left = plans["left"]
    for j in (1, 2):
        first, second = f"me.alpha_{j}", f"me.alpha_{j + 2}"
        left[first], left[second] = left[second], left[first]


def ball_turns_by_itself(plans: Plans) -> None:
    for name, entry in zip(ROTATION, rotation_matrix((0.1, -0.2, 0.31)).ravel(), strict=True):
        plans["ball"][f"body.{name}"][5:] = entry


# Faults that look the same in the plane are in test_planar_score: the score is one.
FAULTS = {
    "friction flipped": (friction_flipped, "force missing to the object"),
    "turns by itself": (ball_turns_by_itself, "friction that does not oppose slip"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_found(name: str) -> None:
    fault, found = FAULTS[name]
    plans = copy.deepcopy(lifting())
    fault(plans)
    score = SCORE(plans)
    assert not score.practical
    assert any(found in miss for miss in score.misses("strict")), str(score)


def test_a_robot_has_a_limit_along_each_axis() -> None:
    weak = replace(QUAD, force_limit=((-8.5, 8.5), (-10, 10), (0, 20)))
    (miss,) = replace(SCORE, robot=weak)(lifting()).misses("strict")
    assert miss.startswith("driving force beyond its limit (-): 0.5 N")


def test_of_copies_only_their_mean_is_the_object() -> None:
    plans = lifting()
    ball = plans.pop("ball")
    for name, off in (("left", 0.02), ("right", -0.02)):
        plans[name] |= {key: values + off * (key == "body.qy") for key, values in ball.items()}
        turned = rotation_matrix((0, 0, off)) @ rotation_matrix(START)
        plans[name] |= {f"body.{n}": np.full(STEPS + 1, e) for n, e in zip(ROTATION, turned.ravel(), strict=True)}
    assert SCORE(plans).strict


def test_the_goal_may_be_a_region_or_leave_the_rotation_out() -> None:
    plans = lifting()
    score = spatial.Score(BALL, QUAD, 0.7, STEP, goal=(None, (-1, 1), 0.5, None, None, None))(plans)
    assert score.goal_distance == pytest.approx(0.15)
    assert score.goal_angle == 0.0
    turned = spatial.Score(BALL, QUAD, 0.7, STEP, goal=(0, 0, 0.35, 0.1, -0.2, 0.3 + math.radians(3)))(plans)
    assert turned.goal_angle == pytest.approx(3.0, abs=0.1)


vectors = st.tuples(*3 * [st.floats(-2, 2)])


REST = (0.0, 0.0, 0.0)


@settings(max_examples=25)
@given(turn=vectors, spin=vectors, moment=vectors, velocity=vectors)
@example(turn=(0.0, 1.96, 0.0), spin=(0.64, 1e-207, 0.0), moment=REST, velocity=REST)
def test_every_step_of_the_simulation_meets_the_laws_of_motion(
    turn: Any, spin: Any, moment: Any, velocity: Any
) -> None:
    """Of a body with three different moments: nothing is missing to the path that it takes under a wrench."""
    box = spatial.RigidBody(spatial.RoundedBox(0.05, 0.3, 0.2, 0.1), mass=2.0, inertia=(0.05, 0.1, 0.12))
    score = spatial.Score(box, QUAD, friction=0.7, step=STEP, goal=(None,) * 6)
    wrench = np.tile([1.0, -2.0, 19.0, *(0.05 * m for m in moment)], (5, 1))
    start = PlannedBody(np.zeros((1, 3)), rotation_matrix(turn)[None], np.array([*velocity, *spin]))
    moved = score.simulate(start, wrench)
    identity = moved.rotation.transpose(0, 2, 1) @ moved.rotation
    assert np.abs(identity - np.eye(3)).max() < 1e-12
    twist = moved.twist(STEP)
    needed = score._needed_wrench(moved.rotation[1:], twist[1:], np.diff(twist, axis=0) / STEP)
    assert np.abs(needed - wrench).max() < 1e-8


def test_what_is_read_is_said_and_drawn() -> None:
    plans = lifting()
    assert set(SCORE.robot_components) == set(plans["left"])
    assert set(SCORE.hub_components) == set(plans["ball"])
    time, planned = SCORE.paths(plans)
    assert time[-1] == pytest.approx(STEP * STEPS)
    assert [body.name for body in planned] == ["", "left", "right"]
    np.testing.assert_allclose(planned[0].translation[:, 2], plans["ball"]["body.qz"])
