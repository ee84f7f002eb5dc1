"""Interval arithmetic on arrays: enclosures of everything that numbers between two bounds can give.

Bounds are rounded outwards by one unit in the last place after sums, products and roots, which NumPy rounds correctly,
and by eight after functions, which NumPy computes to within four. Where nothing is known bounds are infinite or NaN;
no comparison with those is ever true, so that what is not proven never counts as proven.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_EPS = float(np.finfo(float).eps)
# Beyond, the place of an angle within its period is lost in rounding.
_LARGEST_ANGLE = 1e6


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Numbers between two bounds, elementwise.

    Attributes
    ----------
    low, high : array
        Of one shape.
    """

    low: Array
    high: Array

    @classmethod
    def of(cls, number: float | Array) -> Enclosure:
        """A number that is known exactly."""
        exact = np.asarray(number, dtype=float)
        return cls(exact, exact)

    @property
    def magnitude(self) -> Array:
        """Largest absolute value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def __neg__(self) -> Enclosure:
        return Enclosure(-self.high, -self.low)

    def __add__(self, other: Enclosure) -> Enclosure:
        return _outward(self.low + other.low, self.high + other.high)

    def __sub__(self, other: Enclosure) -> Enclosure:
        return _outward(self.low - other.high, self.high - other.low)

    def __mul__(self, other: Enclosure) -> Enclosure:
        products = (self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high)
        low = np.minimum(np.minimum(products[0], products[1]), np.minimum(products[2], products[3]))
        high = np.maximum(np.maximum(products[0], products[1]), np.maximum(products[2], products[3]))
        return _outward(low, high)

    def times(self, number: float) -> Enclosure:
        """Product with a number that is known exactly."""
        low, high = (self.low, self.high) if number >= 0 else (self.high, self.low)
        return self if number == 1.0 else _outward(number * low, number * high)

    def reciprocal(self) -> Enclosure:
        """One over it; unbounded where it may be zero."""
        bounded = (self.low > 0.0) | (self.high < 0.0)  # false for NaN
        found = _outward(1.0 / self.high, 1.0 / self.low)
        return Enclosure(np.where(bounded, found.low, -np.inf), np.where(bounded, found.high, np.inf))

    def intersect(self, other: Enclosure) -> Enclosure:
        """What two enclosures of the same numbers leave; NaN counts as nothing known."""
        return Enclosure(np.fmax(self.low, other.low), np.fmin(self.high, other.high))

    def power(self, exponent: float) -> Enclosure:
        """Power with a number; undefined (NaN) where a root of something negative may be taken."""
        if exponent == 0.0:
            return Enclosure.of(np.ones_like(self.low))
        if exponent == 1.0:
            return self
        if exponent != round(exponent):
            if exponent < 0.0:
                return self.power(-exponent).reciprocal()
            return _widened(np.power(self.low, exponent), np.power(self.high, exponent))
        if exponent < 0.0:
            return self.power(-exponent).reciprocal()
        low, high = self.low**exponent, self.high**exponent
        if exponent % 2 == 0:
            crosses = (self.low <= 0.0) & (self.high >= 0.0)
            low, high = np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high)
        return _widened(low, high)

    def sqrt(self) -> Enclosure:
        """Square root; undefined (NaN) where it may be negative."""
        return _outward(np.sqrt(self.low), np.sqrt(self.high))

    def exp(self) -> Enclosure:
        """Exponential."""
        return _widened(np.exp(self.low), np.exp(self.high))

    def log(self) -> Enclosure:
        """Natural logarithm; undefined (NaN) where it may be negative."""
        # Near one the logarithm is small and its error is one of the argument: absolute, not relative.
        found = _widened(np.log(self.low), np.log(self.high))
        return Enclosure(found.low - _EPS, found.high + _EPS)

    def arctan(self) -> Enclosure:
        """Inverse tangent."""
        return _widened(np.arctan(self.low), np.arctan(self.high))

    def sin(self) -> Enclosure:
        """Sine."""
        return self._wave(np.sin, 0.25)

    def cos(self) -> Enclosure:
        """Cosine."""
        return self._wave(np.cos, 0.0)

    def tan(self) -> Enclosure:
        """Tangent; unbounded where a pole may lie."""
        poles = self._meets(0.25, 0.5)
        found = _widened(np.tan(self.low), np.tan(self.high))
        return Enclosure(np.where(poles, -np.inf, found.low), np.where(poles, np.inf, found.high))

    def _wave(self, function: Callable[[Array], Array], crest: float) -> Enclosure:
        """A wave of period two pi with its crests at ``crest`` turns and its troughs half a turn later."""
        low, high = function(self.low), function(self.high)
        top = np.where(self._meets(crest, 1.0), 1.0, np.maximum(low, high) + 8 * _EPS)
        bottom = np.where(self._meets(crest + 0.5, 1.0), -1.0, np.minimum(low, high) - 8 * _EPS)
        return Enclosure(np.maximum(bottom, -1.0), np.minimum(top, 1.0))

    def _meets(self, turn: float, period: float) -> NDArray[np.bool_]:
        """Whether an angle of ``turn`` turns, or a number of periods from it, may lie within."""
        slack = 1e-9  # far above the rounding of angles that are not larger than the largest
        first = np.ceil((self.low / (2 * np.pi) - turn) / period - slack)
        last = np.floor((self.high / (2 * np.pi) - turn) / period + slack)
        # Written so that NaN counts as meeting.
        return ~((first > last) & (self.magnitude < _LARGEST_ANGLE))


def _outward(low: Array, high: Array) -> Enclosure:
    return Enclosure(np.nextafter(low, -np.inf), np.nextafter(high, np.inf))


def _widened(low: Array, high: Array) -> Enclosure:
    slack = 8 * _EPS
    return _outward(low - slack * np.abs(low), high + slack * np.abs(high))
