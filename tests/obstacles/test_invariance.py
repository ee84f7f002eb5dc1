"""A plan does not depend on where the world's axes lie, on the unit of length, or on who is named first."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, solve_once

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.executable


def plan(angle=0.0, shift=(0.0, 0.0), unit=1.0):
    """The same move and wall in a world that is turned, shifted and measured in another unit."""
    world = rcp.planar_pose(*shift, angle)
    rotation, translation = world.numbers()

    def point(x, y):
        return unit * (rotation @ np.array([x, y]) + translation)

    def shape(polytope):
        return rcp.Polytope.from_vertices(unit * polytope.vertices)

    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(duration=1.0, elements=6, stages=2)
    start, end = point(0, 0), point(4, 0)
    guess = [lambda t, k=k: point(4 * t, 6.4 * t * (1 - t))[k] for k in (0, 1)]
    b.x = rcp.State(initial=start[0], final=end[0], initial_guess=guess[0])
    b.y = rcp.State(initial=start[1], final=end[1], initial_guess=guess[1])
    b.theta = rcp.State(initial=angle, final=angle + 0.6, initial_guess=lambda t: angle + 0.6 * t)
    b.u, b.v, b.w = rcp.Control(), rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: unit * b.u[t], b.y: unit * b.v[t], b.theta: b.w[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2 + b.w[t] ** 2))
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"arrow": rcp.Body(shape(ARROW), pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]))},
        obstacles={"wall": rcp.Polytope.from_vertices([point(*corner) for corner in WALL.vertices])},
        clearance=0.05 * unit,
    )
    b.avoid.initialize()
    solve_once(m)
    return pyo.value(m.effort), min(b.avoid.separation_gaps().values()) / unit


@pytest.fixture(scope="module")
def reference():
    return plan()


@pytest.mark.parametrize(
    "world", [{"angle": 2.0, "shift": (3.0, -7.0), "unit": 1000.0}, {"angle": -0.7, "unit": 0.01}], ids=str
)
def test_the_plan_does_not_depend_on_the_world(world, reference):
    effort, gap = plan(**world)
    assert effort == pytest.approx(reference[0], rel=1e-5)
    assert gap == pytest.approx(reference[1], abs=2e-6)


def two_bodies(order, between):
    m = pyo.ConcreteModel()
    m.x = pyo.Var(
        ["a", "b"], range(3), initialize={(n, t): s * (1 + t) for n, s in (("a", 1), ("b", -1)) for t in range(3)}
    )
    shapes = {"a": ARROW, "b": rcp.Polytope.regular_polygon(5, 0.5)}
    poses = {
        "a": lambda m, t: rcp.planar_pose(m.x["a", t], 0.2, 0.3),
        "b": lambda m, t: rcp.planar_pose(m.x["b", t], -0.1, 0.4 + 0.1 * t),
    }
    m.avoid = rcp.ObstacleAvoidanceBlock(
        [0, 1, 2],
        bodies={name: rcp.Body(shapes[name], pose=poses[name]) for name in order},
        clearance=0.1,
        between=between,
    )
    m.avoid.initialize()
    m.near = pyo.Objective(expr=sum((m.x["a", t] - m.x["b", t]) ** 2 + 0.1 * m.x["a", t] ** 2 for t in range(3)))
    solve_once(m)
    return m


@pytest.mark.parametrize("between", ["plane", None])
def test_bodies_may_be_named_in_either_order(between):
    one, other = two_bodies("ab", between), two_bodies("ba", between)
    assert pyo.value(one.near) == pytest.approx(pyo.value(other.near), rel=1e-6)
    forth, back = one.avoid.separation_gaps(), other.avoid.separation_gaps()
    assert {("b", "a", t) for _, _, t in forth} == set(back)
    for (_, _, t), gap in forth.items():
        assert gap == pytest.approx(back["b", "a", t], abs=1e-4)
