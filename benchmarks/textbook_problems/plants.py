"""Reactors and a greenhouse."""

from __future__ import annotations

from math import ceil

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

CATALYST = (  # of the rates k1 to k10: coefficients of 1, u, u^2 and u^3
    (0.002918487, -0.008045787, 0.006749947, -0.001416647),
    (9.509977, -35.00994, 42.83329, -17.33333),
    (26.82093, -95.56079, 113.0398, -44.29997),
    (208.7241, -719.8052, 827.7466, -316.6655),
    (1.350005, -6.850027, 12.16671, -6.666689),
    (0.01921995, -0.0794532, 0.1105666, -0.05033333),
    (0.1323596, -0.4696255, 0.5539323, -0.2166664),
    (7.339981, -25.27328, 29.93329, -11.99999),
    (-0.3950534, 1.679353, -1.777829, 0.4974987),
    (-2.504665e-5, 0.01005854, -0.01986696, 0.00983347),
)


def catalyst_rates(x, blend):
    """Of the seven species over a catalyst of this blend."""
    k = [sum(c * blend**i for i, c in enumerate(row)) for row in CATALYST]
    return [
        -k[0] * x[0],
        k[0] * x[0] - (k[1] + k[2]) * x[1] + k[3] * x[4],
        k[1] * x[1],
        -k[5] * x[3] + k[4] * x[4],
        k[2] * x[1] + k[5] * x[3] - (k[3] + k[4] + k[7] + k[8]) * x[4] + k[6] * x[5] + k[9] * x[6],
        k[7] * x[4] - k[6] * x[5],
        k[8] * x[4] - k[9] * x[6],
    ]


def bifunctional_catalyst(mesh=None, elements=None):
    """Ten blends along a reactor, hundreds of local optima: Luus, Dittrich & Keil 1992; Luus & Bojkov 1994."""
    m = pyo.ConcreteModel(name="bifunctional catalyst")
    m.reactor = b = rcp.PhaseBlock(duration=2000, mesh=mesh, elements=elements)
    b.x = rcp.State(index=7, initial=[1, 0, 0, 0, 0, 0, 0])
    b.blend = rcp.Parameter(index=10, bounds=(0.6, 0.9), initial_guess=0.75)

    @b.ode
    def reactions(b, t):
        blend = b.blend[max(0, ceil(t / 200 - 1e-9) - 1)]
        return {b.x: catalyst_rates(b.x[t], blend)}

    m.benzene = pyo.Objective(expr=b.x[6, b.final_time], sense=pyo.maximize)
    return m


def tanks_in_a_row(mesh=None, elements=None):
    """The second stirred tank feels the first 0.4 later: Oh & Luus 1976; Dadebo & Luus 1992; Luus 2000, sec. 6.3."""
    m = pyo.ConcreteModel(name="two tanks and a delay")
    m.tanks = b = rcp.PhaseBlock(duration=2, mesh=mesh, elements=elements)
    first = [0.15, -0.03]
    b.x = rcp.State(index=2, initial=first, history=first, initial_guess=first)
    b.y = rcp.State(index=2, initial=[0.10, 0], initial_guess=[0.10, 0])
    b.u = rcp.Control(index=2, bounds=(-0.5, 0.5))

    @b.ode
    def tanks(b, t):
        (x, hot), (y, warm), (u, w), (late, late_hot) = b.x[t], b.y[t], b.u[t], b.x.delayed(t, 0.4)
        reaction = (x + 0.5) * pyo.exp(25 * hot / (hot + 2))
        second = (y + 0.25) * pyo.exp(25 * warm / (warm + 2))
        return {
            b.x: [0.5 - x - reaction, -2 * (hot + 0.25) - u * (hot + 0.25) + reaction],
            b.y: [late - y - second + 0.25, late_hot - 2 * warm - w * (warm + 0.25) + second - 0.25],
        }

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] @ b.x[t] + b.y[t] @ b.y[t] + 0.1 * b.u[t] @ b.u[t]))
    return m


def greenhouse(mesh=None, elements=None):
    """Heat for lettuce, weather of two days as a table: van Straten et al., CRC Press 2010; the manual of PROPT."""
    m = pyo.ConcreteModel(name="greenhouse")
    m.days = b = rcp.PhaseBlock(duration=48, mesh=mesh, elements=elements)
    b.weight, b.temperature, b.spent = (
        rcp.State(initial=0),
        rcp.State(initial=10, initial_guess=10),
        rcp.State(initial=0),
    )
    b.heating = rcp.Control(bounds=(0, 10))
    hours = np.arange(-5, 246) / 5
    wave = rcp.Table(hours, np.sin(4 * np.pi * hours / 48 - 0.65 * np.pi), name="wave")

    @b.ode
    def climate(b, t):
        sun, outside = 800 * wave(t), 15 + 10 * wave(t)
        return {
            b.weight: 3e-6 / 40 * sun * b.temperature[t],
            b.temperature: outside - b.temperature[t] + 0.1 * b.heating[t],
            b.spent: 7.5e-2 / 220 * b.heating[t],
        }

    m.cost = pyo.Objective(expr=b.spent[b.final_time] - 3e4 / 220 * b.weight[b.final_time])
    return m


def long_reactor(mesh=None, elements=None):
    """Two catalysts mixed along a reactor four times as long: Jackson, JOTA 2 (1968) 1; BOCOP, also the guess."""
    m = pyo.ConcreteModel(name="long reactor")
    m.reactor = b = rcp.PhaseBlock(duration=4, mesh=mesh, elements=elements)
    b.x = rcp.State(index=3, initial=[1, 0, 0], bounds=(0, 1.1), initial_guess=0.1)
    b.mixture = rcp.Control(bounds=(0, 1), initial_guess=0.1)

    @b.ode
    def reactions(b, t):
        (x, y, _), u = b.x[t], b.mixture[t]
        return {b.x: [-u * (x - 10 * y), u * (x - 10 * y) - (1 - u) * y, (1 - u) * y]}

    m.product = pyo.Objective(expr=b.x[2, b.final_time], sense=pyo.maximize)
    return m
