"""A path of a car as the guess of a phase: states and controls as functions of its time index."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import GuessError
from pyrobocop_pyomo.phases.horizon import horizon_fraction

if TYPE_CHECKING:
    from .car_path import CarPath

Array = NDArray[np.float64]
Function = Callable[[float], float]

QUANTITIES = ("x", "y", "theta", "v", "steering", "acceleration", "steering_rate")
# Of the duration: over how much of it a jump of the steering is spread where a rate is asked for.
BLEND = 0.05


def car_guess(
    path: CarPath, phase: Any, speed: float, acceleration: float | None, names: Mapping[str, str] | None
) -> dict[str, Function | float]:
    """What `CarPath.guess` returns."""
    known = _names(phase, names)
    timing = path.timed(speed, acceleration)
    free = phase.component("duration")
    free = free if free is not None and free.ctype is Var and not free.fixed else None
    duration = timing.duration if free is None else _within(timing.duration, free.bounds)
    real = duration if free is not None else float(value(phase.duration))
    stretch = timing.duration / real
    fraction = horizon_fraction(phase)
    turned = _whole_turns(path, phase, known.get("theta"))
    blend = BLEND * timing.duration if "steering_rate" in known else 0.0
    steering, steering_rate = _blended_steering(path, timing.way_at, timing.duration, blend)

    def pose(k: int) -> Callable[[float], float]:
        return lambda t: float(path.at(timing.way_at(t))[k])

    of_path: dict[str, Callable[[float], float]] = {
        "x": pose(0),
        "y": pose(1),
        "theta": lambda t: pose(2)(t) + turned,
        "v": lambda t: stretch * float(timing.velocity_at(t)),
        "steering": steering,
        "acceleration": lambda t: stretch**2 * float(timing.acceleration_at(t)),
        "steering_rate": lambda t: stretch * steering_rate(t),
    }

    def over_index(function: Callable[[float], float]) -> Function:
        return lambda t: function(timing.duration * fraction(t))

    guess: dict[str, Function | float] = {name: over_index(of_path[quantity]) for quantity, name in known.items()}
    if free is not None:
        guess["duration"] = duration
    return guess


def _names(phase: Any, names: Mapping[str, str] | None) -> dict[str, str]:
    if names is None:
        found = {quantity: quantity for quantity in QUANTITIES if phase.component(quantity) is not None}
        if not found:
            raise GuessError(
                f"phase '{phase.name}' has none of {', '.join(QUANTITIES)}. Say what it calls them: "
                "names={'x': 'position_x', ...}."
            )
        return found
    for quantity, name in names.items():
        if quantity not in QUANTITIES:
            raise GuessError(f"names: '{quantity}' is not known of a car's path; known are {', '.join(QUANTITIES)}.")
        if phase.component(name) is None:
            raise GuessError(f"names: '{quantity}' is to be '{name}', which phase '{phase.name}' does not have.")
    return dict(names)


def _whole_turns(path: CarPath, phase: Any, name: str | None) -> float:
    """What is added to all headings so that the first is that of the phase.

    Raises
    ------
    GuessError
        When the last heading is then whole turns from one that is fixed: a model cannot get there by this path.
    """
    if name is None:
        return 0.0
    heading = phase.component(name)
    first, last = heading[phase.time.first()], heading[phase.time.last()]
    full = 2.0 * math.pi
    turned = full * round((first.value - path.poses[0, 2]) / full) if first.fixed and first.value is not None else 0.0
    end = float(path.poses[-1, 2]) + turned
    if last.fixed and last.value is not None and round((last.value - end) / full) != 0:
        raise GuessError(
            f"phase '{phase.name}': this path ends with the heading {end:.6g}, and '{name}' is fixed at "
            f"{last.value:.6g} there, {abs(round((last.value - end) / full))} whole turn(s) away. State "
            f"final={end:.6g} for '{name}', or add whole turns to its initial value."
        )
    return turned


def _blended_steering(
    path: CarPath, way_at: Callable[..., Array], duration: float, blend: float
) -> tuple[Function, Function]:
    """Steering and its rate: with a blend, the mean over a window of time, whose derivative is a difference."""

    def held(t: float) -> float:
        return float(path.steering[path.piece_at(way_at(t))])

    if blend == 0.0:
        return held, lambda t: 0.0
    times = np.linspace(0.0, duration, 2000)
    sampled = path.steering[path.piece_at(way_at(0.5 * (times[:-1] + times[1:])))]
    sums = np.concatenate([[0.0], np.cumsum(sampled * np.diff(times))])

    def window(t: float) -> tuple[float, float]:
        return max(t - 0.5 * blend, 0.0), min(t + 0.5 * blend, duration)

    def mean(t: float) -> float:
        low, high = window(t)
        return float((np.interp(high, times, sums) - np.interp(low, times, sums)) / (high - low))

    def rate(t: float) -> float:
        near = 1e-3 * blend
        low, high = max(t - near, 0.0), min(t + near, duration)
        return (mean(high) - mean(low)) / (high - low)

    return mean, rate


def _within(number: float, bounds: tuple[float | None, float | None]) -> float:
    lower, upper = bounds
    return min(max(number, -math.inf if lower is None else lower), math.inf if upper is None else upper)
