"""A room with a thermostat: the heater goes on below 19 degrees and off above 21; which power tracks 20 degrees best?

``T' = r - (T - 10) / 2`` with the heat r of a radiator, ``r' = 5 (P w - r)``, and a delayed relay w; min ``integral of (T - 20)^2`` plus
a price for power. The room goes on warming up for a while when the heater goes off, so that each threshold is really passed.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pyomo.environ as pyo
from scipy.optimize import minimize_scalar

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import DelayedRelay
from .hysteresis import add_delayed_relay
from .problem import NonsmoothProblem, at_boundaries

HORIZON, START, OUTSIDE, LOW, HIGH, TARGET = 3.0, 15.0, 10.0, 19.0, 21.0, 20.0
POWERS, PRICE, QUICKNESS = (7.0, 15.0), 0.5, 5.0


def build(elements: int = 50, stages: int = 1, scheme: str = "radau", *, detect: bool = False) -> pyo.ConcreteModel:
    """Temperatures relative to the target, hours; the power is the only thing to choose."""
    m = pyo.ConcreteModel(name="thermostat")
    m.phase = b = rcp.PhaseBlock(duration=HORIZON, elements=elements, stages=stages, scheme=scheme, moving=MOVING if detect else None)
    b.heat = rcp.State(initial=START - TARGET, guess=lambda t: min(0.0, 5 * t - 5))
    b.radiator = rcp.State(initial=0, guess=5)
    b.power = rcp.Parameter(bounds=POWERS, guess=10)
    high, low = HIGH - TARGET, LOW - TARGET
    memory = add_delayed_relay(b, "rested", lambda b, t: b.heat[t], high, low, memory=START - HIGH)

    @b.ode
    def room(b, t):
        warming = b.radiator[t] - (b.heat[t] + TARGET - OUTSIDE) / 2
        heating = QUICKNESS * (b.power * (1 - b.rested[t]) - b.radiator[t])
        return {b.heat: warming, b.radiator: heating, **memory(b, t)}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.heat[t] ** 2) + PRICE * b.power)
    if detect:
        detect_switches(m)
    return m


def simulate(power: float, boundaries) -> tuple[np.ndarray, list[float]]:
    """Temperature, radiator and cost so far, and when the heater is switched."""
    system = DelayedRelay(
        rates=lambda x, u, w: np.array(
            [x[1] - (x[0] + TARGET - OUTSIDE) / 2, QUICKNESS * (power * (1 - w) - x[1]), x[0] ** 2]
        ),
        signal=lambda x: x[0],
        on=HIGH - TARGET,
        off=LOW - TARGET,
    )
    return system.simulate(boundaries, [0.0] * (len(boundaries) - 1), [START - TARGET, 0.0, 0.0], output=0.0)


@cache
def optimum() -> float:
    """The best of all powers, by a scan and a search around its best."""
    def cost(power: float) -> float:
        return float(simulate(power, [0.0, HORIZON])[0][-1, 2]) + PRICE * power

    scanned = np.linspace(*POWERS, 37)
    best = scanned[np.argmin([cost(each) for each in scanned])]
    return float(minimize_scalar(cost, bounds=(best - 0.25, best + 0.25), method="bounded").fun)


def deviation(m: pyo.ConcreteModel) -> float:
    """From the motion with the plan's own power."""
    trajectory = m.phase.trajectory()
    true, _ = simulate(float(trajectory.power), trajectory.grid.mesh.boundaries)
    return float(np.abs(at_boundaries(trajectory, "heat", "radiator") - true[:, :2]).max())


PROBLEM = NonsmoothProblem("thermostat", build, deviation, optimum, accuracy=(0.05, 1.0))
