"""`Interval`: interval arithmetic on arrays. Every result contains all values that the operands can give.

Bounds are rounded outwards by one unit in the last place after sums, products and roots, which NumPy rounds correctly,
and by eight after functions, which NumPy computes to within four. Unknown bounds are infinite or NaN. Comparisons with
them are false, so that an unknown bound never proves anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array, BoolArray

_EPS = float(np.finfo(float).eps)
# The position of a larger angle within its period is lost in rounding.
_LARGEST_ANGLE = 1e6


@dataclass(frozen=True, eq=False)
class Interval:
    """Lower and upper bounds of numbers, elementwise.

    Attributes
    ----------
    low, high : array
        Both of the same shape.
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, number: float | Array) -> Interval:
        """The interval that contains one number only."""
        exact = np.asarray(number, dtype=float)
        return cls(exact, exact)

    @property
    def magnitude(self) -> Array:
        """Largest absolute value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def __getitem__(self, chosen: Any) -> Interval:
        """Some of the intervals."""
        return Interval(self.low[chosen], self.high[chosen])

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other: Interval) -> Interval:
        return _outward(self.low + other.low, self.high + other.high)

    def __sub__(self, other: Interval) -> Interval:
        return _outward(self.low - other.high, self.high - other.low)

    def __mul__(self, other: Interval) -> Interval:
        products = (self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high)
        low = np.minimum(np.minimum(products[0], products[1]), np.minimum(products[2], products[3]))
        high = np.maximum(np.maximum(products[0], products[1]), np.maximum(products[2], products[3]))
        return _outward(low, high)

    def times(self, number: float) -> Interval:
        """Product with an exact number."""
        low, high = (self.low, self.high) if number >= 0 else (self.high, self.low)
        return self if number == 1.0 else _outward(number * low, number * high)

    def reciprocal(self) -> Interval:
        """Reciprocal; unbounded where the interval contains zero."""
        bounded = (self.low > 0.0) | (self.high < 0.0)  # false for NaN
        bounds = _outward(1.0 / self.high, 1.0 / self.low)
        return Interval(np.where(bounded, bounds.low, -np.inf), np.where(bounded, bounds.high, np.inf))

    def intersect(self, other: Interval) -> Interval:
        """Intersection of two intervals that contain the same numbers; NaN counts as unknown."""
        return Interval(np.fmax(self.low, other.low), np.fmin(self.high, other.high))

    def power(self, exponent: float) -> Interval:
        """Power with an exact exponent; NaN where it may be a root of a negative number."""
        if exponent == 0.0:
            return Interval.of(np.ones_like(self.low))
        if exponent == 1.0:
            return self
        if exponent < 0.0:
            return self.power(-exponent).reciprocal()
        if exponent != round(exponent):
            return _widened(np.power(self.low, exponent), np.power(self.high, exponent))
        low, high = self.low**exponent, self.high**exponent
        if exponent % 2 == 0:
            crosses = (self.low <= 0.0) & (self.high >= 0.0)
            low, high = np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high)
        return _widened(low, high)

    def sqrt(self) -> Interval:
        """Square root; NaN where the argument may be negative."""
        return _outward(np.sqrt(self.low), np.sqrt(self.high))

    def exp(self) -> Interval:
        """Exponential."""
        return _widened(np.exp(self.low), np.exp(self.high))

    def log(self) -> Interval:
        """Natural logarithm; NaN where the argument may be negative."""
        # Near one the logarithm is small, and the rounding of its argument is an absolute error of the result.
        bounds = _widened(np.log(self.low), np.log(self.high))
        return Interval(bounds.low - _EPS, bounds.high + _EPS)

    def arctan(self) -> Interval:
        """Inverse tangent."""
        return _widened(np.arctan(self.low), np.arctan(self.high))

    def sin(self) -> Interval:
        """Sine."""
        return self._wave(np.sin, 0.25)

    def cos(self) -> Interval:
        """Cosine."""
        return self._wave(np.cos, 0.0)

    def tan(self) -> Interval:
        """Tangent; unbounded where the interval may contain a pole."""
        poles = self._contains_angle(0.25, 0.5)
        bounds = _widened(np.tan(self.low), np.tan(self.high))
        return Interval(np.where(poles, -np.inf, bounds.low), np.where(poles, np.inf, bounds.high))

    def _wave(self, function: Callable[[Array], Array], crest: float) -> Interval:
        """A sine or cosine, with maxima at ``crest`` turns and minima half a turn later."""
        low, high = function(self.low), function(self.high)
        top = np.where(self._contains_angle(crest, 1.0), 1.0, np.maximum(low, high) + 8 * _EPS)
        bottom = np.where(self._contains_angle(crest + 0.5, 1.0), -1.0, np.minimum(low, high) - 8 * _EPS)
        return Interval(np.maximum(bottom, -1.0), np.minimum(top, 1.0))

    def _contains_angle(self, turn: float, period: float) -> BoolArray:
        """Whether the interval may contain ``turn`` turns plus an integer number of periods, also in turns."""
        slack = 1e-9  # far above the rounding of angles up to _LARGEST_ANGLE
        first = np.ceil((self.low / (2 * np.pi) - turn) / period - slack)
        last = np.floor((self.high / (2 * np.pi) - turn) / period + slack)
        # Written so that NaN counts as containing it.
        return ~((first > last) & (self.magnitude < _LARGEST_ANGLE))


def _outward(low: Array, high: Array) -> Interval:
    return Interval(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))


def _widened(low: Array, high: Array) -> Interval:
    slack = 8 * _EPS
    return _outward(low - slack * np.abs(low), high + slack * np.abs(high))
