"""A clearance that changes in time is proven at all times, as a number is."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, on_points
from hypothesis import given
from hypothesis import strategies as st

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.motion import Body, SafetyReport, motion_of, verify_clearance

CAR = Polytope.box(1.0, 0.5)
WALL = Polytope.box(20.0, 1.0, center=(0.0, -2.0))


def report(m: Any, clearance: Any, **options: Any) -> SafetyReport:
    bodies = {"car": Body(CAR, by_states), "wall": Body(WALL)}
    return verify_clearance(motion_of(m.t, m), bodies, {("car", "wall"): clearance}, **options)


@given(st.integers(0, 10**6))
def test_a_constant_rule_equals_the_number(seed: int) -> None:
    m = on_points(np.random.default_rng(seed).normal(size=(4, 3)))
    rule, number = report(m, lambda b, t: 0.2), report(m, 0.2)
    for found, expected in zip(rule.body_pairs, number.body_pairs, strict=True):
        assert found.verdict == expected.verdict
        assert found.distance == pytest.approx(expected.distance, abs=1e-12)
        assert found.proven == pytest.approx(expected.proven, abs=1e-9)


@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.floats(-0.5, 0.5))
def test_safe_is_never_said_of_a_motion_that_breaks_a_changing_clearance(
    seed: int, height: float, growth: float
) -> None:
    random = np.random.default_rng(seed)
    poses = random.normal(size=(4, 3)) * [1.0, 0.3, 0.3] + [0.0, height - 0.2, 0.0]
    m = on_points(poses)
    m.speed = pyo.Var(m.t)
    speeds = random.uniform(0.0, 2.0, size=4)
    for t, speed in zip(m.t, speeds, strict=True):
        m.speed[t] = speed
    pair = report(m, lambda b, t: 0.2 + 0.1 * b.speed[t] ** 2 + growth * 0.1 * pyo.sin(t)).body_pairs[0]
    at = np.linspace(0.0, 3.0, 1501)
    y, theta = (np.interp(at, np.arange(4), column) for column in poses.T[1:])
    corners = CAR.vertices[None]
    height_of_corners = y[:, None] + np.sin(theta)[:, None] * corners[..., 0] + np.cos(theta)[:, None] * corners[..., 1]
    distances = height_of_corners.min(axis=1) + 1.5  # the wall is long: the nearest point is straight below
    required = 0.2 + 0.1 * np.interp(at, np.arange(4), speeds) ** 2 + growth * 0.1 * np.sin(at)
    excess = (distances - required).min()
    if excess < -pair.tolerance - 1e-9:
        assert not pair.safe
    if excess > -pair.tolerance + 1e-6:
        assert pair.safe
        assert pair.proven - pair.clearance <= excess + 1e-9
    if not pair.safe and distances.min() > 0.0:
        assert pair.distance - pair.clearance == pytest.approx(excess, abs=1e-4)


def test_a_clearance_that_cannot_be_followed_or_has_no_value_is_named() -> None:
    m = on_points([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    m.gap = pyo.Var()
    for clearance in (m.gap, lambda b, t: "far", "far", lambda b, t: 0.1 * math.cos(t)):
        with pytest.raises(ObstacleError, match="the clearance between 'car' and 'wall'"):
            report(m, clearance)
