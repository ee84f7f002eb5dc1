"""Small mechanics, and a limit of third order."""

from __future__ import annotations

from itertools import pairwise

import casadi
from casadi import cos, pi, sin

from .statement import FREE, Arc, Statement

TRIPLE_INTEGRATOR = Statement(
    "triple_integrator",
    [
        Arc(
            lambda t, x, u, p: [x[1], x[2], u[0]],
            states=[FREE] * 3,
            controls=[(-1, 1)],
            duration=5,
            guess=lambda s: ([1 - s, 0, 0], [0]),
            first=[1, 0, 0],
            running=lambda t, x, u, p: x[0] ** 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)


def _van_der_pol(control, first):
    return Arc(
        lambda t, x, u, p: [x[1], control(x) - x[0] + (1 - x[0] ** 2) * x[1]],
        states=[FREE, FREE],
        controls=[(0, 1)],  # without effect
        duration=(1e-3, 4),
        guessed_duration=1.3,
        guess=lambda s: ([0.5, 0.5 - s], [0.5]),
        first=first,
        running=lambda t, x, u, p: 0.5 * (x[0] ** 2 + x[1] ** 2),
        follows=not first,
    )


# On the singular arc the adjoint of the speed vanishes with its derivatives, which leaves v' = x.
SINGULAR_OSCILLATOR = Statement(
    "singular_oscillator",
    [
        _van_der_pol(lambda x: -1, [0, 1]),
        _van_der_pol(lambda x: 1, []),
        _van_der_pol(lambda x: 2 * x[0] - (1 - x[0] ** 2) * x[1], []),
    ],
    objective=lambda ends, p: sum(arc.integral for arc in ends),
    conditions=lambda ends, p: [
        *(after.first[i] - before.last[i] for before, after in pairwise(ends) for i in range(2)),
        ends[2].end,
    ],
    condition_bounds=[*[(0, 0)] * 4, (4, 4)],
    elements=5,
)
OSCILLATOR_TO_REST = Statement(
    "oscillator_to_rest",
    [
        Arc(
            lambda t, x, u, p: [x[1], u[0] - x[0]],
            states=[FREE, FREE],
            controls=[(-1, 1)],
            duration=(1, 20),
            guessed_duration=8,
            guess=lambda s: ([5 * (1 - s) * cos(8 * s), -5 * (1 - s) * sin(8 * s)], [0]),
            first=[5, 0],
            last=[0, 0],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)
TWO_MASSES = Statement(
    "two_masses",
    [
        Arc(
            lambda t, x, u, p: [x[2], x[3], u[0] + (x[1] - x[0]), x[0] - x[1]],
            states=[FREE] * 4,
            controls=[(-1, 1)],
            duration=(1, 20),
            guessed_duration=4,
            guess=lambda s: ([s, s, 0, 0], [0]),
            first=[0] * 4,
            last=[1, 1, 0, 0],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)
TURN_AROUND = Statement(
    "turn_around",
    [
        Arc(
            lambda t, x, u, p: [cos(x[2]), sin(x[2]), u[0]],
            states=[FREE] * 3,
            controls=[(-1, 1)],
            duration=(1, 20),
            guessed_duration=7,
            guess=lambda s: ([1.5 * sin(pi * s), sin(2 * pi * s), 7 * s - 2], [0]),
            first=[0, 0, 0],
            last=[0, 0, pi],
        )
    ],
    objective=lambda ends, p: ends[0].end,
)


def _until_contact(duration, first, last):
    return Arc(
        lambda t, x, u, p: [x[1], x[2], u[0]],
        states=[(0, casadi.inf), FREE, FREE],
        controls=[FREE],
        duration=(1e-3, 10),
        guessed_duration=duration,
        guess=lambda s: ([0.1, 0.1, 0.1], [0.1]),
        first=first,
        last=last,
        running=lambda t, x, u, p: 3 * x[0] + 0.5 * u[0] ** 2,
        follows=not first,
    )


# Each time between contacts is about a third of the one before; the fifth contact is followed by rest here, where
# others would save less than the last digit.
THIRD_ORDER_LIMIT = Statement(
    "third_order_limit",
    [
        _until_contact(1, [1, -2, 0], [0, 0]),
        _until_contact(3, [], [0, 0]),
        _until_contact(1, [], [0, 0]),
        _until_contact(0.3, [], [0, 0]),
        _until_contact(0.1, [], [0, 0, 0]),
    ],
    objective=lambda ends, p: sum(arc.integral for arc in ends),
    conditions=lambda ends, p: [
        *(after.first[i] - before.last[i] for before, after in pairwise(ends) for i in range(3)),
        ends[-1].end,
    ],
    condition_bounds=[*[(0, 0)] * 12, (0, 10)],
    elements=3,
)
ELECTRIC_VEHICLE = Statement(
    "electric_vehicle",
    [
        Arc(
            lambda t, x, u, p: [
                x[1],
                u[0] - 0.001 * x[1] * x[1] - 0.1 - (3 + 0.4 * x[0] - x[0] ** 2 + 0.1 * x[0] ** 3),
            ],
            states=[FREE, FREE],
            controls=[FREE],
            duration=1,
            guess=lambda s: ([10 * s, 10], [0]),
            first=[0, 0],
            last=[10, 0],
            running=lambda t, x, u, p: u[0] * (x[1] + u[0]),
            scale=[10, 10],
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)
STATEMENTS = (
    TRIPLE_INTEGRATOR,
    SINGULAR_OSCILLATOR,
    OSCILLATOR_TO_REST,
    TWO_MASSES,
    TURN_AROUND,
    THIRD_ORDER_LIMIT,
    ELECTRIC_VEHICLE,
)
