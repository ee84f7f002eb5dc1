"""The quadrotor of the example, through a window of random place and size, between random ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .restating import fix_ends, restate

from quadrotor_window import THICKNESS, WALL, build  # isort: skip


def random_flight(seed: int, elements: int = 20, stages: int = 2, **options: Any) -> pyo.ConcreteModel:
    """A flight from rest to rest on the other side of a wall; the initial guess is a straight line.

    The window is 0.8 m to 1.2 m wide and 0.4 m to 0.8 m high, with its middle up to 0.5 m off the axis, and the ends
    are up to 0.8 m off: most straight lines run into the wall, which is 0.1 m thick.

    Parameters
    ----------
    seed : int
    elements, stages : int
        Of the transcription.
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(0.8, 1.2), rng.uniform(0.4, 0.8)
    middle = rng.uniform(-0.5, 0.5, 2)
    start = {"x": rng.uniform(-1.8, -1.0), "y": rng.uniform(-0.8, 0.8), "z": rng.uniform(-0.8, 0.8)}
    goal = {"x": rng.uniform(1.0, 1.8), "y": rng.uniform(-0.8, 0.8), "z": rng.uniform(-0.8, 0.8)}
    m = build("low", elements, stages)
    m.name = f"flight {seed}"
    fix_ends(m.flight, start, goal)
    m.flight.initialize_straight_lines()
    restate(m.flight, obstacles=wall_with_window(width, height, *middle), **options)
    return m


def wall_with_window(width: float, height: float, y: float, z: float) -> dict[str, rcp.Polytope]:
    """Four boxes around an opening with its middle at (y, z)."""
    left, right, top, bottom = y + width / 2, y - width / 2, z + height / 2, z - height / 2
    return {
        "left": _box(left, WALL, -WALL, WALL),
        "right": _box(-WALL, right, -WALL, WALL),
        "above": _box(right, left, top, WALL),
        "below": _box(right, left, -WALL, bottom),
    }


def _box(y_low: float, y_high: float, z_low: float, z_high: float) -> rcp.Polytope:
    centre = (0.0, (y_low + y_high) / 2, (z_low + z_high) / 2)
    return rcp.Polytope.box(THICKNESS, y_high - y_low, z_high - z_low, center=centre)
