"""An adversary for safety: motions beside obstacles are spoilt between the points of the mesh, and simulated densely.

The law. Where ``result.safe is True``, the motion of the equations as stated, under the controls of the plan, keeps the
clearance at all times: to the tolerance of the proof, a hundredth of the clearance, which is documented. What is
refused, not called safe, or not known, is never wrong; but of the motions that are not spoilt and have no pairs at most
one in ten may be.

A ball is drawn towards a wall, or past two discs, and rides on the clearance: whatever leads away from the plan in
between collides. Each motion is stated twice: in Pyomo, as a user writes it, and as a function of numbers, which the
judge integrates from break to break with small steps. The judge takes the values of the controls from the model, and
their polynomials from their nodes; of the package it uses nothing.
"""

import enum
import logging
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

from pyrobocop_pyomo.errors import PyRobocopError

from .motions import CLEARANCE, RADIUS, SPOILERS, UNSPOILT, Motion
from .outcome import Trial

# What a proof may miss of the clearance, and what rounding and the judge's integration may.
TOLERANCE = 0.01 * CLEARANCE + 1e-6
STEPS = 40  # of the judge, at least, in each element


class Verdict(enum.Enum):
    """What became of a motion."""

    REFUSED = "refused"
    NOT_SAFE = "not safe"
    NOT_KNOWN = "not known"
    TRUE = "safe, true"
    FAULT = "fault"


# ---------------------------------------------------------------------------------------- the judge


def smallest_distance(motion: Motion) -> float:
    """Of the ball from the obstacles, in the motion of the equations under the controls on the model."""
    m = motion.model
    state, least = np.zeros(2), np.inf
    past = [(0.0, lambda t: getattr(m, "history_of_the_judge", 0.0))]
    for low, high, values, beside in _pieces(motion):
        control = _interpolated(np.array(list(values)), np.array(list(values.values())))
        breaks = [t for t in motion.breaks if low < t < high]
        for first, last in zip([low, *breaks], [*breaks, high], strict=True):

            def rates(
                t: float, s: np.ndarray, of: Any = control, ends: tuple[float, float] = (first, last)
            ) -> list[float]:
                inside = min(max(t, np.nextafter(*ends)), np.nextafter(*ends[::-1]))
                before = _past(past, t - motion.delay) if motion.delay else 0.0
                return [1.0, of(t) + motion.drift(inside, s[1], before)]

            found = solve_ivp(
                rates, (first, last), state, max_step=(high - low) / STEPS, rtol=1e-9, atol=1e-11, dense_output=True
            )
            assert found.success
            state = found.y[:, -1]
            past.append((last, found.sol))
            times = np.linspace(first, last, 4 * len(found.t))
            if beside:
                places = found.sol(times).T - motion.shift(times)
                least = min(least, _distance(m.obstacles_of_the_judge, places))
    return least


def _pieces(motion: Motion) -> Iterator[tuple[float, float, dict[float, float], bool]]:
    """Start, end and values of the control of each element, in times of the whole motion, and whether it is judged."""
    if motion.pieces is not None:
        yield from ((*piece, True) for piece in motion.pieces())
    end = 0.0
    for b in motion.phases:
        boundaries = b.grid.mesh.boundaries
        later = end - boundaries[0]  # a clock may start again
        for (low, high), stages in zip(pairwise(boundaries), b.grid.stage_times, strict=True):
            values = {t + later: b.u[t].value or 0.0 for t in stages}
            yield low + later, high + later, values, b is motion.phases[-1]
        end = boundaries[-1] + later


def _interpolated(times: np.ndarray, values: np.ndarray) -> Callable[[float], float]:
    if len(times) == 1:
        return lambda t: float(values[0])
    of = Polynomial.fit(times, values, len(times) - 1) if len(times) < 4 else BarycentricInterpolator(times, values)
    return lambda t: float(of(t))


def _past(pieces: list[tuple[float, Any]], time: float) -> float:
    if time <= 0.0 or len(pieces) == 1:
        return float(pieces[0][1](time))
    for end, of in pieces[1:]:
        if time <= end + 1e-12:
            return float(of(time)[1])
    return float(pieces[-1][1](time)[1])


def _distance(obstacles: dict[str, Any], places: np.ndarray) -> float:
    """Of a ball from balls and boxes along the axes."""
    least = np.inf
    for shape in obstacles.values():
        if len(shape.vertices) == 1:
            found = np.hypot(*(places - shape.vertices[0]).T) - shape.radius
        else:
            low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            outside = np.maximum(np.maximum(low - places, places - high), 0.0)
            inside = np.minimum(np.maximum(low - places, places - high).max(axis=1), 0.0)
            found = np.hypot(*outside.T) + inside
        least = min(least, float(found.min()) - RADIUS)
    return least


# ---------------------------------------------------------------------------------------- a trial


def tried(seed: int, only: str | None = None) -> Trial:
    """Build, solve, change what changes afterwards, and judge; the spoilers take turns."""
    name = only or list(SPOILERS)[seed % len(SPOILERS)]
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)
    try:
        verdict, told, clear = _judged(name, np.random.default_rng(seed))
    finally:
        logging.disable(level)
    return Trial(seed, name, verdict, " ".join(told.split())[:300], clear=clear)


def _judged(name: str, random: np.random.Generator) -> tuple[Verdict, str, bool | None]:
    try:
        motion = SPOILERS[name](random)
        result = motion.solve(motion.model)
    except PyRobocopError as error:
        return Verdict.REFUSED, str(error), None
    motion.later()
    told = "\n".join(str(getattr(result, "safety", result)).splitlines()[:2])
    if result.safe is not True and name not in UNSPOILT:
        return Verdict.NOT_SAFE if result.safe is False else Verdict.NOT_KNOWN, told, None
    distance = smallest_distance(motion)
    clear = distance >= CLEARANCE - TOLERANCE
    if result.safe is not True:
        return Verdict.NOT_SAFE if result.safe is False else Verdict.NOT_KNOWN, told, clear
    if clear:
        return Verdict.TRUE, f"{distance:.6f}", clear
    return Verdict.FAULT, f"called safe, comes as close as {distance:.6f} of {CLEARANCE:g}: {told}", clear
