"""A quadrotor flies to a place, with the moments of inertia of the publication; z points down."""

from __future__ import annotations

from math import inf

from .problem import SmoothProblem

MASS, GRAVITY, INERTIA_X, INERTIA_Z = 0.468, 9.8, 0.04856, 0.08801


def rates(x, u, f):
    """Position, angles, velocity and body rates."""
    _, _, _, yaw, pitch, roll, v_x, v_y, v_z, p, q, r = x
    cy, sy, cp, sp, cr, sr = f.cos(yaw), f.sin(yaw), f.cos(pitch), f.sin(pitch), f.cos(roll), f.sin(roll)
    lift, turn, difference = u[0] / MASS, q * sr + r * cr, INERTIA_X - INERTIA_Z
    return (
        v_x,
        v_y,
        v_z,
        turn / cp,
        q * cr - r * sr,
        p + turn * sp / cp,
        -lift * (sr * sy + cr * cy * sp),
        -lift * (cy * sr - cr * sy * sp),
        GRAVITY - lift * cr * cp,
        (difference * q * r + u[1]) / INERTIA_X,
        (-difference * p * r + u[2]) / INERTIA_X,
        u[3] / INERTIA_Z,
    )


QUADROTOR = SmoothProblem(
    name="quadrotor",
    states=("x", "y", "z", "yaw", "pitch", "roll", "v_x", "v_y", "v_z", "p", "q", "r"),
    controls=("thrust", "roll_torque", "pitch_torque", "yaw_torque"),
    final=(2.0, 2.0, 3.0) + (0.0,) * 9,
    state_bounds=((-inf, inf),) * 12,
    rate_bounds=((-inf, inf),) * 12,
    control_bounds=((-10.0, 10.0),) * 4,
    rates=rates,
    cost=lambda x, u: (x[0] - 2) ** 2 + (x[1] - 2) ** 2 + (x[2] - 3) ** 2 + sum(one**2 for one in u),
    duration=6.6,
    elements=200,
)
