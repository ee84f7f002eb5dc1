"""Reactors, and what else flows and reacts."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def stirred_tank(mesh=None, elements=None):
    """A nonlinear stirred tank with two steady states: Luus, Iterative Dynamic Programming, 2000, sec. 4.3."""
    m = pyo.ConcreteModel(name="stirred tank")
    m.tank = b = rcp.PhaseBlock(duration=0.78, mesh=mesh, elements=elements)
    b.x = rcp.State(index=2, initial=0.09)
    b.u = rcp.Control(bounds=(0, 5), initial_guess=1)

    @b.ode
    def tank(b, t):
        x, y = b.x[t]
        reaction = (y + 0.5) * pyo.exp(25 * x / (x + 2))
        return {b.x: [-(2 + b.u[t]) * (x + 0.25) + reaction, 0.5 - y - reaction]}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] @ b.x[t] + 0.1 * b.u[t] ** 2))
    return m


def batch_reactor(mesh=None, elements=None):
    """Parallel reactions: Ray, Advanced Process Control, 1981; Biegler, Computers & Chem. Eng. 8 (1984) 243."""
    m = pyo.ConcreteModel(name="batch reactor")
    m.reactor = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1)
    b.y = rcp.State(initial=0)
    b.u = rcp.Control(bounds=(0, 5))
    b.ode(lambda b, t: {b.x: -(b.u[t] + b.u[t] ** 2 / 2) * b.x[t], b.y: b.u[t] * b.x[t]})
    m.product = pyo.Objective(expr=b.y[b.final_time], sense=pyo.maximize)
    return m


def consecutive_reactions(mesh=None, elements=None):
    """The best temperatures for the product in the middle: Ray, Advanced Process Control, 1981."""
    m = pyo.ConcreteModel(name="consecutive reactions")
    m.reactor = b = rcp.PhaseBlock(duration=1, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1)
    b.y = rcp.State(initial=0)
    b.temperature = rcp.Control(bounds=(298, 398), initial_guess=340)

    @b.ode
    def reactions(b, t):
        first = 4000 * pyo.exp(-2500 / b.temperature[t]) * b.x[t] ** 2
        return {b.x: -first, b.y: first - 6.2e5 * pyo.exp(-5000 / b.temperature[t]) * b.y[t]}

    m.product = pyo.Objective(expr=b.y[b.final_time], sense=pyo.maximize)
    return m


def protein_secretion(mesh=None, elements=None):
    """A fed-batch reactor: Park & Ramirez, AIChE J. 34 (1988) 1550; the value by Luus, 2000."""
    m = pyo.ConcreteModel(name="protein secretion")
    m.reactor = b = rcp.PhaseBlock(duration=15, mesh=mesh, elements=elements)
    b.secreted, b.total = rcp.State(initial=0), rcp.State(initial=0)
    b.cells = rcp.State(initial=1, initial_guess=1)
    b.glucose = rcp.State(initial=5, bounds=(0, None))
    b.volume = rcp.State(initial=1, initial_guess=5)
    b.feed = rcp.Control(bounds=(0, 2), initial_guess=1)

    @b.ode
    def reactor(b, t):
        glucose, cells, dilution = b.glucose[t], b.cells[t], b.feed[t] / b.volume[t]
        growth = 21.87 * glucose / ((glucose + 0.4) * (glucose + 62.5))
        secretion = 4.75 * growth / (0.12 + growth)
        expression = glucose / (0.1 + glucose) * pyo.exp(-5 * glucose)
        return {
            b.secreted: secretion * (b.total[t] - b.secreted[t]) - dilution * b.secreted[t],
            b.total: expression * cells - dilution * b.total[t],
            b.cells: (growth - dilution) * cells,
            b.glucose: -7.3 * growth * cells + dilution * (20 - glucose),
            b.volume: b.feed[t],
        }

    end = b.final_time
    m.protein = pyo.Objective(expr=b.secreted[end] * b.volume[end], sense=pyo.maximize)
    return m


def oil_shale(mesh=None, elements=None):
    """Pyrolysis by temperature in free time: Wen & Yen 1977; Luus, Iterative Dynamic Programming, 2000."""
    m = pyo.ConcreteModel(name="oil shale pyrolysis")
    m.reactor = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 30), initial_guess=9), mesh=mesh, elements=elements)
    factor = np.exp([8.86, 24.25, 23.67, 18.75, 20.70])
    energy = [20300, 37400, 33800, 28200, 31000]
    b.kerogen, b.bitumen = rcp.State(initial=1), rcp.State(initial=0)
    b.temperature = rcp.Control(bounds=(698.15, 748.15), initial_guess=720)

    @b.ode
    def pyrolysis(b, t):
        k = [float(a) * pyo.exp(-e / (1.9872 * b.temperature[t])) for a, e in zip(factor, energy, strict=True)]
        x, y = b.kerogen[t], b.bitumen[t]
        return {b.kerogen: -k[0] * x - (k[2] + k[3] + k[4]) * x * y, b.bitumen: k[0] * x - k[1] * y + k[2] * x * y}

    m.bitumen = pyo.Objective(expr=b.bitumen[b.final_time], sense=pyo.maximize)
    return m


def gas_oil(mesh=None, elements=None):
    """Three rates of catalytic cracking from 20 measurements: COPS 3.0, ANL/MCS-TM-273, problem 12."""
    times = [0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.65]
    times += [0.75, 0.85, 0.95]
    oil = [0.8105, 0.6208, 0.5258, 0.4345, 0.3903, 0.3342, 0.3034, 0.2735, 0.2405, 0.2283, 0.2071, 0.1669, 0.1530]
    oil += [0.1339, 0.1265, 0.1200, 0.0990, 0.0870, 0.0770, 0.0690]
    gasoline = [0.2000, 0.2886, 0.3010, 0.3215, 0.3123, 0.2716, 0.2551, 0.2258, 0.1959, 0.1789, 0.1457, 0.1198]
    gasoline += [0.0909, 0.0719, 0.0561, 0.0460, 0.0280, 0.0190, 0.0140, 0.0100]
    m = pyo.ConcreteModel(name="catalytic cracking")
    m.reactor = b = rcp.PhaseBlock(duration=0.95, mesh=[0.0, *times] if mesh is None else mesh)
    b.y = rcp.State(index=2, initial=[1, 0])
    b.rate = rcp.Parameter(index=3, bounds=(0, 20), initial_guess=1)

    @b.ode
    def cracking(b, t):
        (x, y), k = b.y[t], b.rate
        return {b.y: [-(k[0] + k[2]) * x**2, k[0] * x**2 - k[1] * y]}

    measured = zip(times, oil, gasoline, strict=True)
    misses = ((b.y[0, t] - first) ** 2 + (b.y[1, t] - second) ** 2 for t, first, second in measured)
    m.misfit = pyo.Objective(expr=sum(misses))
    return m
