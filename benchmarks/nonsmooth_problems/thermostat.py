"""A room with a thermostat: the heater goes off above 21 degrees and on again below 19. Nothing is left to choose.

``T' = r - (T - 10) / 2`` with the heat r of a radiator, ``r' = 5 (P w - r)``, and a delayed relay w. The room goes on
warming up for a while when the heater goes off, so that each threshold is really passed. A power to choose would make
it another problem: an optimiser lets the room touch 21 degrees without passing, where the relay may be anything.
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .detection import MOVING, detect_switches
from .filippov import DelayedRelay
from .hysteresis import add_delayed_relay
from .problem import NonsmoothProblem, at_boundaries

HORIZON, START, OUTSIDE, LOW, HIGH, TARGET = 3.0, 15.0, 10.0, 19.0, 21.0, 20.0
POWER, QUICKNESS = 12.0, 5.0


def build(
    elements: int = 50, stages: int = 2, scheme: str = "radau", *, moving: bool = False, detect: bool = False
) -> pyo.ConcreteModel:
    """Temperatures relative to 20 degrees, hours; the objective only measures the deviation from them."""
    m = pyo.ConcreteModel(name="thermostat")
    factors = MOVING if moving or detect else None
    m.phase = b = rcp.PhaseBlock(
        duration=HORIZON, elements=elements, stages=stages, scheme=scheme, free_element_widths=factors
    )
    b.heat = rcp.State(initial=START - TARGET, initial_guess=lambda t: min(0.0, 5 * t - 5))
    b.radiator = rcp.State(initial=0, initial_guess=5)
    high, low = HIGH - TARGET, LOW - TARGET
    memory = add_delayed_relay(b, "rested", lambda b, t: b.heat[t], high, low, memory=START - HIGH)

    @b.ode
    def room(b, t):
        warming = b.radiator[t] - (b.heat[t] + TARGET - OUTSIDE) / 2
        heating = QUICKNESS * (POWER * (1 - b.rested[t]) - b.radiator[t])
        return {b.heat: warming, b.radiator: heating, **memory(b, t)}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.heat[t] ** 2))
    if detect:
        detect_switches(m)
    return m


SYSTEM = DelayedRelay(
    rates=lambda x, u, w: np.array(
        [x[1] - (x[0] + TARGET - OUTSIDE) / 2, QUICKNESS * (POWER * (1 - w) - x[1]), x[0] ** 2]
    ),
    signal=lambda x: x[0],
    on=HIGH - TARGET,
    off=LOW - TARGET,
)


def simulate(boundaries) -> tuple[np.ndarray, list[float]]:
    """Temperature, radiator and cost so far, and when the heater is switched."""
    return SYSTEM.simulate(boundaries, [0.0] * (len(boundaries) - 1), [START - TARGET, 0.0, 0.0], output=0.0)


def optimum() -> float:
    """Of the only motion there is."""
    return float(simulate([0.0, HORIZON])[0][-1, 2])


def deviation(m: pyo.ConcreteModel) -> float:
    """From that motion."""
    trajectory = m.phase.trajectory()
    true, _ = simulate(trajectory.grid.mesh.boundaries)
    return float(np.abs(at_boundaries(trajectory, "heat", "radiator") - true[:, :2]).max())


PROBLEM = NonsmoothProblem("thermostat", build, deviation, optimum, accuracy=(0.03, 1.1))
