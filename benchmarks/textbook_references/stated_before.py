"""Problems with known answers, which the transcription itself is checked by."""

from __future__ import annotations

import casadi

from .statement import FREE, Arc, Statement

FASTEST_STOP = Statement(
    "fastest_stop",
    [
        Arc(
            lambda t, x, u, p: [x[1], u[0]],
            states=[FREE, FREE],
            controls=[(-1, 1)],
            duration=(0.1, 10),
            guessed_duration=1,
            guess=lambda s: ([s, 0], [0]),
            first=[0, 0],
            last=[1, 0],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)
HYPERSENSITIVE = Statement(
    "hypersensitive",
    [
        Arc(
            lambda t, x, u, p: [-(x[0] ** 3) + u[0]],
            states=[FREE],
            controls=[FREE],
            duration=10000,
            guess=lambda s: ([1 + 0.5 * s], [0]),
            first=[1],
            last=[1.5],
            running=lambda t, x, u, p: (x[0] ** 2 + u[0] ** 2) / 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)


def _pole(t, x, u, p):
    sine, cosine = casadi.sin(x[1]), casadi.cos(x[1])
    # [[m1 + m2, m2 l cos], [cos, l]] (cart, pole) = (u + m2 l sin w^2, -g sin), of m1 = 1, m2 = 0.3, l = 0.5
    mass = casadi.vertcat(casadi.horzcat(1.3, 0.15 * cosine), casadi.horzcat(cosine, 0.5))
    force = casadi.vertcat(u[0] + 0.15 * sine * x[3] ** 2, -9.81 * sine)
    rates = casadi.inv(mass) @ force
    return [x[2], x[3], rates[0], rates[1]]


CART_POLE = Statement(
    "cart_pole",
    [
        Arc(
            _pole,
            states=[(-2, 2), (-2 * casadi.pi, 2 * casadi.pi), FREE, FREE],
            controls=[(-20, 20)],
            duration=2,
            # The pole swings back first: a straight line ends at 58.807667.
            guess=lambda s: ([s, -3.0 * s * casadi.sin(3.0 * s), 0, 0], [0]),
            first=[0, 0, 0, 0],
            last=[1, casadi.pi, 0, 0],
            running=lambda t, x, u, p: u[0] ** 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)
STATEMENTS = (FASTEST_STOP, HYPERSENSITIVE, CART_POLE)
