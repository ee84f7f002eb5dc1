"""Leading the guess of a motion around all obstacles at once, where poses are placed by variables of their own."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.motion.bodies import Body

from .formulations.rows import is_number
from .scene import Scene
from .ways_around import Core, way_around

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

# Share of a way over which its corners are rounded.
ROUNDED = 0.1


def reroute(block: Any) -> list[str]:
    """Lead bodies from where they start to where they end, clear of all obstacles that stand still.

    A body is led where it is placed by variables: rules such as ``planar_pose(b.x[t], b.y[t], b.theta[t])``. What is
    fixed, and how the body turns, stays as it is.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
        Its variables hold a guess of the motion.

    Returns
    -------
    list of str
        Names of the bodies that were led another way.
    """
    motion, scene = block.motion, block.record.scene
    nodes = list(dict.fromkeys(node for interval in motion.intervals for node in interval))
    if len(nodes) < 3:
        return []
    led = []
    for name, body in scene.bodies.items():
        if name in scene.obstacles or not body.moves:
            continue
        poses = [motion.pose_at_node(body.pose, node, name=name) for node in nodes]
        entries = [pose.translation for pose in poses]
        free = [entry for place in entries for entry in place if not (is_number(entry) or _is_variable(entry))]
        if free or not any(_is_variable(entry) and not entry.fixed for place in entries for entry in place):
            continue
        numbers = [pose.numbers() for pose in poses]
        places = _places(block, scene, name, body, numbers, entries)
        if places is None:
            logger.info("'%s': no way around was found for '%s'.", block.name, name)
            continue
        for place, target in zip(entries, places, strict=True):
            for entry, number in zip(place, target.tolist(), strict=True):
                if _is_variable(entry) and not entry.fixed:
                    lower, upper = entry.bounds
                    entry.set_value(min(max(number, _or(lower, number)), _or(upper, number)), skip_validation=True)
        led.append(name)
    return led


def _places(block: Any, scene: Scene, name: str, body: Body, numbers: Any, entries: Any) -> Array | None:
    """Translations (nodes, d) along the way, as far along it as the guess is along its own; None without a way."""
    core = _core(scene, name)
    walls = [
        part.shape
        for pair in scene.body_pairs
        if name in pair
        for part in scene.parts_of(pair[0] if pair[1] == name else pair[1])
        if scene.is_static(part.body)
    ]
    if not walls:
        return None
    arms = np.array([rotation @ core.middle for rotation, _ in numbers])
    before = np.array([place for _, place in numbers]) + arms
    clearance = max(value for pair, value in scene.clearances.items() if name in pair)
    low, high = _region(before, core, clearance, entries, arms)
    way = way_around(before[0], before[-1], core, walls, clearance, low, high)
    return None if way is None else _along(way, before) - arms


def _core(scene: Scene, name: str) -> Core:
    """Of the part with most inside: a union of parts is led by it."""
    return max((Core.of(part.shape) for part in scene.parts_of(name)), key=lambda core: core.inner)


def _region(before: Array, core: Core, clearance: float, entries: Any, arms: Array) -> tuple[Array, Array]:
    """What is searched: around the guess by its own extent and twice the body's, and within the variables' bounds."""
    beyond = 0.5 * float(np.ptp(before, axis=0).max()) + 2 * (core.outer + clearance)
    low, high = before.min(axis=0) - beyond, before.max(axis=0) + beyond
    middle = len(entries) // 2
    for axis, entry in enumerate(entries[middle]):
        if _is_variable(entry):
            lower, upper = entry.bounds
            reach = np.abs(arms[:, axis]).max()
            low[axis] = max(low[axis], _or(lower, -np.inf) - reach)
            high[axis] = min(high[axis], _or(upper, np.inf) + reach)
    return np.minimum(low, before.min(axis=0)), np.maximum(high, before.max(axis=0))


def _along(way: Array, before: Array) -> Array:
    """Points (nodes, d) of a way, rounded, at the shares of its length at which the guess is of its own."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(before, axis=0), axis=1))])
    shares = lengths / lengths[-1] if lengths[-1] > 0 else np.linspace(0, 1, len(before))
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    fine = np.linspace(0.0, 1.0, 20 * len(before) + 1)
    line = np.stack([np.interp(fine * passed[-1], passed, column) for column in way.T], axis=1)
    width = max(int(ROUNDED * len(fine)) // 2, 1)
    padded = np.vstack([np.repeat(line[:1], width, axis=0), line, np.repeat(line[-1:], width, axis=0)])
    window = np.ones(2 * width + 1) / (2 * width + 1)
    smooth = np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=1)
    return np.stack([np.interp(shares, fine, column) for column in smooth.T], axis=1)


def _is_variable(entry: Any) -> bool:
    return not is_number(entry) and entry.is_variable_type()


def _or(bound: float | None, otherwise: float) -> float:
    return otherwise if bound is None else float(bound)
