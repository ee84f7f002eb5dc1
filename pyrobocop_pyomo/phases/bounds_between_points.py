"""Declared bounds are rows at the points of the mesh; how far do the polynomials between these pass them?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Control, State
from .record import PhaseRecord

# Instants per element at which polynomials are evaluated, and the excess worth a sentence, in sizes of the signal.
SAMPLES, WORTH_A_SENTENCE = 24, 1e-3


class BoundPassed(NamedTuple):
    """By how much a polynomial passes a bound at most, when, which bound that is, and of what size of which signal."""

    excess: float
    time: float
    bound: float
    size: float
    is_control: bool


def bounds_passed(record: PhaseRecord, trajectory: Trajectory) -> dict[str, BoundPassed]:
    """States and controls whose polynomials pass their declared bounds between the points of the mesh.

    Bounds that are functions of time are left out, and what moves by step maps. At the points themselves bounds
    are rows of the model: what is violated there as well counts between them only for what is more.

    Parameters
    ----------
    record : PhaseRecord
    trajectory : Trajectory

    Returns
    -------
    dict of name to BoundPassed
        Sampled at 24 instants per element, so that an excess is found to about one percent of itself.
    """
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES
    times = (boundaries[:-1, None] + np.diff(boundaries)[:, None] * inside).ravel()
    values = trajectory(times)
    found: dict[str, BoundPassed] = {}
    for name in [*record.names(State), *record.names(Control)]:
        bounds = record.declarations[name].bounds
        if callable(bounds) or name in record.discrete_states or name not in values:
            continue
        at_points = trajectory.states[name] if name in trajectory.states else trajectory.signals[name]
        size = max(1e-3, float(np.abs(at_points).max(initial=0.0)))
        for bound, sign in zip(record.declarations[name].bounds_at(0.0, name), (-1.0, 1.0), strict=True):
            if bound is None or not np.isfinite(bound):
                continue
            beyond = sign * (np.asarray(values[name]) - bound)
            there = max(0.0, float((sign * (at_points - bound)).max(initial=0.0)))
            worst = int(beyond.argmax())
            excess = float(beyond[worst]) - there
            if excess > max(1e-9 * size, found[name].excess if name in found else 0.0):
                found[name] = BoundPassed(excess, float(times[worst]), float(bound), size, name in trajectory.signals)
    return found


def sentence_on_bounds(passed: Mapping[str, BoundPassed]) -> str:
    """Which bounds are passed by more than a thousandth of the signal's size, and what to do; empty where none is."""
    worth = {name: one for name, one in passed.items() if one.excess > WORTH_A_SENTENCE * one.size}
    if not worth:
        return ""
    ordered = sorted(worth, key=lambda name: -worth[name].excess / worth[name].size)
    shown = [
        f"'{name}' passes its bound {worth[name].bound:g} by {worth[name].excess:.2g} at t = {worth[name].time:.3g}"
        for name in ordered[:3]
    ]
    more = f" (and {len(ordered) - 3} more)" if len(ordered) > 3 else ""
    # Where a control jumps, its polynomial passes the bound on any mesh.
    some_states = not all(one.is_control for one in worth.values())
    remedies = [*(["more elements"] if some_states else []), "a bound with a margin"]
    if any(one.is_control for one in worth.values()):
        remedies.append("parametrization='piecewise_constant' for a control")
    return f"Between the points of the mesh {', '.join(shown)}{more}. What helps: {', or '.join(remedies)}."
