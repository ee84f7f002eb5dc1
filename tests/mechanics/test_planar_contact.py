"""Laws of smooth gaps, of friction in the plane, and of what phases state of bodies, robots and contact."""

import math
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, ObstacleError

planar = rcp.mechanics.planar
GRID: dict[str, Any] = {"duration": 0.4, "elements": 4, "scheme": "implicit_euler"}
PUCK = planar.RigidBody(planar.Disc(0.1), mass=1.0, inertia=0.005)
ROBOT = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=10.0, speed_limit=3.0)


def test_impossible_shapes_are_refused() -> None:
    for make, lengths in (
        (planar.Disc, {"radius": -0.1}),
        (planar.Capsule, {"radius": 0.1, "half_length": 0.0}),
        (planar.RoundedBox, {"radius": 0.1, "half_length": 1.0, "half_width": math.nan}),
    ):
        with pytest.raises(ObstacleError, match="expected a positive length"):
            make(**lengths)


# ----------------------------------------------------------------- wrench and friction


@given(mass=st.floats(0.1, 10), twist=st.tuples(*3 * [st.floats(-3, 3)]))
def test_ground_friction_opposes_motion_with_its_weight_but_for_the_slowest(mass: float, twist: tuple) -> None:
    friction = planar.GroundFriction(coefficient=0.2, lever=0.25, slip_speed=0.04)
    *velocity, spin = twist
    weight = 0.2 * mass * 9.81
    force = [-weight * speed / math.hypot(*velocity, 0.04) for speed in velocity]
    moment = -weight * 0.25**2 * spin / math.hypot(0.25 * spin, 0.04)
    assert friction.wrench(mass, *twist) == pytest.approx((*force, moment))


# ----------------------------------------------------------------- what phases state


def pushing(friction: float = 0.5) -> pyo.ConcreteModel:
    """A robot that touches a puck from the left; both start at rest."""
    m = pyo.ConcreteModel()
    m.push = rcp.PhaseBlock(rule=PUCK.state_wrench, **GRID)
    m.body = rcp.PhaseBlock(**GRID)
    PUCK.state_motion(m.body, [m.push], start=(0.0, 0.0, 0.0))
    m.me = rcp.PhaseBlock(**GRID)
    ROBOT.state_motion(m.me, m.push, start=(-0.2, 0.0), rest_at_end=False)
    planar.Contact(PUCK.shape, ROBOT.shape, friction=friction).state(m.me, m.body, m.push)
    return m


# ----------------------------------------------------------------- what is refused


def test_a_start_inside_the_body_is_refused() -> None:
    m = pushing()
    m.other, m.inside = rcp.PhaseBlock(**GRID), rcp.PhaseBlock(**GRID)
    PUCK.state_wrench(m.other)
    ROBOT.state_motion(m.inside, m.other, start=(-0.15, 0.0))
    before = list(m.inside.component_map())
    contact = planar.Contact(PUCK.shape, ROBOT.shape, friction=0.5)
    with pytest.raises(ModelError, match=r"'inside': the robot starts at \(-0.15, 0\), 0.05 m inside the body"):
        contact.state(m.inside, m.body, m.other)
    assert list(m.inside.component_map()) == before
    m.inside.x[0].fix(-0.195)  # within what may be measured
    contact.state(m.inside, m.body, m.other)


def test_what_cannot_be_is_refused_before_anything_is_stated() -> None:
    m = pushing()
    with pytest.raises(ModelError, match="'qx' is there already"):
        PUCK.state_copy(m.body, start=(0.0, 0.0, 0.0))
    with pytest.raises(ModelError, match="'c' is there already"):
        planar.Contact(PUCK.shape, ROBOT.shape, friction=0.5).state(m.me, m.body, m.push)
    m.other = rcp.PhaseBlock(**{**GRID, "elements": 5})
    PUCK.state_wrench(m.other)
    m.late = rcp.PhaseBlock(**GRID)
    before = list(m.late.component_map())
    with pytest.raises(ModelError, match="different grids, 4 and 5 collocation points"):
        ROBOT.state_motion(m.late, m.other, start=(0.0, 0.0))
    with pytest.raises(ModelError, match="is to read 'fx' of phase 'body'"):
        ROBOT.state_motion(m.late, m.body, start=(0.0, 0.0))
    with pytest.raises(ModelError, match="is to read 'x' of phase 'late'"):
        planar.Contact(PUCK.shape, ROBOT.shape, friction=0.5).state(m.late, m.body, m.push)
    assert list(m.late.component_map()) == before


# --------------------------------------------------------------------
# Laws of quasi-static pushing.


SLIDER = rcp.mechanics.SquareSlider()
angles = st.floats(-math.pi, math.pi)
COMPLIANCE = (SLIDER.table_friction * SLIDER.mass * SLIDER.gravity) ** -2
places = st.tuples(st.floats(-0.045, 0.045), st.floats(-0.045, 0.045))
forces = st.tuples(st.floats(-2, 2), st.floats(-2, 2))


def close(expected: Any) -> Any:
    return pytest.approx(expected, abs=1e-11)


def test_the_mean_distance_is_the_mean_distance() -> None:
    n = 400
    middles = [(2 * i + 1 - n) / n * SLIDER.half_side for i in range(n)]
    mean = sum(math.hypot(x, y) for x in middles for y in middles) / n**2
    assert SLIDER.mean_distance == pytest.approx(mean, rel=1e-5)
    assert rcp.mechanics.SquareSlider(half_side=0.09).mean_distance == pytest.approx(2 * SLIDER.mean_distance)


@given(theta=angles, contact=places, force=forces)
def test_numbers_and_pyomo_expressions_agree(theta: float, contact: tuple, force: tuple) -> None:
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(5), initialize=dict(enumerate((theta, *contact, *force))))
    expressions = SLIDER.velocity(m.v[0], (m.v[1], m.v[2]), (m.v[3], m.v[4]))
    assert all(expression.is_potentially_variable() for expression in expressions)
    assert [pyo.value(e) for e in expressions] == close(SLIDER.velocity(theta, contact, force))


@given(theta=angles, force=forces, reach=st.floats(-0.05, 0.05))
def test_a_push_through_the_centre_moves_along_the_force_and_does_not_rotate(
    theta: float, force: tuple, reach: float
) -> None:
    v_x, v_y, omega = SLIDER.velocity(theta, (reach * force[0], reach * force[1]), force)
    assert omega == close(0)
    world = rotated(force, theta)
    assert (v_x, v_y) == close((COMPLIANCE * world[0], COMPLIANCE * world[1]))


def rotated(vector: tuple, by: float) -> tuple:
    c, s = math.cos(by), math.sin(by)
    return (c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])


@given(theta=angles, contact=places, force=forces)
def test_a_push_never_takes_energy_out(theta: float, contact: tuple, force: tuple) -> None:
    v_x, v_y, omega = SLIDER.velocity(theta, contact, force)
    world, moment = rotated(force, theta), contact[0] * force[1] - contact[1] * force[0]
    power = world[0] * v_x + world[1] * v_y + moment * omega
    c, r = COMPLIANCE, SLIDER.mean_distance
    assert power == close(c * (force[0] ** 2 + force[1] ** 2) + c / r**2 * moment**2)
    assert power >= -1e-15
