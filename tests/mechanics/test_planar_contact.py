"""Laws of smooth gaps, of friction in the plane, and of what phases state of bodies, robots and contact."""

import math
import pickle
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyomo.core.expr.calculus.derivatives import Modes, differentiate

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, ObstacleError

planar = rcp.mechanics.planar
GRID: dict[str, Any] = {"duration": 0.4, "elements": 4, "scheme": "implicit_euler"}
SHAPES = {
    "disc": planar.Disc(0.2),
    "capsule": planar.Capsule(radius=0.05, half_length=0.45),
    "box": planar.RoundedBox(radius=0.05, half_length=0.3, half_width=0.2),
}
PUCK = planar.RigidBody(planar.Disc(0.1), mass=1.0, inertia=0.005)
ROBOT = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=10.0, speed_limit=3.0)

shapes = st.sampled_from(list(SHAPES.values()))
places = st.tuples(st.floats(-2, 2), st.floats(-2, 2))
poses = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-math.pi, math.pi))


def outside(shape: Any, place: tuple, pose: tuple) -> bool:
    """Whether a disc is far enough from the core to be a state of motion."""
    return shape.gap_to_disc(0.1, *place, pose).gap > -0.1


# ----------------------------------------------------------------- gaps


@given(shape=shapes, place=places, pose=poses)
def test_the_smooth_gap_is_the_distance_of_the_shapes(shape: Any, place: tuple, pose: tuple) -> None:
    if not outside(shape, place, pose):
        return
    body = shape.outline().placed(rcp.planar_pose(*pose))
    exact = rcp.scenes.signed_distance(body, rcp.Polytope.ball(0.1, place)).distance
    # Smoothing over a centimetre moves the ends of the core by at most half of that.
    assert shape.gap_to_disc(0.1, *place, pose).gap == pytest.approx(exact, abs=0.0075)


@given(shape=shapes, place=places, pose=poses)
def test_numbers_arrays_and_expressions_agree(shape: Any, place: tuple, pose: tuple) -> None:
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(5), initialize=dict(enumerate((*place, *pose))))
    expressions = shape.gap_to_disc(0.1, m.v[0], m.v[1], (m.v[2], m.v[3], m.v[4]))
    arrays = shape.gap_to_disc(0.1, *(np.full(3, p) for p in place), tuple(np.full(3, q) for q in pose))
    numbers = shape.gap_to_disc(0.1, *place, pose)
    entries, values, rows = ([at.gap, *at.normal, *at.point] for at in (expressions, numbers, arrays))
    assert [pyo.value(e) for e in entries] == pytest.approx(values, abs=1e-12)
    for row, number in zip(rows, values, strict=True):
        assert row == pytest.approx(np.full(3, number), abs=1e-12)


@given(shape=shapes, place=places, pose=poses)
def test_the_normal_is_the_gradient_of_the_gap(shape: Any, place: tuple, pose: tuple) -> None:
    """Away from the ends of the core, where smoothing lets the nearest point lag."""
    if not outside(shape, place, pose):
        return
    c, s = math.cos(pose[2]), math.sin(pose[2])
    d_x, d_y = place[0] - pose[0], place[1] - pose[1]
    local = (c * d_x + s * d_y, c * d_y - s * d_x)
    sides = [getattr(shape, side, None) for side in ("half_length", "half_width")]
    if any(side is not None and abs(abs(z) - side) < 0.1 for z, side in zip(local, sides, strict=True)):
        return
    h = 1e-6
    at = shape.gap_to_disc(0.1, *place, pose)
    slope_x = (
        shape.gap_to_disc(0.1, place[0] + h, place[1], pose).gap
        - shape.gap_to_disc(0.1, place[0] - h, place[1], pose).gap
    ) / (2 * h)
    slope_y = (
        shape.gap_to_disc(0.1, place[0], place[1] + h, pose).gap
        - shape.gap_to_disc(0.1, place[0], place[1] - h, pose).gap
    ) / (2 * h)
    assert at.normal == pytest.approx([slope_x, slope_y], abs=6e-3)
    assert math.hypot(*at.normal) == pytest.approx(1.0, abs=1e-3)
    # The contact point lies on the surface, and the disc's centre further along the normal.
    to_disc = np.array(pose[:2]) + at.point + np.multiply(at.normal, at.gap + 0.1)
    assert to_disc == pytest.approx(place, abs=1e-4)


