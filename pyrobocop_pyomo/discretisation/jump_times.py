"""Where inside an element a control or an algebraic jumps: there a better mesh has a boundary."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.trajectories import Trajectory

# A jump is as large a part of what the signal does at all, and what it does beside the jump is as small a part of it.
_JUMP, _QUIET = 0.2, 0.25
# As a part of the jump: a value that is as near to one of its sides belongs to it.
_SIDE = 1e-3
# Not nearer to the ends of the element than this part of it.
_MARGIN = 0.01


def jump_fractions(trajectory: Trajectory) -> dict[int, float]:
    """Local fractions of jumps, by the number of the element; of several in one element, the largest.

    Inside an element a polynomial cannot jump, but the integral of what it does is that of the jump nearly: the states
    at the element's end need it. From a level `a` of the element before to a level `c` of the one after, with the mean
    `m` in the element, the jump is at the fraction ``(c - m) / (c - a)``.

    Parameters
    ----------
    trajectory : Trajectory
    """
    found: dict[int, tuple[float, float]] = {}
    for name in trajectory.signals:
        values = trajectory.element_signals(name)
        size = float(np.ptp(values))
        if size > 0.0:
            for element, fraction, jump in _jumps(values, trajectory.grid.scheme.b, size):
                if element not in found or jump / size > found[element][1]:
                    found[element] = (fraction, jump / size)
    return {element: fraction for element, (fraction, _) in found.items()}


def _jumps(values: Array, weights: Array, size: float) -> list[tuple[int, float, float]]:
    """Element, fraction and size of each jump of one signal, from its values of shape ``(N, s)``."""
    jumps = []
    for i in range(1, len(values) - 1):
        before, here, after = values[i - 1 : i + 2]
        first, last = float(before[-1]), float(after[0])
        jump = last - first
        if abs(jump) < _JUMP * size or max(np.ptp(before), np.ptp(after)) > _QUIET * abs(jump):
            continue
        done = (here - first) / jump
        inside = (done > -_SIDE).all() and (done < 1.0 + _SIDE).all()
        on_one_side = (done < _SIDE).all() or (done > 1.0 - _SIDE).all()
        fraction = 1.0 - float(weights @ done)
        if inside and not on_one_side and _MARGIN < fraction < 1.0 - _MARGIN:
            jumps.append((i, fraction, abs(jump)))
    return jumps
