"""What swings back, and what lives in a body."""

from __future__ import annotations

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


def rayleigh_with_mixed_limit(mesh=None, elements=None):
    """An electric oscillator, voltage and current limited together: Maurer & Augustin 2001; Betts 2010, example 4.6."""
    m = pyo.ConcreteModel(name="Rayleigh problem with a mixed limit")
    m.p = b = rcp.PhaseBlock(duration=4.5, mesh=mesh, elements=elements)
    b.y = rcp.State(index=2, initial=-5, initial_guess=-5)
    b.u = rcp.Control()
    b.ode(lambda b, t: {b.y: [b.y[1, t], -b.y[0, t] + b.y[1, t] * (1.4 - 0.14 * b.y[1, t] ** 2) + 4 * b.u[t]]})
    b.constraint(lambda b, t: b.u[t] + b.y[0, t] / 6 <= 0)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.y[0, t] ** 2))
    return m


def van_der_pol_with_limit(mesh=None, elements=None):
    """A limited speed: Vassiliadis, Sargent & Pantelides, Ind. Eng. Chem. Res. 33 (1994) 2123; PROPT."""
    m = pyo.ConcreteModel(name="van der Pol oscillator with a limit")
    m.p = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    b.x, b.y = rcp.State(initial=0, bounds=(-0.4, None)), rcp.State(initial=1)
    b.u = rcp.Control(bounds=(-0.3, 1))
    b.ode(lambda b, t: {b.x: (1 - b.y[t] ** 2) * b.x[t] - b.y[t] + b.u[t], b.y: b.x[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.y[t] ** 2 + b.u[t] ** 2))
    return m


def delayed_oscillator(mesh=None, elements=None):
    """A spring and a damper that act in part a quarter of a second late: Luus 2002; the manual of PSOPT."""
    m = pyo.ConcreteModel(name="delayed oscillator")
    m.p = b = rcp.PhaseBlock(duration=5, mesh=mesh, elements=elements)
    b.x = rcp.State(initial=1, history=1, initial_guess=1, bounds=(-100, 100))
    b.v = rcp.State(initial=1, history=1, initial_guess=1, bounds=(-100, 100))
    b.u = rcp.Control(bounds=(-100, 100))

    @b.ode
    def motion(b, t):
        late = -2 * b.x.delayed(t, 0.25) - b.v.delayed(t, 0.25)
        return {b.x: b.v[t], b.v: -10 * b.x[t] - 5 * b.v[t] + late + b.u[t]}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (10 * b.x[t] ** 2 + b.v[t] ** 2 + b.u[t] ** 2) / 2))
    return m


def immunology(mesh=None, elements=None):
    """Two treatments of HIV: Joshi, Optimal Control Appl. Meth. 23 (2002) 199, doi:10.1002/oca.710; Betts 2010."""
    m = pyo.ConcreteModel(name="treatment of HIV")
    m.p = b = rcp.PhaseBlock(duration=50, mesh=mesh, elements=elements)
    b.cells = rcp.State(initial=400, bounds=(0, 1200), initial_guess=400)
    b.virus = rcp.State(initial=3, bounds=(0.05, 5), initial_guess=3)
    b.u = rcp.Control(index=2, bounds=(0, [0.02, 0.9]))

    @b.ode
    def infection(b, t):
        cells, virus, (u, w) = b.cells[t], b.virus[t], b.u[t]
        source = 2 - 1.5 * virus / (14 + virus) - 0.002 * cells - 2.5e-4 * virus * cells + u * cells
        return {b.cells: source, b.virus: 30 * (1 - w) * virus / (1 + virus) - 0.007 * virus * cells}

    benefit = b.integral(lambda b, t: b.cells[t] - 2.5e5 * b.u[0, t] ** 2 - 75 * b.u[1, t] ** 2)
    m.benefit = pyo.Objective(expr=benefit, sense=pyo.maximize)
    return m
