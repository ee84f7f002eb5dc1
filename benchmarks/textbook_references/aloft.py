"""A glider in the wind, a rocket and a station in orbit."""

from __future__ import annotations

import casadi
import numpy as np
from casadi import cos, pi, sin
from textbook_problems.aloft import INERTIA

from .statement import Arc, Statement

TILT = 75 * pi / 180


def _glider(t, x, u, p):
    z, v, gamma, psi = x[2], x[3], x[4], x[5]
    lift = 0.5 * 0.002378 * 45.09703 * u[0] * v**2
    drag = 0.5 * 0.002378 * 45.09703 * (0.00873 + 0.045 * u[0] ** 2) * v**2
    wind, rate = p[0] * z, p[0] * v * sin(gamma)
    m, g = 5.6, 32.2
    return [
        v * cos(gamma) * sin(psi) + wind,
        v * cos(gamma) * cos(psi),
        v * sin(gamma),
        -drag / m - g * sin(gamma) - rate * cos(gamma) * sin(psi),
        (lift * cos(u[1]) - m * g * cos(gamma) + m * rate * sin(gamma) * sin(psi)) / (m * v),
        (lift * sin(u[1]) - m * rate * cos(psi)) / (m * v * cos(gamma)),
    ]


def _circle(s):
    turn = 2 * pi * s
    place = [500 * cos(turn) - 500, 300 * sin(turn), 400 - 400 * cos(turn)]
    return [*place, 80 * (1.5 + cos(turn)), pi / 6 * sin(turn), -1 - 6 * s], [0.5, -1]


DYNAMIC_SOARING = Statement(
    "dynamic_soaring",
    [
        Arc(
            _glider,
            states=[(-1000, 1000), (-1000, 1000), (0, 1000), (10, 350), (-TILT, TILT), (-3 * pi, pi / 2)],
            controls=[(-0.5, 1.5), (-TILT, TILT)],
            duration=(1, 30),
            guessed_duration=24,
            guess=_circle,
            first=[0, 0, 0],
            last=[0, 0, 0],
            path=lambda t, x, u, p: [0.5 * 0.002378 * 45.09703 * u[0] * x[3] ** 2 / (5.6 * 32.2)],
            path_bounds=[(-2, 5)],
            scale=[100, 100, 100, 100, 1, 1],
        )
    ],
    objective=lambda ends, p: p[0],
    conditions=lambda ends, p: [
        (ends[0].last[3] - ends[0].first[3]) / 100,
        ends[0].last[4] - ends[0].first[4],
        ends[0].last[5] - ends[0].first[5] + 2 * pi,
    ],
    condition_bounds=[(0, 0)] * 3,
    parameters=[(0.005, 0.15, 0.08)],
    size=0.1,
)


def _skew(a):
    return casadi.vertcat(
        casadi.horzcat(0, -a[2], a[1]), casadi.horzcat(a[2], 0, -a[0]), casadi.horzcat(-a[1], a[0], 0)
    )


def _free(x):
    """Rates of attitude, and of turning without a torque of the gyroscopes."""
    w, r, h = (casadi.vertcat(*(x[3 * k + i] for i in range(3))) for k in range(3))
    inertia, orbit = casadi.DM(np.array(INERTIA)), 0.06511 * pi / 180
    turned = casadi.DM.eye(3) + 2 / (1 + casadi.dot(r, r)) * (_skew(r) @ _skew(r) - _skew(r))
    gravity = 3 * orbit**2 * (_skew(turned[:, 2]) @ (inertia @ turned[:, 2]))
    attitude = 0.5 * (r @ r.T + casadi.DM.eye(3) + _skew(r)) @ (w + orbit * turned[:, 1])
    torque = gravity - _skew(w) @ (inertia @ w + h)
    return attitude, torque, casadi.inv(inertia)


def _station(t, x, u, p):
    attitude, torque, inverse = _free(x)
    force = casadi.vertcat(u[0], u[1], u[2]) * 100
    rate = inverse @ (torque - force)
    return [rate[0], rate[1], rate[2], attitude[0], attitude[1], attitude[2], force[0], force[1], force[2]]


def _still(ends, p):
    attitude, torque, inverse = _free(ends[0].last)
    rate = 1e6 * inverse @ torque
    return [*(1e3 * attitude[i] for i in range(3)), *(rate[i] for i in range(3))]


RATE = [-9.5380685844896e-6, -1.1363312657036e-3, 5.3472801108427e-6]
ATTITUDE = [2.9963689649816e-3, 1.5334477761054e-1, 3.8359805613992e-3]
SPACE_STATION = Statement(
    "space_station",
    [
        Arc(
            _station,
            states=[*[(-2e-3, 2e-3)] * 3, *[(-1, 1)] * 3, *[(-15000, 15000)] * 3],
            controls=[(-1.5, 1.5)] * 3,
            duration=1800,
            guess=lambda s: ([*RATE, *ATTITUDE, *[5000 * (1 - s)] * 3], [0, 0, 0]),
            first=[*RATE, *ATTITUDE, 5000, 5000, 5000],
            last=[*[None] * 6, 0, 0, 0],
            running=lambda t, x, u, p: 0.01 * casadi.sumsqr(u),
            path=lambda t, x, u, p: [1e-8 * (x[6] ** 2 + x[7] ** 2 + x[8] ** 2)],
            path_bounds=[(0, 1)],
            scale=[*[1e-3] * 3, *[0.1] * 3, *[5000] * 3],
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    conditions=_still,
    condition_bounds=[(0, 0)] * 6,
    elements=10,
)
STATEMENTS = (DYNAMIC_SOARING, SPACE_STATION)
