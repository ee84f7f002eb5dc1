"""`Jet`: enclosures of a function, its first and its second derivative over a stretch of its argument."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .enclosures import Enclosure

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Jet:
    """Enclosures of ``f``, ``f'`` and ``f''`` over stretches of the local fraction.

    Attributes
    ----------
    value, first, second : Enclosure, of arrays of shape (m,)
        One stretch per element. Rules of calculus, evaluated in interval arithmetic.
    """

    value: Enclosure
    first: Enclosure
    second: Enclosure

    @classmethod
    def constant(cls, number: float, count: int) -> Jet:
        """A number, over ``count`` stretches."""
        zero = Enclosure.of(np.zeros(count))
        return cls(Enclosure.of(np.full(count, float(number))), zero, zero)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.first + other.first, self.second + other.second)
        return Jet(self.value + Enclosure.of(other), self.first, self.second)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Jet:
        return self + (-other)

    def __mul__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            number = float(other)
            return Jet(self.value.times(number), self.first.times(number), self.second.times(number))
        if other is self:
            return self**2.0
        return Jet(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value + (self.first * other.first).times(2.0) + self.value * other.second,
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Jet:
        return self * (other**-1.0 if isinstance(other, Jet) else 1.0 / other)

    def __rtruediv__(self, other: Any) -> Jet:
        return self**-1.0 * other

    def __pow__(self, exponent: float) -> Jet:
        u, p = self.value, float(exponent)
        if p == 1.0:
            return self
        if p == 0.0:
            return Jet.constant(1.0, len(u.low))
        slope = u.power(p - 1.0).times(p)
        return self._through(u.power(p), slope, u.power(p - 2.0).times(p * (p - 1.0)))

    def sqrt(self) -> Jet:
        """Square root."""
        root = self.value.sqrt()
        slope = root.times(2.0).reciprocal()
        return self._through(root, slope, -(slope * (self.value.times(2.0)).reciprocal()))

    def exp(self) -> Jet:
        """Exponential."""
        grown = self.value.exp()
        return self._through(grown, grown, grown)

    def log(self) -> Jet:
        """Natural logarithm."""
        slope = self.value.reciprocal()
        return self._through(self.value.log(), slope, -(slope.power(2.0)))

    def sin(self) -> Jet:
        """Sine."""
        sine = self.value.sin()
        return self._through(sine, self.value.cos(), -sine)

    def cos(self) -> Jet:
        """Cosine."""
        cosine = self.value.cos()
        return self._through(cosine, -self.value.sin(), -cosine)

    def tan(self) -> Jet:
        """Tangent."""
        tangent = self.value.tan()
        slope = tangent.power(2.0) + Enclosure.of(1.0)
        return self._through(tangent, slope, (tangent * slope).times(2.0))

    def arctan(self) -> Jet:
        """Inverse tangent."""
        slope = (self.value.power(2.0) + Enclosure.of(1.0)).reciprocal()
        return self._through(self.value.arctan(), slope, -(self.value * slope.power(2.0)).times(2.0))

    def _through(self, value: Enclosure, slope: Enclosure, curvature: Enclosure) -> Jet:
        """The chain rule: ``g(f)' = g'(f) f'`` and ``g(f)'' = g''(f) f'^2 + g'(f) f''``."""
        return Jet(value, slope * self.first, curvature * self.first.power(2.0) + slope * self.second)


def polynomial_jet(coefficients: tuple[Array, Array, Array]) -> Jet:
    """Enclosures from the Bernstein coefficients of a polynomial and its two derivatives on the stretches.

    Parameters
    ----------
    coefficients : three arrays, shape (m, degree + 1) and less
        With respect to the same argument.
    """
    return Jet(*(_hull(each) for each in coefficients))


def _hull(coefficients: Array) -> Enclosure:
    """A polynomial lies between its smallest and largest Bernstein coefficient."""
    # De Casteljau's steps are convex combinations: each adds a rounding of the largest coefficient.
    slack = 4 * np.finfo(float).eps * coefficients.shape[1] ** 2 * np.abs(coefficients).max(axis=1)
    return Enclosure(coefficients.min(axis=1) - slack, coefficients.max(axis=1) + slack)
