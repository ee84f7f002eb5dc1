"""`TaylorForm`: intervals that contain a function and its first two derivatives on subintervals of its argument.

What Pyomo's functions, relations and choices mean for Taylor forms; of numbers they are numbers.

Where a function has a kink, or no formula here, its derivatives are unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES

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
