"""Heat, light and yeast."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def heat_diffusion(mesh=None, elements=None):
    """Heat a bar at one end so that the other follows, on ten points: Betts 2001; the manual of PSOPT."""
    m = pyo.ConcreteModel(name="heat diffusion")
    count, rate = 10, -1.0
    places, width = np.linspace(0, 1, count), 1 / (count - 1)
    m.bar = b = rcp.PhaseBlock(duration=0.5, mesh=mesh, elements=elements)
    first = 2 + np.cos(np.pi * places)
    b.y = rcp.State(index=count, initial=first, bounds=(0, 3), initial_guess=first)
    b.beyond = rcp.Algebraic(index=2, bounds=(0, 3), initial_guess=[first[0], first[-1]])
    b.heating = rcp.Control(bounds=(0, 0.1), initial_guess=0.1)

    @b.ode
    def diffusion(b, t):
        y, (left, right) = b.y[t], b.beyond[t]
        decay, waves = pyo.exp(rate * t), np.cos(np.pi * places)
        source = [
            (rate * (4 + 2) + np.pi**2 * (4 - 2)) * decay * wave
            + np.pi**2 * decay**2
            + (-2 * np.pi**2 + rate) * decay**2 * wave**2
            for wave in waves
        ]
        before, after = [left, *y[:-1]], [*y[1:], right]
        rates = []
        for q, own, low, high in zip(source, y, before, after, strict=True):
            flow = (4 - own) * (high - 2 * own + low) / width**2 - ((high - low) / (2 * width)) ** 2
            rates.append((q + flow) / (4 + own))
        return {b.y: rates}

    @b.residual
    def ends(b, t):
        y, (left, right) = b.y[t], b.beyond[t]
        loss = y[0] - b.heating[t] - (4 - y[0]) * (y[1] - left) / (2 * width)
        return [loss == 0, (4 - y[-1]) * (right - y[-2]) / (2 * width) == 0]

    def cost(b, t):
        return ((b.y[count - 1, t] - (2 - pyo.exp(rate * t))) ** 2 + 1e-3 * b.heating[t] ** 2) / 2

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def warm_rod(mesh=None, elements=None):
    """Keep a rod above a moving limit from both ends, on 20 intervals: Betts 2010, heat diffusion with inequality."""
    m = pyo.ConcreteModel(name="heat diffusion with inequality")
    count = 20
    places, width = np.linspace(0, np.pi, count + 1), np.pi / count
    m.rod = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    b.y = rcp.State(index=count - 1, initial=0)
    b.ends = rcp.Control(index=2)

    def all_of(b, t):
        return [b.ends[0, t], *b.y[t], b.ends[1, t]]

    @b.ode
    def diffusion(b, t):
        y = all_of(b, t)
        return {b.y: [(y[k - 1] - 2 * y[k] + y[k + 1]) / width**2 for k in range(1, count)]}

    @b.constraint
    def warm(b, t):
        limits = (np.sin(x) * pyo.sin(np.pi * t / 5) - 0.5 - 0.2 for x in places)
        return [y >= limit for y, limit in zip(all_of(b, t), limits, strict=True)]

    def cost(b, t):
        left, *inner, right = all_of(b, t)
        return (width / 2 + 1e-3) * (left**2 + right**2) + width * sum(y**2 for y in inner)

    m.cost = pyo.Objective(expr=b.integral(cost))
    return m


def photochemical_tank(mesh=None, elements=None):
    """Three feeds and light: Jensen 1964; Bojkov, Hansel & Luus 1993; Balsa-Canto et al. 2001, case study III."""
    m = pyo.ConcreteModel(name="photochemical tank")
    m.tank = b = rcp.PhaseBlock(duration=0.2, mesh=mesh, elements=elements)
    first = [0.1883, 0.2507, 0.0467, 0.0899, 0.1804, 0.1394, 0.1046, 0.0]
    b.x = rcp.State(index=8, initial=first, initial_guess=first)
    b.u = rcp.Control(index=4, bounds=(0, [20, 6, 4, 20]), initial_guess=[10, 3, 2, 10])

    @b.ode
    def reactions(b, t):
        (x1, x2, x3, x4, x5, x6, x7, _), (u1, u2, light, u4) = b.x[t], b.u[t]
        q = u1 + u2 + u4
        one, two, three, four = 17.6 * x1 * x2, 73 * x2 * x3, 51.3 * x4 * x5, 23 * x1 * x6 * light
        profit = 5.8 * (q * x1 - u4) - 3.7 * u1 - 4.1 * u2 + q * (23 * x4 + 11 * x5 + 28 * x6 + 35 * x7)
        rates = [u4 - q * x1 - one - four, u1 - q * x2 - one - 2 * two, u2 - q * x3 - two]
        rates += [-q * x4 + 2 * one - three, -q * x5 + 3 * two - three, -q * x6 + 2 * three - four]
        return {b.x: [*rates, -q * x7 + 2 * four, profit - 5 * light**2 - 0.099]}

    m.profit = pyo.Objective(expr=b.x[7, b.final_time], sense=pyo.maximize)
    return m


def ethanol(mesh=None, elements=None):
    """Feed yeast in free time: Chen & Hwang 1990; Banga et al. 2005, case study II; the guess of PROPT."""
    m = pyo.ConcreteModel(name="ethanol by fermentation")
    time = rcp.Duration(bounds=(10, 100), initial_guess=60)
    m.reactor = b = rcp.PhaseBlock(duration=time, mesh=mesh, elements=elements)
    b.cells, b.product = rcp.State(initial=1, initial_guess=10), rcp.State(initial=0, initial_guess=70)
    b.sugar = rcp.State(initial=150, bounds=(0, None), initial_guess=lambda s: 150 - 150 * s)
    b.volume = rcp.State(initial=10, final=(0, 200), initial_guess=lambda s: 10 + 190 * s)
    b.feed = rcp.Control(bounds=(0, 12), initial_guess=3)

    @b.ode
    def fermentation(b, t):
        cells, sugar, product, dilution = b.cells[t], b.sugar[t], b.product[t], b.feed[t] / b.volume[t]
        growth = 0.408 / (1 + product / 16) * sugar / (0.22 + sugar) * cells
        return {
            b.cells: growth - dilution * cells,
            b.sugar: -10 * growth + dilution * (150 - sugar),
            b.product: 1 / (1 + product / 71.5) * sugar / (0.44 + sugar) * cells - dilution * product,
            b.volume: b.feed[t],
        }

    m.amount = pyo.Objective(expr=b.product[b.final_time] * b.volume[b.final_time], sense=pyo.maximize)
    return m


def penicillin(mesh=None, elements=None):
    """A limited biomass: Srinivasan et al., Computers & Chem. Eng. 27 (2003) 27, doi:10.1016/S0098-1354(02)00117-5."""
    m = pyo.ConcreteModel(name="penicillin")
    m.reactor = b = rcp.PhaseBlock(duration=150, mesh=mesh, elements=elements)
    b.cells = rcp.State(initial=1, bounds=(0, 3.7), initial_guess=lambda t: 1 + 2.7 * t / 150)
    b.substrate = rcp.State(initial=0.5, bounds=(0, None), initial_guess=0.5)
    b.product = rcp.State(initial=0, bounds=(0, None), initial_guess=lambda t: 0.6 * t / 150)
    b.volume = rcp.State(initial=150, bounds=(0, None), initial_guess=150)
    b.feed = rcp.Control(bounds=(0, 1), initial_guess=lambda t: 0.03 + 0.06 * t / 150)

    @b.ode
    def fermentation(b, t):
        cells, substrate, dilution = b.cells[t], b.substrate[t], b.feed[t] / b.volume[t]
        growth = 0.02 * substrate / (0.05 + substrate + substrate**2 / 5) * cells
        return {
            b.cells: growth - dilution * cells,
            b.substrate: -growth / 0.5 - 0.004 / 1.2 * cells + dilution * (200 - substrate),
            b.product: 0.004 * cells - dilution * b.product[t],
            b.volume: b.feed[t],
        }

    m.concentration = pyo.Objective(expr=b.product[b.final_time], sense=pyo.maximize)
    return m
