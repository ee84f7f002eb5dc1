"""Two robots, each with a phase of its own: bodies that move at the same time, and what is refused."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import state_point

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError

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


@pytest.mark.parametrize(
    "second",
    [
        {"elements": 5},
        {"duration": 3.0},
        {"start": 1.0},
        {"scheme": "gauss"},
        {"mesh": [0, 0.1, 0.5, 1, 2], "elements": None},
    ],
    ids=lambda options: next(iter(options)),
)
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
