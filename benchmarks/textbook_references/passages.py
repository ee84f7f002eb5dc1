"""Flights through air and out of it, with limits."""

from __future__ import annotations

from math import inf, log, pi, radians, sqrt

import casadi
from casadi import cos, exp, if_else, sin, tan

from .statement import FREE, Arc, Statement


def _shuttle(t, x, u, p):
    h, _, latitude, v, path, azimuth = (x[k] for k in range(6))
    attack, bank = 180 / pi * u[0], u[1]
    r = 20902900 + h
    gravity = 0.14076539e17 / r**2
    push = 0.002378 * exp(-h / 23800) * v**2 * 2690 / 2 / (203000 / 32.174)
    lift = push * (-0.20704 + 0.029244 * attack)
    drag = push * (0.07854 - 0.61592e-2 * attack + 0.621408e-3 * attack**2)
    return [
        v * sin(path),
        v * cos(path) * sin(azimuth) / (r * cos(latitude)),
        v * cos(path) * cos(azimuth) / r,
        -drag - gravity * sin(path),
        lift * cos(bank) / v + cos(path) * (v / r - gravity / v),
        lift * sin(bank) / (v * cos(path)) + v * cos(path) * sin(azimuth) * tan(latitude) / r,
    ]


def _heat(t, x, u, p):
    a = 180 / pi * u[0]
    profile = 1.0672181 - 0.19213774e-1 * a + 0.21286289e-3 * a**2 - 0.10117249e-5 * a**3
    return [17700 * casadi.sqrt(0.002378) * exp(-x[0] / 47600) * (1e-4 * x[3]) ** 3.07 * profile]


HEATED_REENTRY = Statement(
    "heated_reentry",
    [
        Arc(
            _shuttle,
            states=[(0, inf), FREE, (-radians(89), radians(89)), (1, inf), (-radians(89), radians(89)), FREE],
            controls=[(-radians(90), radians(90)), (-radians(89), radians(1))],
            duration=(100, 4000),
            guessed_duration=2000,
            guess=lambda s: (
                [260000 - 180000 * s, s, 0.5 * s, 25600 - 23100 * s, -radians(1 + 4 * s), radians(90 - 80 * s)],
                [radians(20), -radians(50)],
            ),
            first=[260000, 0, 0, 25600, -radians(1), radians(90)],
            last=[80000, None, None, 2500, -radians(5), None],
            scale=[1e5, 1, 1, 1e4, 1, 1],
            path=_heat,
            path_bounds=[(-inf, 70)],
        )
    ],
    objective=lambda ends, p: 180 / pi * ends[0].last[2],
    maximise=True,
    elements=40,
    degree=4,
)


def _shot(t, x, u, p):
    geopotential = x[1] / (1 + x[1] / 6356766)
    density = 1.225 * (1 - 0.0065 * geopotential / 288.15) ** 4.25588
    drag = 0.25 * density * x[2] ** 2 * 3 / (4 * 7870 * p[0])
    return [x[2] * cos(x[3]), x[2] * sin(x[3]), -drag - 9.80665 * sin(x[3]), -9.80665 * cos(x[3]) / x[2]]


_BALL = {"states": [FREE, FREE, (1, inf), FREE], "controls": [], "scale": [1000, 1000, 100, 1], "guessed_duration": 12}
CANNONBALL = Statement(
    "cannonball",
    [
        Arc(
            _shot,
            duration=(10, 100),
            guess=lambda s: ([1500 * s, 600 * s, 500 - 380 * s, radians(30) * (1 - s)], []),
            first=[0, 0, None, None],
            last=[None, None, None, 0],
            **_BALL,
        ),
        Arc(
            _shot,
            duration=(0.5, 100),
            guess=lambda s: ([1500 + 1500 * s, 600 - 600 * s, 120, -radians(45) * s], []),
            last=[None, 0, None, None],
            follows=True,
            **_BALL,
        ),
    ],
    objective=lambda ends, p: ends[1].last[0],
    maximise=True,
    conditions=lambda ends, p: [
        ends[1].first - ends[0].last,
        4 / 3 * 7.87 * pi * (10 * p[0]) ** 3 * ends[0].first[2] ** 2 / 2 / 1e5,
    ],
    condition_bounds=[(0, 0)] * 4 + [(-inf, 4)],
    parameters=[(0.01, 0.1, 0.05)],
    elements=10,
)


def _orbit(t, x, u, p):
    r, _, out, along, push, _ = (x[k] for k in range(6))
    return [
        out,
        along / r,
        along**2 / r - r**-2 + push * sin(u[0]),
        push * cos(u[0]) - along * out / r,
        push**2 / 1.5,
        push,
    ]


def _coast(t, x, u, p):
    r, _, out, along = (x[k] for k in range(4))
    return [out, along / r, along**2 / r - r**-2, -along * out / r]