@given(shape=shapes, place=places, pose=poses)
def test_the_gap_is_differentiable_with_exact_derivatives(shape: Any, place: tuple, pose: tuple) -> None:
    """Derivatives by expressions and by finite differences, everywhere."""
    m = pyo.ConcreteModel()
    point = (*place, *pose)
    m.v = pyo.Var(range(5), initialize=dict(enumerate(point)))
    gap = shape.gap_to_disc(0.1, m.v[0], m.v[1], (m.v[2], m.v[3], m.v[4])).gap
    exact = differentiate(gap, wrt_list=[m.v[i] for i in range(5)], mode=Modes.reverse_numeric)
    h = 1e-6
    for i, slope in enumerate(exact):
        ends = []
        for sign in (1, -1):
            z = list(point)
            z[i] += sign * h
            ends.append(shape.gap_to_disc(0.1, z[0], z[1], tuple(z[2:])).gap)
        if outside(shape, place, pose):
            assert slope == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-6)


def test_impossible_shapes_are_refused() -> None:
    for make, lengths in (
        (planar.Disc, {"radius": -0.1}),
        (planar.Capsule, {"radius": 0.1, "half_length": 0.0}),
        (planar.RoundedBox, {"radius": 0.1, "half_length": 1.0, "half_width": math.nan}),
    ):
        with pytest.raises(ObstacleError, match="expected a positive length"):
            make(**lengths)


# ----------------------------------------------------------------- wrench and friction


@given(
    shape=shapes,
    place=places,
    pose=poses,
    twist=st.tuples(*3 * [st.floats(-2, 2)]),
    c=st.floats(0, 9),
    along=st.floats(-4, 4),
)
def test_action_is_reaction_and_power_is_force_times_slip(
    shape: Any, place: tuple, pose: tuple, twist: tuple, c: float, along: float
) -> None:
    """Forces cancel, and so do their moments, since they act at one point; together they get c w_n + along w_t."""
    contact, velocity = planar.Contact(shape, ROBOT.shape, friction=0.5), (0.3, -0.7)
    at = shape.gap_to_disc(0.1, *place, pose)
    w_n, w_t = contact.velocity(at, velocity, twist)
    f_x, f_y, m_z = contact.wrench_on_body(at, c, [along])
    (n_x, n_y), (p_x, p_y) = at.normal, at.point
    on_robot = (c * n_x - along * n_y, c * n_y + along * n_x)
    assert (f_x + on_robot[0], f_y + on_robot[1]) == (0.0, 0.0)
    assert m_z == pytest.approx(p_x * f_y - p_y * f_x, abs=1e-12)
    power = -f_x * velocity[0] - f_y * velocity[1] + f_x * twist[0] + f_y * twist[1] + m_z * twist[2]
    assert power == pytest.approx(c * w_n + along * w_t, abs=1e-9)


@given(mass=st.floats(0.1, 10), twist=st.tuples(*3 * [st.floats(-3, 3)]))
def test_ground_friction_opposes_motion_and_stays_below_its_bound(mass: float, twist: tuple) -> None:
    friction = planar.GroundFriction(coefficient=0.2, lever=0.25)
    wrench = friction.wrench(mass, *twist)
    assert sum(w * u for w, u in zip(wrench, twist, strict=True)) <= 0.0
    weight = 0.2 * mass * 9.81
    assert math.hypot(*wrench[:2]) <= weight * (1 + 1e-12)
    assert abs(wrench[2]) <= 0.25 * weight * (1 + 1e-12)


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
    with pytest.raises(ModelError, match="mass = 0"):
        planar.RigidBody(planar.Disc(0.1), mass=0, inertia=1.0)
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


def test_bodies_travel() -> None:
    for thing in (PUCK, ROBOT, planar.Contact(PUCK.shape, ROBOT.shape, friction=0.5), *SHAPES.values()):
        assert pickle.loads(pickle.dumps(thing)) == thing
