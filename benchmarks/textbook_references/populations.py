"""An epidemic, and parameters from measurements."""

from __future__ import annotations

from itertools import pairwise

from textbook_problems.populations import METHANOL, STAGES

from .statement import FREE, Arc, Statement


def _vaccinated(t, x, u, p):
    s, e, i, n = (x[k] for k in range(4))
    return [
        0.525 * n - (0.5 + u[0]) * s - 0.001 * s * i,
        0.001 * s * i - 1.0 * e,
        0.5 * e - 0.8 * i,
        0.025 * n - 0.2 * i,
    ]


VACCINATION = Statement(
    "vaccination",
    [
        Arc(
            _vaccinated,
            states=[FREE] * 4,
            controls=[(0, 1)],
            duration=20,
            guess=lambda s: ([1000, 100, 50, 1165], [0.1]),
            first=[1000, 100, 50, 1165],
            running=lambda t, x, u, p: 0.1 * x[2] + u[0] ** 2,
            scale=[1000, 100, 100, 1000],
        )
    ],
    objective=lambda ends, p: ends[0].integral,
    elements=40,
)


def _fit(name, rates, times, rows, first, parameters, scale, size):
    """An arc from each measurement to the next, with a control without effect."""
    starts = [*first, *[[]] * (len(times) - 2)]
    arcs = [
        Arc(
            rates,
            states=[FREE] * len(rows[0]),
            controls=[(0, 1)],
            duration=until - since,
            guess=lambda s, row=row: (row, [0.5]),
            first=start,
            scale=scale,
            start=since,
        )
        for (since, until), row, start in zip(pairwise(times), rows[:-1], starts, strict=True)
    ]
    count = len(rows[0])

    def misfit(ends, p):
        found = [ends[0].first, *(arc.last for arc in ends)]
        return sum((found[k][i] - row[i]) ** 2 for k, row in enumerate(rows) for i in range(count))

    return Statement(
        name,
        arcs,
        objective=misfit,
        conditions=lambda ends, p: [
            (after.first[i] - before.last[i]) / scale[i] for before, after in pairwise(ends) for i in range(count)
        ],
        condition_bounds=[(0, 0)] * (count * (len(arcs) - 1)),
        parameters=parameters,
        elements=1,
        size=size,
    )


def _conversion(t, x, u, p):
    below = (p[1] + p[4]) * x[0] + x[1]
    return [
        -(2 * p[1] - p[0] * x[1] / below + p[2] + p[3]) * x[0],
        p[0] * x[0] * (p[1] * x[0] - x[1]) / below + p[2] * x[0],
        p[0] * x[0] * (x[1] + p[4] * x[0]) / below + p[3] * x[0],
    ]


METHANOL_RATES = _fit(
    "methanol",
    _conversion,
    [0.0, *(row[0] for row in METHANOL)],
    [(1, 0, 0), *(row[1:] for row in METHANOL)],
    [[1, 0, 0]],
    [(0, 100, 1)] * 5,
    [1, 1, 1],
    0.01,
)


def _stages(t, x, u, p):
    rates = [-(p[7 + s] + (p[s] if s < 7 else 0)) * x[s] for s in range(8)]
    return [rates[0], *(rates[s] + p[s - 1] * x[s - 1] for s in range(1, 8))]


MARINE_STAGES = _fit(
    "marine_stages",
    _stages,
    [0.5 * k for k in range(21)],
    STAGES,
    [[]],
    [(0, 10, 0.5)] * 15,
    [1e4] * 8,
    1e7,
)
STATEMENTS = (VACCINATION, METHANOL_RATES, MARINE_STAGES)
