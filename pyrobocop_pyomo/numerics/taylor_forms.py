"""`TaylorForm`: intervals that contain a function and its first two derivatives on subintervals of its argument."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array
from .interval_arithmetic import Interval


@dataclass(frozen=True, eq=False)
class TaylorForm:
    """Bounds of ``f``, ``f'`` and ``f''`` on subintervals of the local fraction.

    Operations follow the rules of differentiation, evaluated in interval arithmetic.

    Attributes
    ----------
    value, first, second : Interval of shape (m,)
        One element per subinterval.
    """

    value: Interval
    first: Interval
    second: Interval

    @classmethod
    def constant(cls, number: float, count: int) -> TaylorForm:
        """A constant function on ``count`` subintervals."""
        zero = Interval.of(np.zeros(count))
        return cls(Interval.of(np.full(count, float(number))), zero, zero)

    def __neg__(self) -> TaylorForm:
        return TaylorForm(-self.value, -self.first, -self.second)

    def __add__(self, other: Any) -> TaylorForm:
        if isinstance(other, TaylorForm):
            return TaylorForm(self.value + other.value, self.first + other.first, self.second + other.second)
        return TaylorForm(self.value + Interval.of(other), self.first, self.second)

    __radd__ = __add__

    def __sub__(self, other: Any) -> TaylorForm:
        return self + (-other)

    def __mul__(self, other: Any) -> TaylorForm:
        if not isinstance(other, TaylorForm):
            number = float(other)
            return TaylorForm(self.value.times(number), self.first.times(number), self.second.times(number))
        if other is self:
            return self**2.0
        return TaylorForm(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value + (self.first * other.first).times(2.0) + self.value * other.second,
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> TaylorForm:
        return self * (other**-1.0 if isinstance(other, TaylorForm) else 1.0 / other)

    def __rtruediv__(self, other: Any) -> TaylorForm:
        return self**-1.0 * other

    def __pow__(self, exponent: Any) -> TaylorForm:
        if isinstance(exponent, TaylorForm):
            return (exponent * self.log()).exp()
        u, p = self.value, float(exponent)
        if p == 1.0:
            return self
        if p == 0.0:
            return TaylorForm.constant(1.0, len(u.low))
        slope = u.power(p - 1.0).times(p)
        return self.compose(u.power(p), slope, u.power(p - 2.0).times(p * (p - 1.0)))

    def __rpow__(self, base: float) -> TaylorForm:
        return (self * float(np.log(base))).exp()

    def sqrt(self) -> TaylorForm:
        """Square root."""
        root = self.value.sqrt()
        slope = root.times(2.0).reciprocal()
        return self.compose(root, slope, -(slope * (self.value.times(2.0)).reciprocal()))

    def exp(self) -> TaylorForm:
        """Exponential."""
        grown = self.value.exp()
        return self.compose(grown, grown, grown)

    def log(self) -> TaylorForm:
        """Natural logarithm."""
        slope = self.value.reciprocal()
        return self.compose(self.value.log(), slope, -(slope.power(2.0)))

    def sin(self) -> TaylorForm:
        """Sine."""
        sine = self.value.sin()
        return self.compose(sine, self.value.cos(), -sine)

    def cos(self) -> TaylorForm:
        """Cosine."""
        cosine = self.value.cos()
        return self.compose(cosine, -self.value.sin(), -cosine)

    def tan(self) -> TaylorForm:
        """Tangent."""
        tangent = self.value.tan()
        slope = tangent.power(2.0) + Interval.of(1.0)
        return self.compose(tangent, slope, (tangent * slope).times(2.0))

    def arctan(self) -> TaylorForm:
        """Inverse tangent."""
        slope = (self.value.power(2.0) + Interval.of(1.0)).reciprocal()
        return self.compose(self.value.arctan(), slope, -(self.value * slope.power(2.0)).times(2.0))

    def compose(self, value: Interval, slope: Interval, curvature: Interval) -> TaylorForm:
        """Chain rule: ``g(f)' = g'(f) f'`` and ``g(f)'' = g''(f) f'^2 + g'(f) f''``."""
        return TaylorForm(value, slope * self.first, curvature * self.first.power(2.0) + slope * self.second)


def taylor_form_of_polynomial(coefficients: tuple[Array, Array, Array]) -> TaylorForm:
    """Taylor form of a polynomial, from the Bernstein coefficients of it and its first two derivatives.

    Parameters
    ----------
    coefficients : three arrays, shapes (m, degree + 1), (m, degree) and (m, degree - 1)
        One row per subinterval. All derivatives are with respect to the same argument.
    """
    return TaylorForm(*map(_range_of_polynomial, coefficients))


def _range_of_polynomial(coefficients: Array) -> Interval:
    """A polynomial lies between its smallest and largest Bernstein coefficient."""
    # Each of de Casteljau's convex combinations adds at most one rounding of the largest coefficient.
    slack = 4 * np.finfo(float).eps * coefficients.shape[1] ** 2 * np.abs(coefficients).max(axis=1)
    return Interval(coefficients.min(axis=1) - slack, coefficients.max(axis=1) + slack)
