"""Reeds-Shepp paths: the shortest paths of a car between two poses without obstacles; arcs, straight lines and cusps.

Reeds and Shepp, Optimal paths for a car that goes both forwards and backwards, Pacific Journal of Mathematics 145
(1990), section 8; formulas 8.1 to 8.11, doi:10.2140/pjm.1990.145.367. All functions work on arrays of
poses.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from pyrobocop_pyomo.numerics import Array, BoolArray

Formula = Callable[[Array, Array, Array], tuple[Array, Array, Array, BoolArray]]

SEGMENTS = 5
TURNS = {"L": 1.0, "S": 0.0, "R": -1.0}


def reeds_shepp_paths(x: Array, y: Array, heading: Array) -> Iterator[tuple[Array, Array, BoolArray]]:
    """All types of paths from the origin, heading along x, to poses; the turning radius is 1.

    Parameters
    ----------
    x, y, heading : (n,) arrays

    Yields
    ------
    turns : (5,) array
        1 for a left turn, 0 for a straight line, -1 for a right turn; zeros fill up.
    lengths : (n, 5) array
        Of each segment, negative where the car rolls backwards.
    exists : (n,) bool array
    """
    for formula, types, arranged, both_ends in FORMULAS:
        # Three symmetries: driven in reverse, seen in a mirror, and from the other end.
        for time, mirror, swapped in itertools.product((1.0, -1.0), (1.0, -1.0), (False, True)[: 1 + both_ends]):
            ahead = x * np.cos(heading) + y * np.sin(heading) if swapped else x
            aside = x * np.sin(heading) - y * np.cos(heading) if swapped else y
            first, middle, last, exists = formula(time * ahead, mirror * aside, time * mirror * heading)
            segments = [time * length for length in arranged(first, middle, last)]
            names = types[::-1] if swapped else types
            # Each segment's lengths side by side in memory, where all that follows reads them.
            lengths = np.zeros((SEGMENTS, len(x))).T
            for k, segment in enumerate(segments[::-1] if swapped else segments):
                lengths[:, k] = segment
            turns = np.zeros(SEGMENTS)
            turns[: len(names)] = [mirror * TURNS[name] for name in names]
            lengths[~exists] = 0.0
            yield turns, lengths, exists


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _left_straight_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    t = np.arctan2(across, along)
    v = _wrapped(phi - t)
    return t, np.hypot(along, across), v, (t >= 0) & (v >= 0)


def _left_straight_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    square = along**2 + across**2 - 4.0
    u = np.sqrt(np.maximum(square, 0.0))
    t = _wrapped(np.arctan2(across, along) + np.arctan2(2.0, u))
    v = _wrapped(t - phi)
    return t, u, v, (square >= 0) & (t >= 0) & (v >= 0)


def _left_right_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    reach = np.hypot(along, across)
    u = -2.0 * np.arcsin(np.minimum(reach / 4.0, 1.0))
    t = _wrapped(np.arctan2(across, along) + 0.5 * u + np.pi)
    return t, u, _wrapped(phi - t + u), (reach <= 4.0) & (t >= 0)


def _outer_turns(u: Array, v: Array, along: Array, across: Array, phi: Array) -> tuple[Array, Array]:
    delta = _wrapped(u - v)
    a, b = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1.0
    angle = np.arctan2(across * a - along * b, along * a + across * b)
    other = 2.0 * (np.cos(delta) - np.cos(v) - np.cos(u)) + 3.0
    t = _wrapped(np.where(other < 0, angle + np.pi, angle))
    return t, _wrapped(t - u + v - phi)


def _four_turns_inner_opposed(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = 0.25 * (2.0 + np.hypot(along, across))
    u = np.arccos(np.minimum(rho, 1.0))
    t, v = _outer_turns(u, -u, along, across, phi)
    return t, u, v, (rho <= 1.0) & (t >= 0) & (v <= 0)


def _four_turns_inner_alike(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = (20.0 - along**2 - across**2) / 16.0
    u = -np.arccos(np.clip(rho, 0.0, 1.0))
    t, v = _outer_turns(u, u, along, across, phi)
    return t, u, v, (rho >= 0) & (rho <= 1.0) & (t >= 0) & (v >= 0)


def _left_right_straight_left(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x - np.sin(phi), y - 1.0 + np.cos(phi)
    rho = np.hypot(along, across)
    r = np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    t = _wrapped(np.arctan2(across, along) + np.arctan2(r, -2.0))
    v = _wrapped(phi - 0.5 * np.pi - t)
    return t, 2.0 - r, v, (rho >= 2.0) & (t >= 0) & (r >= 2.0) & (v <= 0)


def _left_right_straight_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho, t = np.hypot(along, across), np.arctan2(along, -across)
    v = _wrapped(t + 0.5 * np.pi - phi)
    return t, 2.0 - rho, v, (rho >= 2.0) & (t >= 0) & (v <= 0)


def _left_right_straight_left_right(x: Array, y: Array, phi: Array) -> tuple[Array, Array, Array, BoolArray]:
    along, across = x + np.sin(phi), y - 1.0 - np.cos(phi)
    rho = np.hypot(along, across)
    u = 4.0 - np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    t = _wrapped(np.arctan2((4.0 - u) * along - 2.0 * across, -2.0 * along + (u - 4.0) * across))
    v = _wrapped(t - phi)
    return t, u, v, (rho >= 2.0) & (u <= 0) & (t >= 0) & (v >= 0)


QUARTER = 0.5 * np.pi

# Formula, its turns, where its three numbers go among the segments, and whether the other end gives another path.
FORMULAS: list[tuple[Formula, str, Callable[..., tuple], bool]] = [
    (_left_straight_left, "LSL", lambda t, u, v: (t, u, v), False),
    (_left_straight_right, "LSR", lambda t, u, v: (t, u, v), False),
    (_left_right_left, "LRL", lambda t, u, v: (t, u, v), True),
    (_four_turns_inner_opposed, "LRLR", lambda t, u, v: (t, u, -u, v), False),
    (_four_turns_inner_alike, "LRLR", lambda t, u, v: (t, u, u, v), False),
    (_left_right_straight_left, "LRSL", lambda t, u, v: (t, -QUARTER, u, v), True),
    (_left_right_straight_right, "LRSR", lambda t, u, v: (t, -QUARTER, u, v), True),
    (_left_right_straight_left_right, "LRSLR", lambda t, u, v: (t, -QUARTER, u, -QUARTER, v), False),
]
