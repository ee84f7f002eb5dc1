"""Two links with a motor in the elbow are swung up, with the gravity terms of the publication."""

from __future__ import annotations

from math import pi

from .problem import SmoothProblem

GRAVITY, MASS, LENGTH, CENTRE, INERTIA = 9.81, 0.5, 0.5, 0.2, 0.5  # both links are alike


def rates(x, u, f):
    """Angles and their rates; the accelerations solve two equations by hand."""
    q1, q2, dq1, dq2 = x
    c, s = MASS * LENGTH * CENTRE * f.cos(q2), MASS * LENGTH * CENTRE * f.sin(q2)
    m11, m12, m22 = 2 * INERTIA + MASS * LENGTH**2 + 2 * c, INERTIA + c, INERTIA
    elbow = MASS * LENGTH * GRAVITY * f.sin(q1 + q2)
    shoulder = (MASS * CENTRE + MASS * LENGTH) * GRAVITY * f.sin(q1) + elbow
    force_1 = s * (2 * dq1 * dq2 + dq2**2) - shoulder
    force_2 = u[0] - s * dq1**2 - elbow
    determinant = m11 * m22 - m12**2
    return dq1, dq2, (m22 * force_1 - m12 * force_2) / determinant, (m11 * force_2 - m12 * force_1) / determinant


ACROBOT = SmoothProblem(
    name="acrobot",
    states=("q1", "q2", "dq1", "dq2"),
    controls=("torque",),
    final=(pi, 0.0, 0.0, 0.0),
    state_bounds=((-2 * pi, 2 * pi),) * 2 + ((-40.0, 40.0),) * 2,
    rate_bounds=((-40.0, 40.0),) * 4,
    control_bounds=((-40.0, 40.0),),
    rates=rates,
    cost=lambda x, u: (x[0] - pi) ** 2 + x[1] ** 2 + 0.1 * (x[2] ** 2 + x[3] ** 2 + u[0] ** 2),
    duration=5.0,
    elements=100,
)
