"""The quadrotor of the example, through a window of random place and size, between random ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo

from .restating import fix_ends, restate

from quadrotor_window import build, wall  # isort: skip


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
    restate(m.flight, obstacles=wall(0.0, width, height, *middle), **options)
    return m
