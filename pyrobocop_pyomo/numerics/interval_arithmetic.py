"""`Interval`: interval arithmetic on arrays. Every result contains all values that the operands can give.

Bounds are rounded outwards by one unit in the last place after sums, products and roots, which NumPy rounds correctly,
and by eight after functions, which NumPy computes to within four. Unknown bounds are infinite or NaN. Comparisons with
them are false, so that an unknown bound never proves anything.

`TaylorForm`: intervals that contain a function and its first two derivatives on subintervals of its argument.

What Pyomo's functions, relations and choices mean for Taylor forms; of numbers they are numbers.

Where a function has a kink, or no formula here, its derivatives are unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES

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


# --------------------------------------------------------------------------------------------------------- Taylor forms


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


# ------------------------------------------------------------------------------------------------------------ functions


_MONOTONE = {"sinh", "asinh", "asin", "acosh", "atanh", "log10", "floor", "ceil"}


def _without_derivatives(low: Array, high: Array) -> TaylorForm:
    unknown = Interval(np.full_like(low, -np.inf), np.full_like(low, np.inf))
    return TaylorForm(Interval(low, high), unknown, unknown)


def _function(name: str, of_form: Callable[[TaylorForm], TaylorForm]) -> Callable[[Any], Any]:
    of_number = getattr(np, NUMPY_NAMES[name])
    return lambda argument: of_form(argument) if isinstance(argument, TaylorForm) else float(of_number(argument))


def _monotone(name: str) -> Callable[[TaylorForm], TaylorForm]:
    function = getattr(np, NUMPY_NAMES[name])
    return lambda form: _without_derivatives(function(form.value.low), function(form.value.high))


def _absolute(form: TaylorForm) -> TaylorForm:
    crosses = (form.value.low <= 0.0) & (form.value.high >= 0.0)
    low, high = np.abs(form.value.low), np.abs(form.value.high)
    whole = _without_derivatives(np.where(crosses, 0.0, np.minimum(low, high)), np.maximum(low, high))
    second = Interval(np.where(crosses, -np.inf, form.second.low), np.where(crosses, np.inf, form.second.high))
    return TaylorForm(whole.value, whole.first, second)


def _square_root(form: TaylorForm) -> TaylorForm:
    # Rounding may put the lower bound of what cannot be negative below zero.
    return TaylorForm(Interval(np.maximum(form.value.low, 0.0), form.value.high), form.first, form.second).sqrt()


def _hyperbolic_tangent(form: TaylorForm) -> TaylorForm:
    value = _monotone("tanh")(form).value
    slope = Interval.of(1.0) - value.power(2.0)
    return form.compose(value, slope, -(value * slope).times(2.0))


def _compared(surely: Callable[[Any, Any], Any], impossible: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """One where a relation of low and high bounds surely holds, zero where it cannot, and between where neither."""

    def indicator(first: Any, second: Any) -> Any:
        if not isinstance(first, TaylorForm) and not isinstance(second, TaylorForm):
            return float(surely((first, first), (second, second)))
        bounds = [(of.value.low, of.value.high) if isinstance(of, TaylorForm) else (of, of) for of in (first, second)]
        return _without_derivatives(np.where(surely(*bounds), 1.0, 0.0), np.where(impossible(*bounds), 0.0, 1.0))

    return indicator


_NO_MORE = _compared(lambda a, b: a[1] <= b[0], lambda a, b: a[0] > b[1])
_LESS = _compared(lambda a, b: a[1] < b[0], lambda a, b: a[0] >= b[1])
_EQUAL = _compared(lambda a, b: (a[0] == b[1]) & (a[1] == b[0]), lambda a, b: (a[0] > b[1]) | (a[1] < b[0]))


def _choice(condition: Any, first: Any, second: Any) -> Any:
    if not isinstance(condition, TaylorForm):
        return first if condition else second
    count = len(condition.value.low)
    forms = [of if isinstance(of, TaylorForm) else TaylorForm.constant(of, count) for of in (first, second)]
    true, false = condition.value.low > 0.5, condition.value.high < 0.5

    def chosen(order: str, *, jumps: bool) -> Interval:
        a, b = (getattr(form, order) for form in forms)
        low, high = np.fmin(a.low, b.low), np.fmax(a.high, b.high)
        low, high = (np.full_like(low, -np.inf), np.full_like(high, np.inf)) if jumps else (low, high)
        return Interval(
            np.where(true, a.low, np.where(false, b.low, low)), np.where(true, a.high, np.where(false, b.high, high))
        )

    return TaylorForm(chosen("value", jumps=False), chosen("first", jumps=True), chosen("second", jumps=True))


def _called(output: Any, *arguments: Any) -> Any:
    """An output of a `Function`; of arguments that move by the bounds that it has of itself, if it has any."""
    moving = next((argument for argument in arguments if isinstance(argument, TaylorForm)), None)
    if moving is None:
        return output.evaluate(arguments)
    bounds = getattr(output.function, "taylor_form", None)
    return TaylorForm.constant(np.nan, len(moving.value.low)) if bounds is None else bounds(*arguments)


TAYLOR_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _function(name, getattr(TaylorForm, name)) for name in ("sin", "cos", "tan", "exp", "log")},
    **{name: _function(name, _monotone(name)) for name in _MONOTONE},
    "atan": _function("atan", TaylorForm.arctan),
    "acos": _function("acos", lambda form: -_monotone("asin")(form) + np.pi / 2),
    "cosh": _function("cosh", lambda form: _monotone("cosh")(_absolute(form))),
    "abs": _function("abs", _absolute),
    "tanh": _function("tanh", _hyperbolic_tangent),
    "sqrt": _function("sqrt", _square_root),
    "==": _EQUAL,
    "<=": _NO_MORE,
    "<": _LESS,
    "<=<=": lambda a, b, c: _NO_MORE(a, b) * _NO_MORE(b, c),
    "<=<": lambda a, b, c: _NO_MORE(a, b) * _LESS(b, c),
    "<<=": lambda a, b, c: _LESS(a, b) * _NO_MORE(b, c),
    "<<": lambda a, b, c: _LESS(a, b) * _LESS(b, c),
    "choose": _choice,
    "call": _called,
}
