"""Mistakes in rules: each is answered by name, with what to write instead; nothing is left behind."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

POSES: dict[str, tuple[Any, list[str]]] = {
    "np.cos of a state": (lambda b, t: rcp.planar_pose(np.cos(b.theta[t]), 0), ["np.cos", "pyo.cos"]),
    "one argument too few": (lambda t: rcp.planar_pose(t, 0), ["rule(b, t)", "lambda b, t", "phase 'move'"]),
    "no index": (lambda b, t: rcp.planar_pose(b.x, b.y[t]), ["index missing", "[t]"]),
    "a tuple": (lambda b, t: (b.x[t], b.y[t], b.theta[t]), ["a tuple", "planar_pose"]),
    "no return": (lambda b, t: None, ["return statement", "planar_pose"]),
    "planar_pose itself": (rcp.planar_pose, ["first argument", "b.x[t]"]),
    "a name that does not exist": (lambda b, t: rcp.planar_pose(b.X[t], 0), ["'X'", "phase 'move'", "first argument"]),
    "the value of a state": (lambda b, t: rcp.planar_pose(pyo.value(b.x[t]), 0), ["pyo.value"]),
    "a pose in space": (lambda b, t: rcp.spatial_pose((b.x[t], b.y[t], 0)), ["dimension"]),
}


def says(words: list[str], state: Callable[[], Any]) -> None:
    with pytest.raises(ModelError) as caught:
        state()
    for word in words:
        assert word in str(caught.value), (word, str(caught.value))


@pytest.mark.parametrize("slip", POSES)
def test_in_a_pose_rule(slip: str) -> None:
    pose, words = POSES[slip]
    m = turning_move(elements=2)

    def in_a_scene() -> None:
        m.move.avoid = rcp.ObstacleAvoidanceBlock(
            m.move.time, bodies={"arrow": rcp.Body(ARROW, pose)}, obstacles={"wall": WALL}, clearance=0.05
        )

    def inside() -> None:
        m.move.avoid = rcp.Containment(m.move.time, body=ARROW, pose=pose, region=rcp.Polytope.box(9, 9))

    says(["'arrow'", *words], in_a_scene)
    says(words, inside)
    assert m.move.component("avoid") is None


def test_a_block_on_the_model_instead_of_the_phase() -> None:
    m = turning_move(elements=2)

    def pose(b: Any, t: Any) -> Any:
        return rcp.planar_pose(b.x[t], b.y[t])

    def in_a_scene() -> None:
        m.avoid = rcp.ObstacleAvoidanceBlock(
            m.move.time, body=ARROW, pose=pose, obstacles={"wall": WALL}, clearance=0.05
        )

    def inside() -> None:
        m.inside = rcp.Containment(m.move.time, body=ARROW, pose=pose, region=rcp.Polytope.box(9, 9))

    for state in (in_a_scene, inside):
        says(["model 'turning move'", "first argument", "'move' has it", "b.move.x[t]"], state)
