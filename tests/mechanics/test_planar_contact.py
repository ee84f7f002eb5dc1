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
