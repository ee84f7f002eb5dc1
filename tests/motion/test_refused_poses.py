"""Poses that cannot be followed between the nodes are refused, with the body's name and a remedy."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, on_a_phase, on_points
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of, verify_clearance

FAR = Polytope.box(1, 1, center=(90, 90))
BOX = Polytope.box(1, 1)


def line() -> pyo.ConcreteModel:
    return on_points([(0, 0, 0), (1, 0, 0), (2, 0, 0)])


def refused(m: Any, pose: Any, match: str, points: Any = None) -> None:
    with pytest.raises(ObstacleError, match=match) as caught:
        check(m, BOX, [FAR], 0.1, points=points, pose=pose)
    assert "'body'" in str(caught.value)


def test_a_rule_may_read_the_model_itself() -> None:
    m = line()
    reports = [
        check(m, BOX, [FAR], 0.1, pose=pose)
        for pose in (lambda b, t: planar_pose(m.x[t], 0), lambda b, t: planar_pose(b.x[t], 0))
    ]
    assert str(reports[0]) == str(reports[1])
    pose = motion_of(m.t, m).pose_at(lambda b, t: planar_pose(m.x[t], 0), 0, 0.5, name="cart")
    assert pyo.value(pose.translation[0]) == pytest.approx(0.5)


REFUSED: dict[str, tuple[Any, str]] = {
    "a dictionary": (lambda b, t: planar_pose({0: 1.0, 1: 2.0, 2: 3.0}[t], 0), "Pyomo's functions"),
    "different at one node": (
        lambda b, t: planar_pose(b.x[t] + (0.5 if isinstance(t, int) and t == 1 else 0.0), 0),
        "Pyomo's functions",
    ),
    "asks about t": (lambda b, t: planar_pose(b.x[t] if t < 0.5 else 0.0, 0), "'if'"),
    "looks back": (lambda b, t: planar_pose(b.x[t - 1], 0), "has no value at t = 0"),
    # Functions without bounds on their curvature.
    "abs": (lambda b, t: planar_pose(abs(0.5 * b.x[t]), 0), "'abs'"),
    "a condition": (lambda b, t: planar_pose(pyo.Expr_if(b.x[t] >= 2, b.x[t], 1), 0), "Expr_if"),
}


@pytest.mark.parametrize("rule", REFUSED)
def test_rules_that_are_no_formula_in_t(rule: str) -> None:
    refused(line(), *REFUSED[rule])


def test_controls_and_algebraics() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=3, duration=1.0)
    refused(
        m, lambda m, t: planar_pose(m.move.v_x[t], 0), r"'move.v_x\[t\]' is no state of phase 'move'", m.move.points
    )


def test_states_over_other_points() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=3, duration=1.0)
    m.t = pyo.Set(initialize=m.move.grid.mesh.boundaries, ordered=True)
    refused(m, lambda m, t: planar_pose(m.move.x[t], 0), "Give 'move.time'")


def test_the_clock_of_another_phase() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=3, duration=1.0)
    m.other = on_a_phase(lambda t: (t, 0, 0), elements=3, duration=2.0)
    refused(m, lambda m, t: planar_pose(m.other.move.time_at(t), 0), "'other.move'.*other points of time", m.move.time)


def test_variables_without_value() -> None:
    m = line()
    m.x[1] = None
    refused(m, by_states, "no value")


def test_a_continuous_set_before_its_discretisation() -> None:
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    with pytest.raises(ObstacleError, match="not discretised by pyrobocop.collocation"):
        motion_of(m.t, m)
    pyo.TransformationFactory("dae.finite_difference").apply_to(m, nfe=2)
    with pytest.raises(ObstacleError, match="not discretised by pyrobocop.collocation"):
        motion_of(m.t, m)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Body([]), "expected a Polytope"),
        (lambda: Body("car"), "expected a Polytope"),
        (lambda: Body([BOX, Polytope.box(1, 1, 1)]), "dimensions"),
        (lambda: Body(BOX, planar_pose(0, 0)), "shape.placed"),
    ],
)
def test_bodies_that_are_none(make: Any, match: str) -> None:
    with pytest.raises(ObstacleError, match=match):
        make()


@pytest.mark.parametrize(
    ("clearances", "options", "match"),
    [
        ({("body", "tree"): 0.1}, {}, "'tree'; the bodies are body, wall"),
        ({("body", "wall"): 0.1}, {"tolerance": 0.1}, "between 0 and the clearance"),
        ({("body", "wall"): 0.1}, {"tolerance": 0.0}, "between 0 and the clearance"),
        ({("body", "cube"): 0.1}, {}, "dimensions"),
    ],
)
def test_pairs_and_tolerances_that_make_no_sense(clearances: Any, options: Any, match: str) -> None:
    m = line()
    bodies = {"body": Body(BOX, by_states), "wall": Body(FAR)}
    if match == "dimensions":
        bodies["cube"] = Body(Polytope.box(1, 1, 1))
    with pytest.raises(ObstacleError, match=match):
        verify_clearance(motion_of(m.t, m), bodies, clearances, **options)
