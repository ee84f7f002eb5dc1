"""Examples with linked phases, held to what is known about them in closed form."""

from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def test_a_dropped_ball_meets_the_floor_when_it_must() -> None:
    ball = import_module("bouncing_ball")
    m = ball.build("drop", bounces=4, elements=3)
    rcp.solve(m).raise_for_status()
    joined = rcp.join_trajectories(m.flights.values())
    assert joined.boundaries[1:] == pytest.approx(ball.impact_times(4), abs=1e-8)
    assert max(link.violation for link in m.impacts.values()) < 1e-8
    assert joined.x[-1] == pytest.approx(0.5 * joined.duration, abs=1e-8)
    for part in joined.parts:
        assert part.verify().largest_violation < 1e-8
        assert part.verify().horizon_error < 1e-8


@pytest.mark.parametrize("bounces", [1, 5])
def test_the_slowest_throw_is_that_of_the_formula(bounces: int) -> None:
    ball = import_module("bouncing_ball")
    m = ball.build("throw", bounces=bounces)
    rcp.solve(m).raise_for_status()
    assert pyo.value(m.squared_speed) == pytest.approx(ball.smallest_squared_speed(bounces), abs=1e-8)
    assert m.flights[0].v_x[0].value == pytest.approx(m.flights[0].v_y[0].value, rel=1e-5)


def energy(m: pyo.ConcreteModel) -> tuple[float, float]:
    """Of the body, at the end of stance and at the start of flight."""
    pre, post = m.lift_off.pre, m.lift_off.post
    leg = 0.5 * (pre.leg_rate.value**2 + (pre.leg.value * pre.angle_rate.value) ** 2)
    leg += 9.81 * pre.leg.value * np.cos(pre.angle.value)
    return leg, 0.5 * (post.v_x.value**2 + post.v_y.value**2) + 9.81 * post.y.value


@pytest.mark.parametrize("case", ["leap", "gait"])
def test_the_hopper_loses_no_energy_at_lift_off_verifies_and_gets_where_it_is_to(case: str) -> None:
    """The leap is a parabola that ends on the ledge; the gait closes in all but the distance."""
    m = import_module("hopper").build(case)
    rcp.solve(m).raise_for_status()
    assert m.lift_off.violation < 1e-8
    before, after = energy(m)
    assert after == pytest.approx(before, abs=1e-7)
    stance, flight = m.stance.trajectory(), m.flight.trajectory()
    for found in (stance, flight):
        assert found.verify().largest_violation < 1e-7
        assert found.verify().horizon_error < 1e-6
    if case == "leap":
        assert (flight.x[-1], flight.y[-1]) == pytest.approx((0.6, 1.5), abs=1e-9)
        assert flight.duration == pytest.approx(flight.v_y[0] / 9.81, abs=1e-9)
        assert flight.y[-1] - flight.y[0] == pytest.approx(flight.v_y[0] ** 2 / (2 * 9.81), abs=1e-9)
        return
    angle, leg = stance.angle[-1], stance.leg[-1]
    assert leg * np.cos(angle) == pytest.approx(flight.y[0], abs=1e-8)
    assert stance.leg_rate[-1] * np.sin(angle) + leg * stance.angle_rate[-1] * np.cos(angle) == pytest.approx(
        flight.v_x[0], abs=1e-8
    )
    stride = stance.foot + leg * np.sin(angle)
    assert stride == pytest.approx(3.0 * (stance.duration + flight.duration), abs=1e-7)
    assert m.touch_down.violation < 1e-8


def test_without_damping_the_run_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring-loaded pendulum runs by itself: the motor of the periodic gait rests."""
    hopper = import_module("hopper")
    monkeypatch.setattr(hopper, "DAMPING", 0.0)
    m = hopper.build("gait")
    rcp.solve(m).raise_for_status()
    assert pyo.value(m.effort_per_distance) == pytest.approx(0.0, abs=1e-6)
    assert np.abs(m.stance.trajectory().motor).max() < 1e-2


# --------------------------------------------------------------------
# The examples with friction and switches, held to their closed forms.


def test_riding_the_belt_costs_no_more_than_the_best_brake() -> None:
    example = import_module("stick_slip")
    m = example.build("ride")
    result = rcp.solve(m)
    result.raise_for_status()
    assert result.objective == pytest.approx(example.smallest_effort(), rel=1e-3)
    found = m.motion.trajectory()
    sticks = (found.points > 0.6) & (found.points < 2.4)
    assert found(found.points)["v"][sticks] == pytest.approx(example.BELT, abs=1e-5)
    assert np.abs(found.force[sticks]).max() < 1e-2  # riding is free
    assert found.verify().largest_violation < 1e-6
    assert found.verify().horizon_error < 1e-6


# --------------------------------------------------------------------
# Examples around obstacles keep their clearances, checked afresh: densely between the nodes, by another library.


SAMPLES, SLACK = 400, 1e-3  # per interval; metres


def solved(model: pyo.ConcreteModel, safe: bool | None = True) -> rcp.SolveResult:
    result = rcp.solve(model)
    result.raise_for_status()
    assert result.safe is safe
    return result


def sampled(phase: Any, *names: str) -> list[np.ndarray]:
    """Signals at many times within each interval, by the trajectory's own polynomials."""
    trajectory = phase.trajectory()
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    times = np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(boundaries)])
    values = trajectory(times)
    return [values[name] for name in names]


def least_planar_distance(corners: Any, x: Any, y: Any, theta: Any, obstacles: Any) -> float:
    """Of one body from all obstacles, by Shapely; 0 where they touch or overlap."""
    shapely = pytest.importorskip("shapely")
    c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
    u, v = np.asarray(corners, dtype=float).T
    bodies = shapely.polygons(np.stack([x[:, None] + c * u - s * v, y[:, None] + s * u + c * v], axis=-1))
    least = np.inf
    for obstacle in obstacles:
        ends = [obstacle.vertices, *(obstacle.vertices + 1e3 * ray for ray in obstacle.rays)]
        least = min(least, shapely.distance(bodies, shapely.MultiPoint(np.concatenate(ends)).convex_hull).min())
    return least


@pytest.mark.slow
def test_a_pushed_slider_keeps_its_distance_from_the_squares() -> None:
    example, case = import_module("pushing_among_obstacles"), "turned-slot"
    m = example.build(case, elements=52)
    solved(m, safe=None)  # forces at the edge of the friction cone leave the slip under the controls open
    pose = sampled(m.push, "x", "y", "theta")
    half = 0.045
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    assert least_planar_distance(corners, *pose, m.squares) >= 0.02 - SLACK
    assert [signal[-1] for signal in pose] == pytest.approx(example.CASES[case]["goal"], abs=1e-6)


def test_the_small_car_keeps_its_distance() -> None:
    example = import_module("car_between_obstacles")
    m = example.build("one")
    result = solved(m)
    assert result.safety.equations  # of which 50 elements of order one are too few: the mesh got finer
    x, y, heading = sampled(m.drive, "x", "y", "theta")
    squares = [rcp.Polytope.box(1, 1, center=centre) for centre in example.CASES["one"]["centres"]]
    corners = [(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)]
    assert least_planar_distance(corners, x, y, -heading, squares) >= 0.02 - SLACK
    # Published, with a distance kept at the nodes only: 35.254. For the plan alone, in between costs little.
    m = example.build("one")
    m.drive.avoid.equations = False
    of_plan = rcp.solve(m)
    assert of_plan.solved
    assert 35.2 < of_plan.objective < 36
