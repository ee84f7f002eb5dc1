"""`RequiredClearance`: the distance that a body pair has to keep, at any instant and bounded on subintervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import NumericValue, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_slips import slips_explained
from pyrobocop_pyomo.numerics import Array, Indices

from .motion import Motion
from .rules_along_motion import SignalFormulas, formulas_between

_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class RequiredBounds:
    """The required clearance on ``m`` subintervals.

    Attributes
    ----------
    at_start, at_end : array, shape (m,)
    highest : array, shape (m,)
        Nowhere on the subinterval is more required.
    lowest_curvature : array, shape (m,)
        Lower bound of the second derivative with respect to the local fraction.
    """

    at_start: Array
    at_end: Array
    highest: Array
    lowest_curvature: Array

    def subset(self, chosen: Any) -> RequiredBounds:
        """Bounds on some of the subintervals."""
        return RequiredBounds(*(of[chosen] for of in vars(self).values()))


@dataclass(frozen=True, eq=False)
class RequiredClearance:
    """The distance that a body pair has to keep along a motion; made by `required_clearance`.

    Attributes
    ----------
    least : float
        The least of its values at the nodes.
    formulas : SignalFormulas or None
        None where the same distance is required at all times.
    mismatch : array, shape (intervals,), or 0
        Largest difference of the formulas from the rule at the nodes of each interval, where signals jump.
    """

    least: float
    formulas: SignalFormulas | None = None
    mismatch: Array | float = 0.0

    def values(self, interval: Indices, fraction: Array) -> Array:
        """What is required at local fractions of intervals, shape ``(m,)``."""
        if self.formulas is None:
            return np.full(len(interval), self.least)
        return self.formulas.values(interval, fraction)[:, 0]

    def bounds(self, interval: Indices, start: Array, end: Array) -> RequiredBounds:
        """Bounds on subintervals ``[start, end]`` of intervals."""
        if self.formulas is None:
            constant = np.full(len(interval), self.least)
            return RequiredBounds(constant, constant, constant, np.zeros(len(interval)))
        (form,) = self.formulas.taylor_forms(interval, start, end)
        at_start, at_end = self.values(interval, start), self.values(interval, end)
        # Where the graph is convex, it is nowhere above its ends.
        low = form.second.low
        above = np.maximum(at_start, at_end) + (end - start) ** 2 / 8.0 * np.maximum(-low, 0.0)
        rounding = 64 * _EPS * (np.abs(at_start) + np.abs(at_end))
        # fmin: a bound that is not known does not remove the other.
        return RequiredBounds(at_start, at_end, np.fmin(above + rounding, form.value.high), low)


def required_clearance(motion: Motion, asked: Any, pair: tuple[str, str]) -> RequiredClearance:
    """The clearance of a body pair at the current values of the model.

    Parameters
    ----------
    motion : Motion
        With intervals.
    asked : number, Param, Var, expression or callable
        A rule is called as ``rule(block, t)``, like that of a pose.
    pair : (str, str)
        Names of the two bodies, for messages.

    Raises
    ------
    ObstacleError
        Naming the body pair, where the clearance has no value or cannot be followed between the nodes.
    """
    what = clearance_text(pair)
    if not is_clearance_rule(asked):
        return RequiredClearance(clearance_value(asked, what))
    with slips_explained(asked, what, motion.block, ("b", "t"), ObstacleError):
        least = min(clearance_value(asked(motion.block, node), f"{what} at t = {node:g}") for node in motion.nodes)
        said = formulas_between(motion, asked, what, partial(asked, motion.block))
        formulas = SignalFormulas(motion, said, what)
    interval, difference = formulas.mismatch()
    mismatch = np.zeros(len(motion.intervals))
    np.maximum.at(mismatch, interval, np.nan_to_num(np.abs(difference[:, 0])))
    return RequiredClearance(least, formulas, mismatch)


def is_clearance_rule(asked: Any) -> bool:
    """Whether a clearance is ``rule(block, t)``; Pyomo's parameters and expressions can be called too."""
    return callable(asked) and not isinstance(asked, NumericValue)


def clearance_text(pair: tuple[str, str]) -> str:
    """How messages call the clearance of a body pair."""
    return f"the clearance between '{pair[0]}' and '{pair[1]}'"


def clearance_value(asked: Any, label: str) -> float:
    """A clearance as a number.

    Raises
    ------
    ObstacleError
        Where it has no value, or is no number.
    """
    try:
        number = value(asked, exception=False)
        number = math.nan if number is None else float(number)
    except (TypeError, ValueError):
        raise ObstacleError(
            f"{label} is {asked!r}; expected a length: a number, a Param, a Var or an expression of the model, or a "
            "rule(block, t)."
        ) from None
    if not math.isfinite(number):
        raise ObstacleError(
            f"{label} is '{asked}', which has no finite value. Give its parameters and variables values first."
        )
    return number
