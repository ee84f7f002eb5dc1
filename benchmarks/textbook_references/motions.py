"""Masses on wires, on tracks and in valleys."""

from __future__ import annotations

from math import inf, pi, radians

from casadi import cos, sin, sqrt

from .statement import FREE, Arc, Statement

ABOVE_SLOPE = Statement(
    "brachistochrone_above_slope",
    [
        Arc(
            lambda t, x, u, p: [x[2] * cos(u[0]), x[2] * sin(u[0]), 32.174 * sin(u[0])],
            states=[FREE, FREE, FREE],
            controls=[FREE],
            duration=(0.01, 10),
            guessed_duration=0.4,
            guess=lambda s: ([s, 0.5 * s, 5 * s], [0.5]),
            first=[0, 0, 0],
            last=[1, None, None],
            path=lambda t, x, u, p: [x[1] - x[0] / 2],
            path_bounds=[(-inf, 0.1)],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)
SHORT_WIRE = Statement(
    "short_wire",
    [
        Arc(
            lambda t, x, u, p: [x[2] * sin(u[0]), -x[2] * cos(u[0]), 9.80665 * cos(u[0]), x[2]],
            states=[FREE, FREE, FREE, (0, 11.9)],
            controls=[(radians(0.01), radians(179.9))],
            duration=(0.5, 10),
            guessed_duration=2,
            guess=lambda s: ([10 * s, 10 - 5 * s, 9.9 * s, 11 * s], [radians(5 + 95 * s)]),
            first=[0, 10, 0, 0],
            last=[10, 5, None, None],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)
PENDULUM = Statement(  # by the angle below the horizontal, which the Cartesian statement does not know
    "pendulum",
    [
        Arc(
            lambda t, x, u, p: [x[1], 9.81 * cos(x[0]) + u[0]],
            states=[FREE, FREE],
            controls=[FREE],
            duration=3,
            guess=lambda s: ([pi / 2 * s, 0], [0]),
            first=[0, 0],
            last=[pi / 2, 0],
            running=lambda t, x, u, p: u[0] ** 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)


def _tracked(here):
    return lambda t, x, u, p: sum(
        weight * (x[i] - place) ** 2
        for i, (weight, place) in enumerate(zip((100, 100, 500, 500), here(t), strict=True))
    )


def _free_mass(t, x, u, p):
    return [x[2], x[3], u[0], u[1]]


PATH_TRACKING = Statement(
    "path_tracking",
    [
        Arc(
            _free_mass,
            states=[(-10, 10)] * 4,
            controls=[(-10, 10)] * 2,
            duration=1,
            guess=lambda s: ([0.25 * s, 0.25 * s, 0.5 - 0.25 * s, 0.25 * s], [0, 0]),
            first=[0, 0, 0.5, 0],
            running=_tracked(lambda t: (t / 2, 0, 0.5, 0)),
        ),
        Arc(
            _free_mass,
            states=[(-10, 10)] * 4,
            controls=[(-10, 10)] * 2,
            duration=1,
            guess=lambda s: ([0.25 + 0.25 * s, 0.25 + 0.25 * s, 0.25 - 0.25 * s, 0.25 + 0.25 * s], [0, 0]),
            last=[0.5, 0.5, 0, 0.5],
            running=_tracked(lambda t: (0.5, (t - 1) / 2, 0, 0.5)),
            follows=True,
        ),
    ],
    objective=lambda ends, p: ends[0].integral + ends[1].integral,
    conditions=lambda ends, p: [ends[1].first - ends[0].last],
    condition_bounds=[(0, 0)] * 4,
)


def _with_friction(t, x, u, p):
    def sign(rate):
        return rate / sqrt(rate**2 + 1e-4)

    first = (-1.8 * x[0] + 0.85 * x[1] - sign(x[2]) + u[0]) / 1.1
    return [x[2], x[3], first, (0.85 * (x[0] - x[1]) - sign(x[3]) + u[1]) / 1.2]


FRICTION = Statement(
    "coulomb_friction",
    [
        Arc(
            _with_friction,
            states=[(-2, 2), (-2, 2), (-20, 20), (-20, 20)],
            controls=[(-4, 4), (-4, 4)],
            duration=(1.8, 4),
            guessed_duration=3,
            guess=lambda s: ([s, 2 * s, s - 1, 2 * s - 2], [0, 0]),
            first=[0, 0, -1, -2],
            last=[1, 2, 0, 0],
        )
    ],
    objective=lambda ends, p: ends[0].end,
    elements=40,
)
MOUNTAIN_CAR = Statement(
    "mountain_car",
    [
        Arc(
            lambda t, x, u, p: [x[1], 0.001 * u[0] - 0.0025 * cos(3 * x[0])],
            states=[(-1.2, 0.5), (-0.07, 0.07)],
            controls=[(-1, 1)],
            duration=(10, 400),
            guessed_duration=110,
            guess=lambda s: ([-0.5 - 0.4 * sin(6 * s) * s if s < 0.8 else 0.5 * (s - 0.8) / 0.2, 0.0], [0]),
            first=[-0.5, 0],
            last=[0.5, None],
            scale=[1, 0.05],
        )
    ],
    objective=lambda ends, p: ends[0].end,
    conditions=lambda ends, p: [ends[0].last[1]],
    condition_bounds=[(0, inf)],
    elements=40,
)
STATEMENTS = (ABOVE_SLOPE, SHORT_WIRE, PENDULUM, PATH_TRACKING, FRICTION, MOUNTAIN_CAR)
