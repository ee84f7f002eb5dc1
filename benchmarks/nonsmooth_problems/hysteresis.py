"""A relay with memory as complementarity: the step of a play operator.

Let z follow a signal s with play: it stays put while ``s - on <= z <= s - off`` and is dragged along by the side that
it touches. Then z passes zero upwards exactly where s rises to `on`, and downwards where s falls to `off`: the
Heaviside step of z is the delayed relay. The play is a sweeping process,

    z' = p - n,   0 <= p ⟂ z - (s - on) >= 0,   0 <= n ⟂ (s - off) - z >= 0,

so that both are stated with four pairs and no jump of a state. Where the signal turns back exactly on a threshold,
because of the switch itself, z rests at zero and the step may be anything: a signal has to pass its thresholds.

Brokate & Sprekels, Hysteresis and Phase Transitions (1996), ch. 2, doi:10.1007/978-1-4612-4048-8 (play and relay)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pyrobocop_pyomo as rcp

from .switches import Rule, add_pair, add_step


def add_delayed_relay(
    b: rcp.PhaseBlock, name: str, signal: Rule, on: float, off: float, memory: float
) -> Callable[[Any, float], dict]:
    """Declare the relay ``b.<name>[t]`` in [0, 1] and its memory ``b.<name>_memory``, which starts at a given value.

    Returns the equation of the memory, ``equation(b, t) = {state: rate}``, to be merged into the phase's own.
    """
    z, rise, fall = f"{name}_memory", f"{name}_rise", f"{name}_fall"
    b.declare(z, rcp.State(initial=memory, initial_guess=memory))
    b.declare(rise, rcp.Algebraic(bounds=(0, None)))
    b.declare(fall, rcp.Algebraic(bounds=(0, None)))

    add_pair(b, f"{name}_drag_up", lambda b, t: getattr(b, z)[t] - signal(b, t) + on, lambda b, t: getattr(b, rise)[t])
    add_pair(
        b, f"{name}_drag_down", lambda b, t: signal(b, t) - off - getattr(b, z)[t], lambda b, t: getattr(b, fall)[t]
    )
    add_step(b, name, lambda b, t: getattr(b, z)[t], initial_guess=0.5)
    return lambda b, t: {getattr(b, z): getattr(b, rise)[t] - getattr(b, fall)[t]}
