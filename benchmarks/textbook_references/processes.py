"""Heat, light and yeast."""

from __future__ import annotations

from math import inf, pi

import numpy as np
from casadi import cos, exp, sin

from .statement import FREE, Arc, Statement

POINTS = 10
STEP = 1 / (POINTS - 1)


def _ends_of_bar(y, v):
    """What lies a step beyond both ends: the conditions there are solved for it."""
    left = y[1] - 2 * STEP * (y[0] - v) / (4 - y[0])
    return left, y[POINTS - 2]


def _bar(t, y, u, p):
    left, right = _ends_of_bar(y, u[0])
    rates = []
    for k in range(POINTS):
        wave = cos(pi * k / (POINTS - 1))
        low, high = y[k - 1] if k else left, y[k + 1] if k < POINTS - 1 else right
        source = (2 * pi**2 - 6) * exp(-t) * wave + pi**2 * exp(-2 * t) - (2 * pi**2 + 1) * exp(-2 * t) * wave**2
        flux = (4 - y[k]) * (low - 2 * y[k] + high) / STEP**2 - (high - low) ** 2 / (4 * STEP**2)
        rates.append((source + flux) / (4 + y[k]))
    return rates


_FIRST = list(2 + np.cos(np.pi * np.linspace(0, 1, POINTS)))
HEAT_DIFFUSION = Statement(
    "heat_diffusion",
    [
        Arc(
            _bar,
            states=[(0, 3)] * POINTS,
            controls=[(0, 0.1)],
            duration=0.5,
            guess=lambda s: (_FIRST, [0.1]),
            first=_FIRST,
            running=lambda t, x, u, p: ((x[POINTS - 1] - 2 + exp(-t)) ** 2 + 1e-3 * u[0] ** 2) / 2,
            path=lambda t, x, u, p: [_ends_of_bar(x, u[0])[0]],
            path_bounds=[(0, 3)],
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    elements=10,
    size=1e-5,
)
INTERVALS = 20


def _rod(t, x, u, p):
    width = pi / INTERVALS
    all_of = [u[0], *(x[k] for k in range(INTERVALS - 1)), u[1]]
    return [(all_of[k + 1] + all_of[k - 1] - 2 * all_of[k]) / width**2 for k in range(1, INTERVALS)]


def _above_limit(t, x, u, p):
    all_of = [u[0], *(x[k] for k in range(INTERVALS - 1)), u[1]]
    return [y - (sin(pi * k / INTERVALS) * sin(pi * t / 5) - 0.7) for k, y in enumerate(all_of)]


def _rod_cost(t, x, u, p):
    inner = sum(x[k] ** 2 for k in range(INTERVALS - 1))
    return pi / INTERVALS * (inner + (u[0] ** 2 + u[1] ** 2) / 2) + 1e-3 * (u[0] ** 2 + u[1] ** 2)


WARM_ROD = Statement(
    "warm_rod",
    [
        Arc(
            _rod,
            states=[FREE] * (INTERVALS - 1),
            controls=[FREE, FREE],
            duration=5,
            guess=lambda s: ([0] * (INTERVALS - 1), [0, 0]),
            first=[0] * (INTERVALS - 1),
            running=_rod_cost,
            path=_above_limit,
            path_bounds=[(0, inf)] * (INTERVALS + 1),
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    degree=4,
    error=1e-3,
)
_TANK = [0.1883, 0.2507, 0.0467, 0.0899, 0.1804, 0.1394, 0.1046, 0.0]


def _tank(t, x, u, p):
    q = u[0] + u[1] + u[3]
    ab, bc, de, af = 17.6 * x[0] * x[1], 73 * x[1] * x[2], 51.3 * x[3] * x[4], 23 * x[0] * x[5] * u[2]
    gain = q * (5.8 * x[0] + 23 * x[3] + 11 * x[4] + 28 * x[5] + 35 * x[6])
    return [
        u[3] - q * x[0] - ab - af,
        u[0] - q * x[1] - ab - 2 * bc,
        u[1] - q * x[2] - bc,
        2 * ab - q * x[3] - de,
        3 * bc - q * x[4] - de,
        2 * de - q * x[5] - af,
        2 * af - q * x[6],
        gain - 5.8 * u[3] - 3.7 * u[0] - 4.1 * u[1] - 5 * u[2] ** 2 - 0.099,
    ]


PHOTOCHEMICAL = Statement(
    "photochemical_tank",
    [
        Arc(
            _tank,
            states=[FREE] * 8,
            controls=[(0, 20), (0, 6), (0, 4), (0, 20)],
            duration=0.2,
            guess=lambda s: (_TANK, [10, 3, 2, 10]),
            first=_TANK,
        )
    ],
    objective=lambda ends, p: ends[0].last[7],
    maximise=True,
    elements=40,
    degree=4,
    error=2e-5,
)


def _yeast(t, x, u, p):
    growth = 0.408 * x[0] * x[1] / ((1 + x[2] / 16) * (0.22 + x[1]))
    making = x[0] * x[1] / ((1 + x[2] / 71.5) * (0.44 + x[1]))
    thinner = u[0] / x[3]
    return [growth - thinner * x[0], -10 * growth + thinner * (150 - x[1]), making - thinner * x[2], u[0]]


ETHANOL = Statement(
    "ethanol",
    [
        Arc(
            _yeast,
            states=[FREE, (0, inf), FREE, (1, 250)],
            controls=[(0, 12)],
            duration=(10, 100),
            guessed_duration=60,
            guess=lambda s: ([10, 150 - 150 * s, 70, 10 + 190 * s], [3]),
            first=[1, 150, 0, 10],
            scale=[10, 100, 100, 100],
        )
    ],
    objective=lambda ends, p: ends[0].last[2] * ends[0].last[3],
    maximise=True,
    conditions=lambda ends, p: [ends[0].last[3]],
    condition_bounds=[(0, 200)],
    elements=40,
    degree=4,
    error=2e-7,
    width=1e-6,
)


def _mould(t, x, u, p):
    growth = 0.02 * x[1] * x[0] / (0.05 + x[1] + x[1] ** 2 / 5)
    thinner = u[0] / x[3]
    used = 2 * growth + 0.004 * x[0] / 1.2
    return [growth - thinner * x[0], thinner * (200 - x[1]) - used, 0.004 * x[0] - thinner * x[2], u[0]]


PENICILLIN = Statement(
    "penicillin",
    [
        Arc(
            _mould,
            states=[(0, 3.7), (0, inf), (0, inf), (0, inf)],
            controls=[(0, 1)],
            duration=150,
            guess=lambda s: (  # grow as fast as possible to the limit, then starve along it
                [min(np.exp(2.5 * s), 3.7), 0.5 if s < 0.52 else 0.01, 1.5 * s, 150 + 5 * s],
                [0.0275 * np.exp(2.5 * s) if s < 0.52 else 0.012],
            ),
            first=[1, 0.5, 0, 150],
            scale=[1, 1, 1, 100],
        )
    ],
    objective=lambda ends, p: ends[0].last[2],
    maximise=True,
    elements=40,
    degree=4,
    error=4e-4,
)
STATEMENTS = (HEAT_DIFFUSION, WARM_ROD, PHOTOCHEMICAL, ETHANOL, PENICILLIN)
