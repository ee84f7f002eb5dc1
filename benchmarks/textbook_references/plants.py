"""Reactors and a greenhouse."""

from __future__ import annotations

from itertools import pairwise

import casadi
import numpy as np
from casadi import exp

from .statement import FREE, Arc, Statement

PIECES = 5


def _in_a_row(t, x, u, p):
    rates = []
    for k in range(PIECES):
        a, b, c, d = (x[4 * k + i] for i in range(4))
        late, late_hot = (x[4 * k - 4], x[4 * k - 3]) if k else (0.15, -0.03)
        r1, r2 = (a + 0.5) * exp(25 * b / (b + 2)), (c + 0.25) * exp(25 * d / (d + 2))
        rates += [0.5 - a - r1, r1 - (2 + u[2 * k]) * (b + 0.25)]
        rates += [late - c - r2 + 0.25, late_hot - 2 * d - u[2 * k + 1] * (d + 0.25) + r2 - 0.25]
    return rates


TANKS_IN_A_ROW = Statement(
    "tanks_in_a_row",
    [
        Arc(
            _in_a_row,
            states=[(-1, 1)] * (4 * PIECES),
            controls=[(-0.5, 0.5)] * (2 * PIECES),
            duration=0.4,
            guess=lambda s: ([0] * (4 * PIECES), [0] * (2 * PIECES)),
            first=[0.15, -0.03, 0.10, 0],
            running=lambda t, x, u, p: casadi.sumsqr(x) + 0.1 * casadi.sumsqr(u),
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    conditions=lambda ends, p: [
        ends[0].first[4 * after + i] - ends[0].last[4 * before + i]
        for before, after in pairwise(range(PIECES))
        for i in range(4)
    ],
    condition_bounds=[(0, 0)] * (4 * PIECES - 4),
    elements=4,
    size=0.01,
)
HOURS = np.arange(-5, 246) / 5
WAVE = np.sin(4 * np.pi * HOURS / 48 - 0.65 * np.pi)


def _climate(t, x, u, p):
    wave = casadi.pw_lin(t, HOURS, WAVE)
    return [3e-6 / 40 * 800 * wave * x[1], 15 + 10 * wave - x[1] + 0.1 * u[0], 7.5e-2 / 220 * u[0]]


GREENHOUSE = Statement(
    "greenhouse",
    [
        Arc(
            _climate,
            states=[FREE] * 3,
            controls=[(0, 10)],
            duration=48,
            guess=lambda s: ([0, 10, 0], [0]),
            first=[0, 10, 0],
            breaks=tuple(HOURS[6:-6] / 48),
            scale=[0.01, 10, 0.1],
        )
    ],
    objective=lambda ends, p: ends[0].last[2] - 3e4 / 220 * ends[0].last[0],
    elements=1,
    degree=3,
)


def _tubular(t, x, u, p):
    forth, last = u[0] * (x[0] - 10 * x[1]), (1 - u[0]) * x[1]
    return [-forth, forth - last, last]


LONG_REACTOR = Statement(
    "long_reactor",
    [
        Arc(
            _tubular,
            states=[(-0.1, 1.1)] * 3,
            controls=[(0, 1)],
            duration=4,
            guess=lambda s: ([1 - s, 0.1, s], [0.2]),
            first=[1, 0, 0],
        )
    ],
    objective=lambda ends, p: ends[0].last[2],
    maximise=True,
)
STATEMENTS = (TANKS_IN_A_ROW, GREENHOUSE, LONG_REACTOR)
