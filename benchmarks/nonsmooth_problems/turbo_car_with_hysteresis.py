"""The car with turbo whose charger has hysteresis: on above 15 m/s, off again only below 10 m/s.

So it brakes with the turbo down to 10 m/s, and stops sooner than the car without memory.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import DelayedRelay
from .hysteresis import add_delayed_relay
from .problem import NonsmoothProblem, at_boundaries, element_controls

DISTANCE, FASTEST, ON, OFF, PLAIN, FACTOR = 200.0, 25.0, 15.0, 10.0, 5.0, 3.0


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Speeds in units of 10 m/s, distances in units of 100 m."""
    m = pyo.ConcreteModel(name="turbo car with hysteresis")
    duration = rcp.Duration(bounds=(1, 40), initial_guess=15)
    m.phase = b = rcp.PhaseBlock(
        duration=duration,
        elements=elements,
        stages=stages,
        scheme=scheme,
        free_element_widths=MOVING if moving or detect else None,
    )
    b.x = rcp.State(initial=0, final=DISTANCE / 100, initial_guess=lambda t: DISTANCE / 100 * t)
    b.v = rcp.State(initial=0, final=0, bounds=(0, FASTEST / 10), initial_guess=1)
    b.u = rcp.Control(bounds=(-1, 1), parametrization="piecewise_constant")
    memory = add_delayed_relay(b, "turbo", lambda b, t: b.v[t], ON / 10, OFF / 10, memory=-ON / 10)

    @b.ode
    def car(b, t):
        push = PLAIN / 10 * b.u[t] * (1 + (FACTOR - 1) * b.turbo[t])
        return {b.x: b.v[t] / 10, b.v: push, **memory(b, t)}

    m.time = pyo.Objective(expr=b.duration)
    if detect:
        detect_switches(m)
    return m


def optimum() -> float:
    """Up through the upper threshold, at the highest speed, down through the lower one."""
    seconds, metres = 0.0, 0.0
    for threshold in (ON, OFF):
        seconds += threshold / PLAIN + (FASTEST - threshold) / (PLAIN * FACTOR)
        metres += threshold**2 / (2 * PLAIN) + (FASTEST**2 - threshold**2) / (2 * PLAIN * FACTOR)
    return seconds + (DISTANCE - metres) / FASTEST


SYSTEM = DelayedRelay(
    rates=lambda x, u, w: np.array([x[1] / 10, PLAIN / 10 * u * (1 + (FACTOR - 1) * w)]),
    signal=lambda x: x[1],
    on=ON / 10,
    off=OFF / 10,
)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion under the plan's own control, with a relay that switches by events."""
    trajectory = m.phase.trajectory()
    states = at_boundaries(trajectory, "x", "v")
    true, _ = SYSTEM.simulate(trajectory.grid.mesh.boundaries, element_controls(trajectory, "u"), states[0], output=0.0)
    return float(np.abs(states - true).max())


PROBLEM = NonsmoothProblem("turbo car with hysteresis", build, deviation, optimum, accuracy=(0.03, 0.5))
