"""Laws of the ellipsoidal limit surface of any outline."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.mechanics.limit_surfaces import centroid_and_mean_distance

LimitSurface = rcp.mechanics.LimitSurface
SQUARE = rcp.mechanics.SquareSlider()
L_SHAPE = [(0, 0), (0.3, 0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.2), (0, 0.2)]
angles = st.floats(-math.pi, math.pi)
shifts = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
forces = st.tuples(st.floats(-2, 2), st.floats(-2, 2))


def test_the_square_is_one_of_the_polygons() -> None:
    h = SQUARE.half_side
    corners = [(-h, -h), (h, -h), (h, h), (-h, h)]
    surface = LimitSurface.of_polygon(corners, SQUARE.mass, SQUARE.table_friction, SQUARE.gravity)
    assert (surface.force, surface.moment) == pytest.approx(
        (SQUARE.limit_surface.force, SQUARE.limit_surface.moment), rel=1e-12
    )
    push = (0.3, (-h, 0.01), (0.4, -0.1))
    assert surface.velocity(*push) == pytest.approx(SQUARE.velocity(*push), rel=1e-12)


def test_many_corners_make_a_disc() -> None:
    turns = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    polygon = LimitSurface.of_polygon([(0.2 * math.cos(a), 0.2 * math.sin(a)) for a in turns], 1.0, 0.5)
    assert polygon.lever == pytest.approx(LimitSurface.of_disc(0.2, 1.0, 0.5).lever, rel=1e-4)


def test_the_mean_distance_over_a_shape_that_is_not_convex_is_an_integral() -> None:
    middles = (np.arange(300) + 0.5) * 0.001
    x, y = np.meshgrid(middles, middles[:200])
    inside = (y < 0.1) | (x < 0.1)
    x, y = x[inside], y[inside]
    centre, distance = centroid_and_mean_distance(L_SHAPE)
    assert centre == pytest.approx((x.mean(), y.mean()), abs=1e-9)
    assert distance == pytest.approx(np.hypot(x - x.mean(), y - y.mean()).mean(), rel=1e-5)


@given(turn=angles, shift=shifts, size=st.floats(0.1, 10))
def test_moving_turning_and_reversing_an_outline_leave_its_mean_distance(
    turn: float, shift: tuple[float, float], size: float
) -> None:
    c, s = math.cos(turn), math.sin(turn)
    moved = [(shift[0] + size * (c * x - s * y), shift[1] + size * (s * x + c * y)) for x, y in L_SHAPE]
    _, distance = centroid_and_mean_distance(L_SHAPE)
    for corners in (moved, moved[::-1], moved[2:] + moved[:2]):
        assert centroid_and_mean_distance(corners)[1] == pytest.approx(size * distance, rel=1e-6)


@given(theta=angles, contact=shifts, force=forces, shift=shifts)
def test_where_the_frame_of_the_body_lies_does_not_matter(
    theta: float, contact: tuple[float, float], force: tuple[float, float], shift: tuple[float, float]
) -> None:
    """The body moves the same: the velocities of its two origins differ by its rotation."""
    here = LimitSurface(2.0, 0.3, centre=(0.1, -0.2))
    there = LimitSurface(2.0, 0.3, centre=(0.1 - shift[0], -0.2 - shift[1]))
    v_x, v_y, omega = here.velocity(theta, contact, force)
    other = there.velocity(theta, (contact[0] - shift[0], contact[1] - shift[1]), force)
    arm = complex(*shift) * complex(math.cos(theta), math.sin(theta))
    expected = complex(v_x, v_y) + 1j * omega * arm
    assert (other[0], other[1], other[2]) == pytest.approx((expected.real, expected.imag, omega), abs=1e-9)


@given(wrench=st.tuples(*[st.floats(-2, 2)] * 3))
def test_the_twist_is_half_the_gradient_of_the_load(wrench: tuple[float, float, float]) -> None:
    surface, step = LimitSurface(1.5, 0.4), 1e-5
    for i, expected in enumerate(surface.twist(*wrench)):
        ahead, behind = ([w + sign * step * (j == i) for j, w in enumerate(wrench)] for sign in (1, -1))
        assert (surface.load(*ahead) - surface.load(*behind)) / (4 * step) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("corners", [[], [(0, 0), (1, 0)], [(0, 0), (1, 1), (2, 2)]])
def test_an_outline_without_an_area_is_refused(corners: list[tuple[float, float]]) -> None:
    with pytest.raises(DeclarationError, match="it has no area"):
        LimitSurface.of_polygon(corners, 1.0, 0.5)


def test_constants_are_refused_by_name() -> None:
    with pytest.raises(DeclarationError, match="mass = -1"):
        LimitSurface.of_polygon(L_SHAPE, -1, 0.5)
    with pytest.raises(DeclarationError, match="moment = 0"):
        LimitSurface(1.0, 0)
