"""A clearance may be a number, a parameter, a variable, an expression or a rule."""

import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, on_the_line

import pyrobocop_pyomo as rcp

HALF_WIDTH = 0.6
HALF_BODY = 0.2


def half_constant(b: Any, t: Any) -> float:
    return 0.1


def place(b: Any, t: Any) -> Any:
    return rcp.planar_pose(b.x[t], b.y[t])


def between_walls(clearance: Any, elements: int = 4, **options: Any) -> pyo.ConcreteModel:
    """A cart passes between two walls that are 1.2 apart, and starts nearer to the upper one."""
    m = pyo.ConcreteModel()
    m.gap = pyo.Param(initialize=0.1, mutable=True)
    m.room = pyo.Var(bounds=(0.01, None), initialize=0.05)
    m.move = b = rcp.PhaseBlock(duration=2.0, elements=elements)
    b.x, b.y = rcp.State(initial=0, final=4), rcp.State(initial=0.3, final=0.3)
    b.speed = rcp.State(initial=1)
    b.vy, b.a = rcp.Control(bounds=(-3, 3)), rcp.Control(bounds=(-20, 20))
    b.ode(lambda b, t: {b.x: b.speed[t], b.y: b.vy[t], b.speed: b.a[t]})
    b.initialize_straight_lines()
    walls = {"low": rcp.Polytope.box(1, 1, center=(2, -1.1)), "high": rcp.Polytope.box(1, 1, center=(2, 1.1))}
    gap = clearance(m) if callable(clearance) else clearance
    keep_clear(b, rcp.Polytope.box(2 * HALF_BODY, 2 * HALF_BODY), walls, place, gap, **options)
    m.cost = pyo.Expression(expr=b.integral(lambda b, t: b.vy[t] ** 2 + 0.01 * b.a[t] ** 2))
    m.goal = pyo.Objective(expr=m.cost)
    return m


def by_speed(b: Any, t: Any) -> Any:
    return 0.05 + 0.08 * b.speed[t]


GIVEN = {
    "expression": lambda m: m.gap + 0 * m.room,
    "mapping": lambda m: {("body", "low"): m.gap, ("high", "body"): half_constant},
}


@pytest.mark.ipopt
@pytest.mark.parametrize("given", ["expression", "mapping"])
def test_whatever_says_the_same_gives_the_same_plan(given: str) -> None:
    number, other = between_walls(0.1), between_walls(GIVEN[given])
    if given == "expression":
        other.room.fix(1.0)
    results = rcp.solve(number), rcp.solve(other)
    assert results[0].safe
    assert results[1].safe
    assert results[1].objective == pytest.approx(results[0].objective, rel=1e-6)
    assert results[1].safety.worst.clearance == pytest.approx(0.1)


@pytest.mark.ipopt
def test_a_parameter_that_changes_is_kept_by_the_next_solve() -> None:
    m = between_walls(lambda m: m.gap)
    costs = []
    for gap in (0.1, 0.25, 0.3):
        m.gap.set_value(gap)
        result = rcp.solve(m)
        assert result.safe
        assert result.safety.worst.clearance == gap
        assert result.safety.worst.distance >= 0.99 * gap
        costs.append(result.objective)
    assert costs == sorted(costs)
    m.gap.set_value(-0.1)
    with pytest.raises(rcp.errors.ObstacleError, match="the clearance between 'body' and 'low' is -0.1"):
        rcp.solve(m)


@pytest.mark.ipopt
def test_a_clearance_that_grows_with_speed_is_kept_all_along() -> None:
    m = between_walls(lambda m: by_speed)
    result = rcp.solve(m)
    assert result.safe
    path, times = m.move.trajectory(), np.linspace(0.0, 2.0, 801)
    found = path(times)
    x, y, speed = found["x"], found["y"], found["speed"]
    beside = np.maximum(np.abs(x - 2.0) - 0.5 - HALF_BODY, 0.0)
    above = np.maximum(HALF_WIDTH - HALF_BODY - y, 0.0)
    excess = np.hypot(beside, above) - (0.05 + 0.08 * speed)
    pair = result.safety.worst
    assert excess.min() >= -pair.tolerance - 1e-9
    assert excess.min() == pytest.approx(pair.distance - pair.clearance, abs=2e-3)


@pytest.mark.ipopt
def test_the_largest_clearance_between_walls_is_half_of_what_is_free() -> None:
    m = between_walls(lambda m: m.room)
    m.goal.set_value(-m.room + 1e-3 * m.cost)  # of all ways through the middle, a quiet one
    result = rcp.solve(m)
    assert result.safe
    assert m.room.value == pytest.approx(HALF_WIDTH - HALF_BODY, abs=1e-5)
    assert result.safety.worst.proven >= 0.99 * m.room.value


@pytest.mark.parametrize(
    ("clearance", "message"),
    [
        (lambda m: -m.gap, "between 'body' and 'low' is '- gap' = -0.1"),
        (lambda m: lambda b, t: -0.1, "between 'body' and 'low' at t = 0.0 is -0.1"),
        (lambda m: lambda b, t: "wide", "at t = 0.0 is 'wide'; its rule must return a length"),
        (lambda m: lambda b, t: 0.1 + b.vy[t] ** 2, "has no value at t = 0.0"),
    ],
)
def test_what_is_no_clearance_is_refused_by_name(clearance: Any, message: str) -> None:
    m = pyo.ConcreteModel()
    with pytest.raises(rcp.errors.ObstacleError, match=message):
        m = between_walls(clearance)
    assert m.component("move") is None


def test_a_variable_without_value_is_named_before_any_solve() -> None:
    m = between_walls(lambda m: m.room)
    m.room.set_value(None)
    with pytest.raises(rcp.errors.ObstacleError, match="the clearance between 'body' and 'low' has no value"):
        rcp.solve(m)


def test_a_copy_keeps_clearances_of_its_own() -> None:
    m = between_walls(lambda m: m.gap)
    for copied in (m.clone(), pickle.loads(pickle.dumps(m))):
        before = m.move.avoid.verify().worst.clearance
        copied.gap.set_value(0.2)
        assert m.move.avoid.verify().worst.clearance == before
        assert copied.move.avoid.verify().worst.clearance == 0.2


@pytest.mark.ipopt
def test_what_the_equations_change_of_a_clearance_is_taken_off() -> None:
    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(duration=2.0, elements=3, scheme="implicit_euler")
    b.x, b.speed = rcp.State(initial=0, final=2), rcp.State(initial=0, final=0)
    b.a = rcp.Control(bounds=(-10, 10))
    b.ode(lambda b, t: {b.x: b.speed[t], b.speed: b.a[t] - 2.0 * b.speed[t]})
    b.initialize_straight_lines()
    wall = {"wall": rcp.Polytope.box(9, 1, center=(0, 3))}
    keep_clear(b, rcp.Polytope.box(1, 1), wall, on_the_line, lambda b, t: 1.0 + 0.1 * b.speed[t])
    m.goal = pyo.Objective(expr=b.integral(lambda b, t: b.a[t] ** 2))
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    (pair,) = b.avoid.verify().body_pairs
    # The wall is parallel to the motion: the distance is known exactly, what is asked for is not.
    reintegrated = b.reintegrate()
    places, speeds = (
        np.abs(reintegrated.open_loop[name] - reintegrated.planned[name]).max(axis=1) for name in ("x", "speed")
    )
    assert speeds.max() > 0.1
    assert (pair.interval_deviation >= places + 0.1 * speeds).all()
    assert (pair.interval_deviation <= 1.2 * (places + 0.1 * speeds)).all()
