"""Epidemics, and parameters of growth and reactions from measurements."""

from __future__ import annotations

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

METHANOL = (  # time; methanol, olefins, aromatics and paraffins
    (0.050, 0.7085, 0.1621, 0.0811), (0.065, 0.5971, 0.1855, 0.0965), (0.080, 0.5537, 0.1989, 0.1198),
    (0.123, 0.3684, 0.2845, 0.1535), (0.233, 0.1712, 0.3491, 0.2097), (0.273, 0.1198, 0.3098, 0.2628),
    (0.354, 0.0747, 0.3576, 0.2467), (0.397, 0.0529, 0.3347, 0.2884), (0.418, 0.0415, 0.3388, 0.2757),
    (0.502, 0.0261, 0.3557, 0.3167), (0.553, 0.0208, 0.3483, 0.2954), (0.681, 0.0085, 0.3836, 0.2950),
    (0.750, 0.0053, 0.3611, 0.2937), (0.916, 0.0019, 0.3609, 0.2831), (0.937, 0.0018, 0.3485, 0.2846),
    (1.122, 0.0006, 0.3698, 0.2899),
)  # fmt: skip
STAGES = (  # eight stages of a marine species, twice a unit of time from 0 to 10
    (20000, 17000, 10000, 15000, 12000, 9000, 7000, 3000), (12445, 15411, 13040, 13338, 13484, 8426, 6615, 4022),
    (7705, 13074, 14623, 11976, 12453, 9272, 6891, 5020), (4664, 8579, 12434, 12603, 11738, 9710, 6821, 5722),
    (2977, 7053, 11219, 11340, 13665, 8534, 6242, 5695), (1769, 5054, 10065, 11232, 12112, 9600, 6647, 7034),
    (943, 3907, 9473, 10334, 11115, 8826, 6842, 7348), (581, 2624, 7421, 10297, 12427, 8747, 7199, 7684),
    (355, 1744, 5369, 7748, 10057, 8698, 6542, 7410), (223, 1272, 4713, 6869, 9564, 8766, 6810, 6961),
    (137, 821, 3451, 6050, 8671, 8291, 6827, 7525), (87, 577, 2649, 5454, 8430, 7411, 6423, 8388),
    (49, 337, 2058, 4115, 7435, 7627, 6268, 7189), (32, 228, 1440, 3790, 6474, 6658, 5859, 7467),
    (17, 168, 1178, 3087, 6524, 5880, 5562, 7144), (11, 99, 919, 2596, 5360, 5762, 4480, 7256),
    (7, 65, 647, 1873, 4556, 5058, 4944, 7538), (4, 44, 509, 1571, 4009, 4527, 4233, 6649),
    (2, 27, 345, 1227, 3677, 4229, 3805, 6378), (1, 20, 231, 934, 3197, 3695, 3159, 6454),
    (1, 12, 198, 707, 2562, 3163, 3232, 5566),
)  # fmt: skip


def methanol(mesh=None, elements=None):
    """Five rates of the conversion to hydrocarbons from 16 measurements: COPS 3.0, ANL/MCS-TM-273, problem 13."""
    m = pyo.ConcreteModel(name="methanol to hydrocarbons")
    times = [row[0] for row in METHANOL]
    m.reactor = b = rcp.PhaseBlock(duration=times[-1], mesh=[0.0, *times] if mesh is None else mesh)
    b.x = rcp.State(index=3, initial=[1, 0, 0])
    b.rate = rcp.Parameter(index=5, bounds=(0, None), initial_guess=1)

    @b.ode
    def reactions(b, t):
        (x, y, _), k = b.x[t], b.rate
        share = k[0] * x / ((k[1] + k[4]) * x + y)
        return {
            b.x: [
                -(2 * k[1] + k[2] + k[3]) * x + share * y,
                share * (k[1] * x - y) + k[2] * x,
                share * (y + k[4] * x) + k[3] * x,
            ]
        }

    misses = ((b.x[i, t] - value) ** 2 for t, *values in METHANOL for i, value in enumerate(values))
    m.misfit = pyo.Objective(expr=sum(misses))
    return m


def marine_stages(mesh=None, elements=None):
    """Growth and death in eight stages from 21 counts, also the guess: COPS 3.0, ANL/MCS-TM-273, problem 6."""
    m = pyo.ConcreteModel(name="marine population dynamics")
    times = [0.5 * k for k in range(len(STAGES))]
    m.sea = b = rcp.PhaseBlock(duration=times[-1], mesh=times if mesh is None else mesh)
    b.x = rcp.State(index=8, initial_guess=lambda t: STAGES[round(2 * t)])
    b.growth, b.death = rcp.Parameter(index=7, bounds=(0, None)), rcp.Parameter(index=8, bounds=(0, None))

    @b.ode
    def stages(b, t):
        x = b.x[t]
        grown = [b.growth[s] * x[s] for s in range(7)]
        gains, losses = [0, *grown], [*grown, 0]
        return {b.x: [gains[s] - losses[s] - b.death[s] * x[s] for s in range(8)]}

    misses = (
        (b.x[s, t] - count) ** 2 for t, counts in zip(times, STAGES, strict=True) for s, count in enumerate(counts)
    )
    m.misfit = pyo.Objective(expr=sum(misses))
    return m


def vaccination(mesh=None, elements=None):
    """Susceptible, exposed, infectious: Neilan & Lenhart 2010; Biswas et al. 2014, doi:10.3934/mbe.2014.11.761."""
    m = pyo.ConcreteModel(name="vaccination")
    m.p = b = rcp.PhaseBlock(duration=20, mesh=mesh, elements=elements)
    start = [1000, 100, 50, 1165]
    b.x = rcp.State(index=4, initial=start, initial_guess=start)
    b.u = rcp.Control(bounds=(0, 1))

    @b.ode
    def epidemic(b, t):
        (healthy, exposed, ill, people), u = b.x[t], b.u[t]
        infected = 0.001 * healthy * ill
        return {
            b.x: [
                0.525 * people - 0.5 * healthy - infected - u * healthy,
                infected - (0.5 + 0.5) * exposed,
                0.5 * exposed - (0.1 + 0.2 + 0.5) * ill,
                (0.525 - 0.5) * people - 0.2 * ill,
            ]
        }

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: 0.1 * b.x[2, t] + b.u[t] ** 2))
    return m


def epidemic_peak(mesh=None, elements=None):
    """The smallest peak for limited measures: Molina & Rapaport, Automatica 146 (2022) 110596, with a formula."""
    m = pyo.ConcreteModel(name="peak of an epidemic")
    m.p = b = rcp.PhaseBlock(duration=300, mesh=mesh, elements=elements)
    b.healthy, b.ill = rcp.State(initial=1 - 1e-6, initial_guess=1), rcp.State(initial=1e-6)
    b.spent = rcp.State(initial=0, bounds=(0, 28))
    b.measures = rcp.Control(bounds=(0, 1))
    b.peak = rcp.Parameter(bounds=(0, 1), initial_guess=0.3)

    @b.ode
    def epidemic(b, t):
        infected = 0.21 * (1 - b.measures[t]) * b.healthy[t] * b.ill[t]
        return {b.healthy: -infected, b.ill: infected - 0.07 * b.ill[t], b.spent: b.measures[t]}

    b.constraint(lambda b, t: b.ill[t] <= b.peak)
    m.highest = pyo.Objective(expr=b.peak)
    return m
