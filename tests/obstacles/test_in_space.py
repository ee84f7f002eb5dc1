"""Separations in space, for rotations by angles and by quaternions."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import solve_once, state_point
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError

# Not symmetric in any axis.
WEDGE = rcp.Polytope.from_vertices([(0, 0, 0), (0.8, 0, 0), (0, 0.5, 0.1), (0.1, 0.1, 0.4)])
FRAME = [rcp.Polytope.box(1, 1, 1, center=(2, 0, 0)), rcp.Polytope.capsule((0, 2, 0), (1, 2, 1), 0.2)]
NUMBER = st.floats(-3, 3)
MODELS = {}


def by_angles(m, t):
    return rcp.spatial_pose([m.p[k, t] for k in range(3)], euler=[m.a[k, t] for k in range(3)])


def by_quaternion(m, t):
    return rcp.spatial_pose([m.p[k, t] for k in range(3)], quaternion=[m.q[k, t] for k in range(4)])


def flying(pose, between):
    key = (pose, between)
    if key not in MODELS:
        m = pyo.ConcreteModel()
        m.p = pyo.Var(range(3), [0, 1], initialize=0)
        m.a = pyo.Var(range(3), [0, 1], initialize=0)
        m.q = pyo.Var(range(4), [0, 1], initialize=0.5)
        m.length = pyo.Constraint([0, 1], rule=lambda m, t: sum(m.q[k, t] ** 2 for k in range(4)) == 1)
        m.avoid = rcp.ObstacleAvoidanceBlock(
            [0, 1], body=WEDGE, pose=pose, obstacles=FRAME, clearance=0.1, between=between
        )
        MODELS[key] = m
    return MODELS[key]


@settings(max_examples=40)
@given(
    numbers=st.lists(NUMBER, min_size=14, max_size=14),
    pose=st.sampled_from([by_angles, by_quaternion]),
)
def test_started_separations_prove_the_distance_in_space(numbers, pose):
    m = flying(pose, None)
    numbers = np.array(numbers).reshape(2, 7)
    for t in (0, 1):
        for k in range(3):
            m.p[k, t].set_value(numbers[t, k])
            m.a[k, t].set_value(numbers[t, 3 + k])
        quaternion = numbers[t, 3:] + np.array([4.0, 0, 0, 0])
        for k, entry in enumerate(quaternion / np.linalg.norm(quaternion)):
            m.q[k, t].set_value(entry)
    m.avoid.initialize()
    for (_, name, t), proven in m.avoid.separation_gaps().items():
        shape = dict(zip(("obstacle 1", "obstacle 2"), FRAME, strict=True))[name]
        distance = rcp.scenes.signed_distance(WEDGE, shape, pose(m, t)).distance
        assert proven <= distance + 1e-8
        if distance > 1e-3:
            assert proven == pytest.approx(distance, abs=1e-7)
            rows = m.avoid.component_data_objects(pyo.Constraint)
            assert distance < 0.2 or all(
                (row.lb is None or pyo.value(row.body) >= row.lb - 1e-7)
                and (row.ub is None or pyo.value(row.body) <= row.ub + 1e-7)
                for row in rows
                if row.index()[1:3] == (name, t)
            )


@pytest.mark.executable
@pytest.mark.parametrize("between", ["plane", None])
def test_the_nearest_place_beside_a_box_is_at_the_clearance(between):
    m = flying(by_angles, between).clone()
    m.length.deactivate()
    m.a.fix(0.3)
    for t in (0, 1):
        for k, start in enumerate((2.0, 0.3, 1.5)):
            m.p[k, t].set_value(start)
    m.avoid.initialize()
    # Towards the middle of the box.
    m.near = pyo.Objective(expr=sum((m.p[0, t] - 2) ** 2 + m.p[1, t] ** 2 + m.p[2, t] ** 2 for t in (0, 1)))
    solve_once(m)
    for t in (0, 1):
        assert rcp.scenes.signed_distance(WEDGE, FRAME[0], by_angles(m, t)).distance == pytest.approx(0.1, abs=1e-6)


# --------------------------------------------------------------------
# Two robots, each with a phase of its own: bodies that move at the same time, and what is refused.


BOX = rcp.Polytope.box(0.5, 0.5)
FREE = rcp.Duration(bounds=(1, 5), initial_guess=2.0)


def two_robots(second: dict[str, Any] | None = None, **first: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    options = {"duration": 2.0, "elements": 4, "stages": 2, **first}
    m.one, m.two = rcp.PhaseBlock(**options), rcp.PhaseBlock(**{**options, **(second or {})})
    for phase, start, end in ((m.one, 0, 4), (m.two, 4, 0)):
        state_point(phase, (start, 0), (end, 0))
        phase.initialize_straight_lines()
    phases = (m.one, m.two)
    m.effort = pyo.Objective(expr=sum(b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2) for b in phases))
    return m


def one(m: Any, t: Any) -> Any:
    return rcp.planar_pose(m.one.x[t], m.one.y[t])


def two(m: Any, t: Any) -> Any:
    return rcp.planar_pose(m.two.x[t], m.two.y[t])


def keep_apart(m: Any, **bodies: Any) -> None:
    rules = bodies or {"one": one, "two": two}
    m.avoid = rcp.ObstacleAvoidanceBlock(
        m.one.time, bodies={name: rcp.Body(BOX, rule) for name, rule in rules.items()}, clearance=0.1
    )


@pytest.mark.ipopt
def test_two_robots_that_change_places_pass_each_other() -> None:
    m = two_robots()
    keep_apart(m)
    m.avoid.initialize(directions={("one", "two"): (0, 1)})
    result = rcp.solve(m)
    assert result.safe
    first, second = m.one.trajectory(), m.two.trajectory()
    for t in np.linspace(0, 2, 81).tolist():
        poses = [rcp.planar_pose(float(path(t)["x"]), float(path(t)["y"])) for path in (first, second)]
        assert rcp.scenes.signed_distance(BOX, BOX, *poses).distance > 0.098


def test_a_pose_may_read_both_phases() -> None:
    m = two_robots()
    keep_apart(m, one=one, middle=lambda m, t: rcp.planar_pose(0.5 * m.one.x[t] + 0.5 * m.two.x[t], 3 + m.two.y[t]))
    assert "the states of phases 'one', 'two' (radau(2))" in m.avoid.verify().motion
    assert m.avoid.verify().worst.proven > 2.4  # of the plan: its controls are no solution yet


@pytest.mark.parametrize("second", [{"elements": 5}, {"start": 1.0}, {"scheme": "gauss"}], ids=str)
def test_phases_with_other_times_are_refused_by_name(second: dict[str, Any]) -> None:
    m = two_robots(second)
    with pytest.raises(ObstacleError, match="'two' are read at the times of phase 'one'.*other points.*same start"):
        keep_apart(m)
    assert m.component("avoid") is None


@pytest.mark.ipopt
def test_free_durations_have_to_be_tied() -> None:
    m = two_robots(duration=FREE)
    keep_apart(m)
    for ask in (m.avoid.verify, lambda: rcp.solve(m)):
        with pytest.raises(ObstacleError, match="nothing says.*one.duration == two.duration"):
            ask()
    m.tie = pyo.Constraint(expr=m.one.duration == m.two.duration)
    assert not m.avoid.verify().safe  # they run into each other, at the same times
    m.tie.deactivate()
    m.other = pyo.Constraint(expr=m.one.duration == 2 * m.two.duration)
    with pytest.raises(ObstacleError, match="nothing says"):
        m.avoid.verify()
