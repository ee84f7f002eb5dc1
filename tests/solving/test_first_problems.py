"""Problems as somebody states them who has just read the documentation."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi


def test_batch_reactor_with_a_limit_on_the_heat():
    """A -> B -> C: the yield of B is 0.6108 without the limit, and less with it; the limit is met and is active."""
    m = pyo.ConcreteModel(name="batch reactor")
    m.run = b = rcp.PhaseBlock(duration=1.0, elements=8)
    b.a, b.b = rcp.State(initial=1, bounds=(0, 1)), rcp.State(initial=0, bounds=(0, 1))
    b.temperature = rcp.Control(bounds=(298, 398), initial_guess=340, parametrization="piecewise_linear")

    def first_rate(b, t):
        return 4000 * pyo.exp(-2500 / b.temperature[t]) * b.a[t] ** 2

    @b.ode
    def kinetics(b, t):
        second = 620000 * pyo.exp(-5000 / b.temperature[t]) * b.b[t]
        return {b.a: -first_rate(b, t), b.b: first_rate(b, t) - second}

    @b.constraint
    def heat(b, t):
        return first_rate(b, t) <= 1.5

    m.product = pyo.Objective(expr=b.b[b.time.last()], sense=pyo.maximize)
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    assert 0.59 < result.objective < 0.6107
    assert max(pyo.value(row.body) for row in b.heat.values()) == pytest.approx(1.5, abs=1e-6)


def test_mass_that_falls_and_is_thrown_back():
    """The floor gives back 0.8 of the speed; the rest that it takes to rise as high again is 0.2 sqrt(2 g h)."""
    m = pyo.ConcreteModel(name="thrown back")
    m.fall = a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 2)), elements=2)
    a.height, a.speed = rcp.State(initial=1, final=0), rcp.State(initial=0)
    m.rise = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 2)), elements=2)
    b.height, b.speed = rcp.State(initial=0, final=1), rcp.State(final=0)
    b.push = rcp.Parameter(bounds=(0, 10))
    for phase in (a, b):
        phase.ode(lambda b, t: {b.height: b.speed[t], b.speed: -9.81})
    m.impact = rcp.Link(a, b, jump=lambda pre, post: {"speed": -0.8 * pre.speed + post.push})
    m.effort = pyo.Objective(expr=b.push**2)
    rcp.solve(m, progress=False).raise_for_status()
    assert b.push.value == pytest.approx(0.2 * (2 * 9.81) ** 0.5, abs=1e-6)
    assert b.duration.value == pytest.approx((2 / 9.81) ** 0.5, abs=1e-6)


def test_state_that_passes_its_bound_between_the_points_is_named():
    """A hop with the best apex: the squat ends between two points, so that the plan is better than any true one."""
    m = pyo.ConcreteModel(name="hop")
    m.stance = a = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.05, 1)), elements=10)
    a.height = rcp.State(initial=0.6, bounds=(0.4, 1.0), final=1.0)
    a.speed = rcp.State(initial=0)
    a.push = rcp.Control(bounds=(0, 30), parametrization="piecewise_constant")
    a.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.push[t] - 9.81})
    m.flight = f = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.05, 2)), elements=2)
    f.height, f.speed = rcp.State(), rcp.State(final=0)
    f.ode(lambda b, t: {b.height: b.speed[t], b.speed: -9.81})
    m.lift_off = rcp.Link(a, f)
    m.apex = pyo.Objective(expr=f.height[f.final_time], sense=pyo.maximize)
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    # The fall ends where full thrust just stops it at 0.4; from there on the thrust does work up to the height 1.
    turn = (9.81 * 0.6 + (30 - 9.81) * 0.4) / 30
    best = 0.6 + 30 * (1 - turn) / 9.81
    passed = a.trajectory().verify().bounds_passed
    assert set(passed) == {"height"}
    assert 0 < result.objective - best < 30 / 9.81 * passed["height"].excess
    assert "'height' passes its bound 0.4" in str(result)
    assert "'height' passes its bound 0.4" in str(a.trajectory().verify())
    assert not f.trajectory().verify().bounds_passed


def test_control_that_jumps_and_passes_its_bound_between_the_points_is_named():
    def rest_to_rest(parametrization):
        m = pyo.ConcreteModel(name="rest to rest")
        m.p = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 9), initial_guess=2), elements=7)
        b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
        b.u = rcp.Control(bounds=(-1, 1), parametrization=parametrization)
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
        m.time = pyo.Objective(expr=b.duration)
        result = rcp.solve(m, progress=False, mesh_tolerance=None, exploration=0)
        result.raise_for_status()
        return b.trajectory().verify().bounds_passed, str(result)

    passed, text = rest_to_rest("collocated")
    assert passed["u"].excess > 0.01
    assert "'u' passes its bound" in text
    assert "parametrization='piecewise_constant' for a control" in text
    passed, text = rest_to_rest("piecewise_constant")
    assert "u" not in passed
    assert "passes its bound" not in text


@pytest.mark.parametrize("elements", [12, 20])
def test_car_among_three_boxes_with_a_free_duration(elements):
    """The straight guess collides; the plan keeps the clearance, as sampled corners and edges of the car confirm."""
    m = pyo.ConcreteModel(name="car among boxes")
    m.drive = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 20), initial_guess=6), elements=elements)
    b.x, b.y = rcp.State(initial=0, final=10), rcp.State(initial=0, final=0)
    b.theta = rcp.State(initial=0, final=0, bounds=(-3.2, 3.2))
    b.v = rcp.State(initial=0, final=0, bounds=(-1, 3))
    b.steer = rcp.State(initial=0, bounds=(-0.6, 0.6))
    b.a, b.rate = rcp.Control(bounds=(-2, 2)), rcp.Control(bounds=(-1.5, 1.5))

    @b.ode
    def bicycle(b, t):
        return {
            b.x: b.v[t] * pyo.cos(b.theta[t]),
            b.y: b.v[t] * pyo.sin(b.theta[t]),
            b.theta: b.v[t] * pyo.tan(b.steer[t]) / 2.5,
            b.v: b.a[t],
            b.steer: b.rate[t],
        }

    boxes = {"a": (1.5, 1.5, 3, -0.4), "b": (1.5, 1.5, 6, 1.5), "c": (1, 1, 8, -1.2)}
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={
            "car": rcp.Body(rcp.Polytope.box(1.0, 0.6), pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]))
        },
        obstacles={name: rcp.Polytope.box(w, h, center=(x, y)) for name, (w, h, x, y) in boxes.items()},
        clearance=0.05,
    )
    m.cost = pyo.Objective(expr=b.duration + 0.01 * b.integral(lambda b, t: b.a[t] ** 2 + b.rate[t] ** 2))
    b.initialize_straight_lines()
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    assert result.safe
    assert 10 / 3 + 1 < b.duration.value < 8  # no faster than a straight dash at the top speed

    trajectory = b.trajectory()
    motion = trajectory(np.linspace(0, trajectory.duration, 400))
    edge = np.linspace(-1, 1, 21)
    outline = np.array([(u, s) for u in edge for s in (-1, 1)] + [(s, u) for u in edge for s in (-1, 1)]) * (0.5, 0.3)
    cos, sin = np.cos(motion["theta"])[:, None], np.sin(motion["theta"])[:, None]
    px = motion["x"][:, None] + cos * outline[:, 0] - sin * outline[:, 1]
    py = motion["y"][:, None] + sin * outline[:, 0] + cos * outline[:, 1]
    for w, h, x, y in boxes.values():
        outside = np.hypot(np.maximum(abs(px - x) - w / 2, 0), np.maximum(abs(py - y) - h / 2, 0))
        assert outside.min() > 0.05 - 0.05 * 0.01 - 1e-6  # of the clearance, the proof lets one percent be missing
