"""Laws of quasi-static pushing."""

import math
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

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
