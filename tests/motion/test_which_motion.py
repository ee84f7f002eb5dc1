"""The report is about a motion, and says which one: polynomials, lines between points, or the user's own formula."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, distances_by_shapely, on_a_phase, on_points, placed
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of, verify_clearance

CAR = Polytope.box(0.4, 0.2)


def stepping_car(turns: tuple[float, ...], step: float = 0.5, speed: float = 1.0) -> pyo.ConcreteModel:
    """A car that drives arcs: the midpoint rule with the heading in the middle, exact along each chord direction."""
    m = pyo.ConcreteModel()
    count = len(turns)
    m.t = pyo.RangeSet(0, count)
    m.steps = pyo.RangeSet(0, count - 1)
    m.x, m.y, m.theta = (pyo.Var(m.t, initialize=0.0) for _ in range(3))
    m.turn = pyo.Var(m.steps, initialize=dict(enumerate(turns)))
    m.speed, m.step = pyo.Param(initialize=speed, mutable=True), step
    for t in m.steps:
        after = driven(m, t, 1.0)
        m.theta[t + 1] = pyo.value(m.theta[t] + step * m.turn[t])
        m.x[t + 1], m.y[t + 1] = map(pyo.value, after.translation)
    return m


def driven(m: Any, t: Any, fraction: Any) -> Any:
    """The midpoint rule over a part of a step."""
    part = fraction * m.step
    middle = m.theta[t] + 0.5 * part * m.turn[t]
    return planar_pose(
        m.x[t] + part * m.speed * pyo.cos(middle),
        m.y[t] + part * m.speed * pyo.sin(middle),
        m.theta[t] + part * m.turn[t],
    )


def sampled_clearance(m: Any, obstacle: Polytope, count: int = 400) -> float:
    poses = []
    for t in m.steps:
        for fraction in np.linspace(0, 1, count):
            rotation, (x, y) = driven(m, t, float(fraction)).numbers()
            poses.append([x, y, math.atan2(rotation[1, 0], rotation[0, 0])])
    corners = placed(CAR.vertices, np.array(poses))
    return float(distances_by_shapely(corners, np.broadcast_to(obstacle.vertices, (len(corners), 4, 2))).min())


def proven(m: Any, obstacle: Polytope, formula: Any, clearance: float = 0.03) -> Any:
    bodies = {"car": Body(CAR, by_states, formula), "post": Body(obstacle)}
    return verify_clearance(motion_of(m.t, m), bodies, {("car", "post"): clearance})


@pytest.mark.parametrize("turns", [(1.5, 1.5, -2.0), (0.5, 3.0, 0.0), (2.0, 0.0, 2.0)], ids=str)
def test_the_proof_follows_the_users_own_steps(turns: tuple[float, ...]) -> None:
    m = stepping_car(turns)
    post = Polytope.box(0.1, 0.1, center=(0.5, 0.9))
    truth = sampled_clearance(m, post)
    report = proven(m, post, driven, clearance=truth)
    assert report.safe
    assert report.body_pairs[0].distance == pytest.approx(truth, rel=2e-3)
    too_much = proven(m, post, driven, clearance=1.05 * truth)
    assert not too_much.safe
    assert str(report).splitlines()[0].endswith("the formula between_points of 'car'")
    assert not report.motion_is_assumed


def test_lines_between_points_are_another_motion_and_said_to_be_assumed() -> None:
    m = stepping_car((3.0, 3.0))
    lines, arcs = (proven(m, Polytope.box(0.1, 0.1, center=(0.4, 0.45)), formula) for formula in (None, driven))
    assert abs(lines.body_pairs[0].distance - arcs.body_pairs[0].distance) > 0.01
    assert lines.motion_is_assumed
    assert "straight lines between the points, which is assumed" in str(lines).splitlines()[0]


def test_a_formula_may_be_built_differently_from_interval_to_interval() -> None:
    m = stepping_car((1.0, -1.0, 2.0))

    def formula(m: Any, t: Any, fraction: Any) -> Any:
        if t != 1:
            return driven(m, t, fraction)
        part = fraction * m.step  # the same, written in another way
        angle = m.theta[t] + part * m.turn[t] / 2
        x, y = m.x[t] + m.speed * pyo.cos(angle) * part, pyo.sin(angle) * m.speed * part + m.y[t]
        return planar_pose(x, y, part * m.turn[t] + m.theta[t])

    post = Polytope.box(0.1, 0.1, center=(0.7, 0.4))
    one, other = proven(m, post, driven), proven(m, post, formula)
    np.testing.assert_allclose(one.body_pairs[0].interval_proven, other.body_pairs[0].interval_proven, rtol=1e-9)


def test_a_formula_that_does_not_meet_the_next_point_proves_nothing() -> None:
    m = stepping_car((1.0, -1.0))
    m.x[2] = m.x[2].value + 0.1
    report = proven(m, Polytope.box(1, 1, center=(9, 9)), driven)
    assert not report.safe
    assert report.body_pairs[0].undecided == (1,)


@pytest.mark.parametrize(
    ("formula", "match"),
    [
        (lambda m, t: planar_pose(0, 0), "rule\\(block, t, fraction\\)"),
        (lambda m, t, s: planar_pose(math.cos(s), 0), "pyo.cos instead of math.cos"),
        (lambda m, t, s: (m.x[t], 0), "expected a Pose in 2"),
        (lambda m, t, s: planar_pose(m.loose * s, 0), "'loose', which has no value"),
    ],
)
def test_formulas_that_are_none(formula: Any, match: str) -> None:
    m = stepping_car((1.0, 1.0))
    m.loose = pyo.Var()
    with pytest.raises(ObstacleError, match=match) as caught:
        proven(m, Polytope.box(1, 1, center=(9, 9)), formula)
    assert "'car'" in str(caught.value)


def test_phases_need_no_formula() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=2, duration=1.0)
    with pytest.raises(ObstacleError, match="'car' has between_points=.*polynomials of the states of phase 'move'"):
        m.move.avoid = rcp.ObstacleAvoidanceBlock(
            m.move.time,
            bodies={"car": Body(CAR, by_states, lambda b, t, s: by_states(b, t))},
            obstacles={"post": Polytope.box(1, 1, center=(5, 5))},
            clearance=0.1,
        )
    assert m.move.component("avoid") is None


# ---------------------------------------------------------------------------------------------- what a report says


def discretised(transformation: str, **options: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=0.0)
    m.dxdt = DerivativeVar(m.x, wrt=m.t)
    m.speed = pyo.Constraint(m.t, rule=lambda m, t: m.dxdt[t] == 1)
    pyo.TransformationFactory(transformation).apply_to(m, **options)
    return m


def along(b: Any, t: Any) -> Any:
    return planar_pose(b.x[t], 0)


FAR = [Polytope.box(1, 1, center=(90, 90))]


@pytest.mark.parametrize(
    ("transformation", "options", "words", "assumed"),
    [
        ("dae.finite_difference", {"nfe": 4}, "straight lines between the points of 't'.*assumed", True),
        ("dae.collocation", {"nfe": 2, "ncp": 2}, "polynomials of the states along 't'", False),
        ("pyrobocop.collocation", {"nfe": 2}, "polynomials of the states along 't'", False),
    ],
)
def test_reports_say_which_motion_along_continuous_sets(
    transformation: str, options: dict[str, Any], words: str, assumed: bool
) -> None:
    m = discretised(transformation, **options)
    report = check(m, CAR, FAR, 0.1, pose=along)
    assert report.motion_is_assumed is assumed
    assert re.search(words, str(report).splitlines()[0])


def test_reports_say_which_motion_of_phases_and_of_points_without_order() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=2, duration=1.0)
    moving = check(m, CAR, FAR, 0.1, points=m.move.time, pose=lambda m, t: by_states(m.move, t))
    assert "polynomials of the states of phase 'move'" in str(moving).splitlines()[0]
    assert not moving.motion_is_assumed
    m = on_points([(0, 0, 0), (1, 0, 0)])
    m.names = pyo.Set(initialize=["a", "b"])
    m.z = pyo.Var(m.names, initialize=0.0)
    still = check(m, CAR, FAR, 0.1, points=m.names, pose=lambda m, t: planar_pose(m.z[t], 0))
    assert "the points alone" in str(still).splitlines()[0]


# ------------------------------------------------------------------------------------------- numbers in place of sets


def test_a_list_of_members_hides_how_states_move() -> None:
    m = discretised("pyrobocop.collocation", nfe=3)
    with pytest.raises(ObstacleError, match="'x.t.' is indexed by 't'.*Give 't' itself"):
        check(m, CAR, FAR, 0.1, points=list(m.t), pose=along)


def test_a_list_of_members_is_refused_when_the_block_is_added() -> None:
    m = discretised("dae.finite_difference", nfe=3)
    m.robot = pyo.Block()
    m.robot.x = pyo.Reference(m.x)
    for block, pose in ((m, along), (m.robot, along)):
        with pytest.raises(ObstacleError, match="'x.t.'.*Give 't' itself" if block is m else "Give 't' itself"):
            block.avoid = rcp.ObstacleAvoidanceBlock(
                list(m.t), body=CAR, pose=pose, obstacles={"far": FAR[0]}, clearance=0.1
            )
        assert block.component("avoid") is None
        with pytest.raises(ObstacleError, match="Give 't' itself"):
            block.inside = rcp.Containment(list(m.t), body=CAR, pose=pose, region=Polytope.box(9, 9))


def test_variables_over_the_times_of_a_phase_at_plain_numbers() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=2, duration=1.0)
    m.shift = pyo.Var(m.move.time, initialize=0.0)
    with pytest.raises(ObstacleError, match="'shift.t.' is indexed by 'move.time'"):
        check(m, CAR, FAR, 0.1, points=list(m.move.time), pose=lambda m, t: planar_pose(m.shift[t], 0))
