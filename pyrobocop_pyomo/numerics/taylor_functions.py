"""What Pyomo's functions, relations and choices mean for Taylor forms; of numbers they are numbers.

Where a function has a kink, or no formula here, its derivatives are unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES

from . import Array
from .interval_arithmetic import Interval
from .taylor_forms import TaylorForm

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
