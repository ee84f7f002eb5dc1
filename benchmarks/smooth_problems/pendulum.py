"""A pendulum is swung up, with the moment of inertia of the publication."""

from __future__ import annotations

from math import inf, pi

from .problem import SmoothProblem

GRAVITY, DAMPING, INERTIA = 9.81, 0.01, 9.81


def rates(x, u, f):
    """Angle and rate."""
    theta, omega = x
    return omega, (u[0] - GRAVITY * f.sin(theta) - DAMPING * omega) / INERTIA


PENDULUM = SmoothProblem(
    name="pendulum",
    states=("theta", "omega"),
    controls=("torque",),
    final=(None, None),
    state_bounds=((-2 * pi, 2 * pi), (-10.0, 10.0)),
    rate_bounds=((-inf, inf),) * 2,
    control_bounds=((-10.0, 10.0),),
    rates=rates,
    cost=lambda x, u: (x[0] - pi) ** 2 + x[1] ** 2 + 0.01 * u[0] ** 2,
    duration=7.5,
    elements=150,
)
