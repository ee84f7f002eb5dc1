"""The car of the parking example, from random places in the street."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo

from .restating import restate

from parking import build  # isort: skip


def random_parking(seed: int, elements: int = 40, stages: int = 2, **options: Any) -> pyo.ConcreteModel:
    """From anywhere in the street, heading along it or nearly so; even seeds park in reverse, odd ones in parallel.

    The initial guess is the path of Hybrid A*, which is clear of everything.

    Parameters
    ----------
    seed : int
    elements, stages : int
        Of the transcription.
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    rng = np.random.default_rng(seed)
    start = (float(rng.uniform(-9, 9)), float(rng.uniform(6.5, 9.0)), float(rng.uniform(-0.25, 0.25)))
    m = build(("reverse", "parallel")[seed % 2], elements, stages, start)
    m.name = f"parking {seed}"
    restate(m.drive, **options)
    return m
