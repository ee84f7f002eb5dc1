"""Laws of smooth gaps and of forces at a contact, which are the same in the plane and in space."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pyomo.core.expr.calculus.derivatives import Modes, differentiate

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.mechanics.rotations import cross_product, rotation_matrix, rotation_rows

planar, spatial = rcp.mechanics.planar, rcp.mechanics.spatial
SHAPES = [
    planar.Disc(0.2),
    planar.Capsule(radius=0.05, half_length=0.45),
    planar.RoundedBox(radius=0.05, half_length=0.3, half_width=0.2),
    spatial.Sphere(0.2),
    spatial.Capsule(radius=0.05, half_length=0.45),
    spatial.RoundedBox(radius=0.05, half_length=0.3, half_width=0.2, half_height=0.1),
]


def gap_at(shape: Any, point: Any) -> Any:
    """To a ball of 0.1 m; a point holds its centre, and of the shape the position and what says its orientation."""
    d = len(shape.core)
    return shape.gap_to_ball(0.1, point[:d], point[d : 2 * d], rotation_rows(point[2 * d :]))


@st.composite
def scenes(draw: Any) -> tuple[Any, list[float]]:
    """A shape and a point, at which the ball is far enough from the core to be a state of motion."""
    shape = draw(st.sampled_from(SHAPES))
    d = len(shape.core)
    place, position = (draw(st.tuples(*d * [st.floats(-most, most)])) for most in (2, 1))
    turn = draw(st.tuples(*3 * [st.floats(-1.5, 1.5)]))
    point = [*place, *position, *([2 * turn[0]] if d == 2 else rotation_matrix(turn).ravel().tolist())]
    assume(gap_at(shape, point).gap > -0.1)
    return shape, point


@settings(max_examples=100)
@given(scene=scenes())
def test_the_smooth_gap_is_the_distance_of_the_shapes(scene: tuple[Any, list[float]]) -> None:
    shape, point = scene
    d, gap = len(shape.core), gap_at(*scene).gap
    if gap < 0 and d == 3:
        return
    pose = rcp.planar_pose(*point[2:]) if d == 2 else rcp.spatial_pose(point[3:6], matrix=rotation_rows(point[6:]))
    exact = rcp.scenes.signed_distance(shape.outline().placed(pose), rcp.Polytope.ball(0.1, point[:d])).distance
    # Smoothing over a centimetre moves the ends of the core by at most half of that, in each direction.
    assert gap == pytest.approx(exact, abs=0.0075 if d == 2 else 1e-9 if shape.is_round else 0.01)


@given(scene=scenes())
def test_numbers_arrays_and_expressions_agree_and_derivatives_are_exact(scene: tuple[Any, list[float]]) -> None:
    """In the centre, the position and the orientation; away from the ends of the core the normal is the gradient."""
    shape, point = scene
    d, h = len(shape.core), 1e-6
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(len(point)), initialize=dict(enumerate(point)))
    variables, at = list(m.v.values()), gap_at(*scene)
    expressions, arrays = gap_at(shape, variables), gap_at(shape, [np.full(3, z) for z in point])
    entries, rows, numbers = ([of.gap, *of.normal, *of.point] for of in (expressions, arrays, at))
    assert [pyo.value(entry) for entry in entries] == pytest.approx(numbers, abs=1e-12)
    for row, number in zip(rows, numbers, strict=True):
        assert row == pytest.approx(np.full(3, number), abs=1e-12)
    # Entries in which the gap has no derivative do not appear at all.
    exact = differentiate(expressions.gap, wrt_list=variables, mode=Modes.reverse_numeric)
    ends = [[gap_at(shape, np.array(point) + step).gap for step in (side, -side)] for side in h * np.eye(len(point))]
    assert exact == pytest.approx([(ahead - back) / (2 * h) for ahead, back in ends], abs=1e-6)
    # The contact point lies on the surface, and the centre of the ball further along the normal.
    to_ball = np.add(point[d : 2 * d], at.point) + np.multiply(at.normal, at.gap + 0.1)
    assert to_ball == pytest.approx(point[:d], abs=1e-9)
    local = np.subtract(point[:d], point[d : 2 * d]) @ np.array(rotation_rows(point[2 * d :]))
    if all(half == 0 or abs(abs(z) - half) > 0.1 for z, half in zip(local, shape.core, strict=True)):
        assert at.normal == pytest.approx(exact[:d], abs=1e-6 if shape.is_round else 6e-3)
        assert math.hypot(*at.normal) == pytest.approx(1.0, abs=1e-3)


@given(
    scene=scenes(),
    force=st.tuples(st.floats(0, 9), st.floats(-4, 4), st.floats(-4, 4)),
    twist=st.tuples(*6 * [st.floats(-2, 2)]),
)
def test_action_is_reaction_and_power_is_force_times_slip(scene: Any, force: Any, twist: Any) -> None:
    """Forces cancel, and so do their moments, since they act at one point."""
    shape, at = scene[0], gap_at(*scene)
    d = len(shape.core)
    force, velocity, twist = force[:d], (0.3, -0.7, 0.2)[:d], twist[: 3 * (d - 1)]
    contact = (
        planar.Contact(shape, planar.Disc(0.1), 0.7) if d == 2 else spatial.Contact(shape, spatial.Sphere(0.1), 0.7)
    )
    assume(d == 2 or at.normal[2] <= 0.98)
    tangents = contact.tangents(at)
    assert d == 3 or tangents == [[-at.normal[1], at.normal[0]]]
    wrench = contact.wrench_on_body(at, force[0], force[1:])
    on_robot = [dot(force, column) for column in zip(at.normal, *tangents, strict=True)]
    np.testing.assert_allclose(np.add(wrench[:d], on_robot), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.subtract(wrench[d:], cross_product(at.point, wrench[:d])), 0.0, atol=1e-12)
    power = dot(on_robot, velocity) + dot(wrench, twist)
    assert power == pytest.approx(dot(force, contact.velocity(at, velocity, twist)), abs=1e-9)