TWO_BURNS = Statement(
    "two_burns",
    [
        Arc(
            _orbit,
            states=[(0.1, inf), *[FREE] * 5],
            controls=[(-radians(30), radians(30))],
            duration=(0.5, 10),
            guessed_duration=2.25,
            guess=lambda s: ([1 + 0.5 * s, 1.7 * s, 0.3 * s, 1, 0.1, 0.2 * s], [0.05]),
            first=[1, 0, 0, 1, 0.1, 0],
        ),
        Arc(
            _coast,
            states=[(0.1, inf), *[FREE] * 3],
            controls=[],
            duration=(0.5, 50),
            guessed_duration=4,
            guess=lambda s: ([1.5 + 1.4 * s, 1.7 + 2 * s, 0.3 - 0.1 * s, 1 - 0.5 * s], []),
            follows=True,
        ),
        Arc(
            _orbit,
            states=[(0.1, inf), *[FREE] * 5],
            controls=[FREE],
            duration=(0.5, 10),
            guessed_duration=1.75,
            guess=lambda s: ([2.9 + 0.1 * s, 4 + 0.5 * s, 0.1 - 0.1 * s, 0.5 + 0.08 * s, 0.12, 0.2 + 0.2 * s], [0]),
            last=[3, None, 0, sqrt(1 / 3), None, None],
            follows=True,
        ),
    ],
    objective=lambda ends, p: ends[2].last[5],
    conditions=lambda ends, p: [
        ends[1].first - ends[0].last[:4],
        ends[2].first[:4] - ends[1].last,
        ends[2].first[4:] - ends[0].last[4:],
    ],
    condition_bounds=[(0, 0)] * 10,
    elements=10,
)


def _wind(x):
    a, b, d, e = 6e-8, -4e-11, -8.02881e-8, 6.28083e-11
    c = -log(25 / 30.6) * 1e-12
    z = 4600 - x

    def pieces(near, amid, far, beyond):
        return if_else(x <= 500, near, if_else(x <= 4100, amid, if_else(x <= 4600, far, beyond)))

    along = pieces(-50 + a * x**3 + b * x**4, (x - 2300) / 40, 50 - a * z**3 - b * z**4, 50)
    return along, pieces(d * x**3 + e * x**4, -51 * exp(-c * (x - 2300) ** 4), d * z**3 + e * z**4, 0)


def _landing(power):
    def dynamics(t, states, u, p):
        # The wind is differentiated along the motion by CasADi, not by hand.
        x, h, v, path, attack = (states[k] for k in range(5))
        place, altitude = casadi.SX.sym("x"), casadi.SX.sym("h")
        along, up = _wind(place)
        winds = casadi.vertcat(along, up * altitude / 1000)
        slopes = casadi.jacobian(winds, casadi.vertcat(place, altitude))
        field = casadi.Function("wind", [place, altitude], [winds, slopes])
        w, slope = field(x, h)
        ground, climb = v * cos(path) + w[0], v * sin(path) + w[1]
        change = slope @ casadi.vertcat(ground, climb)
        mass, gravity = 150000 / 32.172, 32.172
        thrust = power(t) * (0.4456e5 - 0.2398e2 * v + 0.1442e-1 * v**2) / mass
        over = casadi.fmax(attack - radians(12), 0)
        pressure = 0.2203e-2 * 0.156e4 * v**2 / (2 * mass)
        lift = pressure * (0.7125 + 6.0877 * attack - 9.0277 * over**2)
        drag = pressure * (0.1552 + 0.12369 * attack + 2.4203 * attack**2)
        delta = attack + radians(2)
        return [
            ground,
            climb,
            thrust * cos(delta) - drag - gravity * sin(path) - change[0] * cos(path) - change[1] * sin(path),
            (thrust * sin(delta) + lift - gravity * cos(path) + change[0] * sin(path) - change[1] * cos(path)) / v,
            u[0],
        ]

    return dynamics


_FULL = (1 - 0.3825) / 0.2  # seconds until full power
_AIRCRAFT = {
    "states": [(0, 10000), (0, inf), (1, inf), FREE, (-inf, radians(17.2))],
    "controls": [(-radians(3), radians(3))],
    "scale": [1000, 1000, 100, 1, 1],
    "path": lambda t, x, u, p: [(x[1] - p[0]) / 1000],
    "path_bounds": [(0, inf)],
}
ABORT_LANDING = Statement(
    "abort_landing",
    [
        Arc(
            _landing(lambda t: 0.3825 + 0.2 * t),
            duration=_FULL,
            guess=lambda s: ([770 * s, 600, 239.7, radians(-2), radians(7.353)], [0]),
            first=[0, 600, 239.7, radians(-2.249), radians(7.353)],
            **_AIRCRAFT,
        ),
        Arc(
            _landing(lambda t: 1),
            duration=40 - _FULL,
            guess=lambda s: ([770 + 8500 * s, 600, 239.7, radians(-2 + 9.4 * s), radians(7.353)], [0]),
            last=[None, None, None, radians(7.431), None],
            follows=True,
            **_AIRCRAFT,
        ),
    ],
    objective=lambda ends, p: p[0],
    maximise=True,
    conditions=lambda ends, p: [ends[1].first - ends[0].last],
    condition_bounds=[(0, 0)] * 5,
    parameters=[(0, 1000, 500)],
    elements=20,
    degree=4,
    error=3e-5,
)
STATEMENTS = (HEATED_REENTRY, CANNONBALL, TWO_BURNS, ABORT_LANDING)
