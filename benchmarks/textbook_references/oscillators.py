"""What swings back, and what lives in a body."""

from __future__ import annotations

from itertools import pairwise
from math import inf

from .statement import FREE, Arc, Statement


def _rayleigh(t, x, u, p):
    return [x[1], -x[0] + (1.4 - 0.14 * x[1] ** 2) * x[1] + 4 * u[0]]


RAYLEIGH = Statement(
    "rayleigh_with_mixed_limit",
    [
        Arc(
            _rayleigh,
            states=[FREE, FREE],
            controls=[FREE],
            duration=4.5,
            guess=lambda s: ([-5, -5], [0]),
            first=[-5, -5],
            running=lambda t, x, u, p: u[0] ** 2 + x[0] ** 2,
            path=lambda t, x, u, p: [u[0] + x[0] / 6],
            path_bounds=[(-inf, 0)],
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)
VAN_DER_POL = Statement(
    "van_der_pol_with_limit",
    [
        Arc(
            lambda t, x, u, p: [x[0] - x[0] * x[1] ** 2 - x[1] + u[0], x[0]],
            states=[(-0.4, inf), FREE],
            controls=[(-0.3, 1)],
            duration=5,
            guess=lambda s: ([0, 1], [0]),
            first=[0, 1],
            running=lambda t, x, u, p: x[0] ** 2 + x[1] ** 2 + u[0] ** 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
)
PIECES = 20  # of a delay each; the state of one is the delayed state of the next


def _delayed(t, x, u, p):
    rates = []
    for k in range(PIECES):
        late = (x[2 * k - 2], x[2 * k - 1]) if k else (1, 1)
        rates += [x[2 * k + 1], -10 * x[2 * k] - 5 * x[2 * k + 1] - 2 * late[0] - late[1] + u[k]]
    return rates


DELAYED = Statement(
    "delayed_oscillator",
    [
        Arc(
            _delayed,
            states=[FREE] * (2 * PIECES),
            controls=[(-100, 100)] * PIECES,
            duration=0.25,
            guess=lambda s: ([0] * (2 * PIECES), [0] * PIECES),
            first=[1, 1],
            running=lambda t, x, u, p: sum(
                5 * x[2 * k] ** 2 + x[2 * k + 1] ** 2 / 2 + u[k] ** 2 / 2 for k in range(PIECES)
            ),
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    conditions=lambda ends, p: [
        ends[0].first[after + i] - ends[0].last[before + i]
        for before, after in pairwise(range(0, 2 * PIECES, 2))
        for i in range(2)
    ],
    condition_bounds=[(0, 0)] * (2 * PIECES - 2),
    elements=4,
)


def _infection(t, x, u, p):
    cells, virus = x[0], x[1]
    growth = 2 - 1.5 * virus / (14 + virus) - 0.002 * cells - 2.5e-4 * cells * virus + u[0] * cells
    return [growth, 30 * virus * (1 - u[1]) / (1 + virus) - 0.007 * cells * virus]


IMMUNOLOGY = Statement(
    "immunology",
    [
        Arc(
            _infection,
            states=[(0, 1200), (0.05, 5)],
            controls=[(0, 0.02), (0, 0.9)],
            duration=50,
            guess=lambda s: ([400 + 400 * s, 3], [0.01, 0.4]),
            first=[400, 3],
            scale=[500, 1],
            running=lambda t, x, u, p: x[0] - 2.5e5 * u[0] ** 2 - 75 * u[1] ** 2,
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    maximise=True,
)
STATEMENTS = (RAYLEIGH, VAN_DER_POL, DELAYED, IMMUNOLOGY)
