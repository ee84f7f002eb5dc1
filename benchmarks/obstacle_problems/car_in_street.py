"""The car of the parking example, from random places in the street; the car with a trailer in random warehouses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo

from .restating import restate

import car_with_trailer  # isort: skip
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


def random_warehouse(seed: int, elements: int = 40, stages: int = 2, **options: Any) -> pyo.ConcreteModel:
    """A car with a trailer in a warehouse, from a straight line.

    Parameters
    ----------
    seed : int
        The kind is its remainder by 3.
    elements, stages : int
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    m = car_with_trailer.build(elements=elements, stages=stages, scene=warehouse(seed))
    m.name = f"warehouse {seed}"
    restate(m.drive, exclude=[("car", "trailer")], **options)
    return m


def warehouse(seed: int) -> dict[str, Any]:
    """Start, goal and obstacles for a way into a bay in reverse, into the next aisle, or among pallets."""
    rng, box = np.random.default_rng([seed, 3]), car_with_trailer.box

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    if seed % 3 == 0:
        half, lane = between(1.3, 1.7), between(10, 13)
        start = (between(-11, -6), between(3, 0.6 * lane), between(-0.15, 0.15), between(-0.15, 0.15))
        goal = (0.0, between(-0.3, 1.0), 0.5 * math.pi, 0.0)
        obstacles = {
            "left": box(-16, -8, -half, 0), "right": box(half, -8, 16, 0), "dock": box(-half, -8, half, -6),
            "far side": box(-16, lane, 16, lane + 1),
        }  # fmt: skip
    elif seed % 3 == 1:
        half, deep, end = between(2.6, 3.2), between(0.7, 2.0), between(3, 6)
        middle = deep + half
        start = (between(-9, -5), between(-0.5, 0.5) - middle, 0.0, 0.0)
        goal = (between(-9, -5), between(-0.5, 0.5) + middle, math.pi, 0.0)
        obstacles = {
            "shelf": box(-16, -deep, end, deep), "lower": box(-16, -middle - half - 1, end, -middle - half),
            "upper": box(-16, middle + half, end, middle + half + 1),
            "wall": box(end + between(10, 13), -16, end + 14, 16),
        }  # fmt: skip
    else:
        start = (between(-14, -11), between(-4, 4), between(-0.4, 0.4), 0.0)
        goal = (between(11, 14), between(-4, 4), between(-0.4, 0.4), 0.0)
        obstacles = {}
        while len(obstacles) < 7:
            x, y, wide, deep = between(-8, 8), between(-8, 8), between(0.5, 1.3), between(0.5, 1.3)
            # Car and trailer stand at both ends, up to eight metres from the place that is given.
            if any(abs(x - end[0]) < 8.0 + wide and abs(y - end[1]) < 2.5 + deep for end in (start, goal)):
                continue
            obstacles[f"pallet {len(obstacles)}"] = box(x - wide, y - deep, x + wide, y + deep)
    return {"start": start, "goal": goal, "obstacles": obstacles}
