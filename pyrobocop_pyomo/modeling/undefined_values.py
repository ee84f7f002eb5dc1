"""Which part of an expression has no value or no derivative at the current values, in words; and a way out of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.expr.calculus.diff_with_pyomo import DifferentiationException, reverse_ad
from pyomo.core.expr.numeric_expr import DivisionExpression, Expr_ifExpression, PowExpression, UnaryFunctionExpression
from pyomo.core.expr.numvalue import native_numeric_types

from .row_violations import number_or_nan
from .shared_nodes import NodesOnce, variables_in
from .variable_values import within_bounds

# Longer expressions are named by their variables.
_SHOWN_CHARACTERS, _SHOWN_VARIABLES = 60, 4
# How far inside its domain an argument is moved, and the largest argument of an exponential there.
_INSIDE, _LARGEST_EXPONENT = 0.1, 50.0
_DOMAINS = {
    "log": (0.0, math.inf),
    "log10": (0.0, math.inf),
    "sqrt": (0.0, math.inf),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "atanh": (-1.0, 1.0),
    "acosh": (1.0, math.inf),
    "exp": (-math.inf, _LARGEST_EXPONENT),
    "sinh": (-_LARGEST_EXPONENT, _LARGEST_EXPONENT),
    "cosh": (-_LARGEST_EXPONENT, _LARGEST_EXPONENT),
}
_GROWING = ("exp", "sinh", "cosh")
_NO_VALUE = (ArithmeticError, ValueError, TypeError)


@dataclass(frozen=True, eq=False)
class UndefinedPart:
    """The innermost part of an expression that has no value, or no derivative, where its arguments have values.

    Attributes
    ----------
    what : str
        In words, with the numbers.
    argument : expression or number
        What has to move for it to have a value.
    value : float
        Of the argument.
    lower, upper : float
        The argument's domain, whose ends do not belong to it.
    outside : float
        Half the width of a gap inside of the domain that the argument has to stay out of, around zero.
    """

    what: str
    argument: Any
    value: float
    lower: float = -math.inf
    upper: float = math.inf
    outside: float = 0.0

    @property
    def target(self) -> float:
        """A value of the argument well inside the domain."""
        room = self.upper - self.lower
        inside = _INSIDE if math.isinf(room) else _INSIDE * room / 2.0
        number = min(max(self.value, self.lower + inside), self.upper - inside)
        if self.outside and abs(number) < self.outside:
            number = math.copysign(self.outside, number)
        return number


def undefined_part(expression: Any) -> UndefinedPart | None:
    """The first part of an expression that has no finite value or derivative; None where all have, or a value misses.

    Parameters
    ----------
    expression : expression or number
        Its variables have values.
    """
    found = _Definedness().of(expression)
    return found if isinstance(found, UndefinedPart) else None


def moved_into_domain(part: UndefinedPart) -> bool:
    """Move the variables of a part's argument, by least change and within their bounds, until it is in its domain.

    Returns whether it is there now.
    """
    if part.argument.__class__ in native_numeric_types:
        return False
    variables = list(variables_in(part.argument, include_fixed=False))
    if not variables:
        return False
    target = part.target
    for _ in range(20):
        missing = target - number_or_nan(part.argument)
        if not math.isfinite(missing):
            return False
        if abs(missing) <= 1e-3 * max(1.0, abs(target)):
            return True
        steps = _steps(part.argument, variables, missing)
        if not any(steps):
            # A stationary point, such as the middle of a circle: any way out will do.
            steps[0] = math.sqrt(abs(missing))
        for variable, step in zip(variables, steps, strict=True):
            variable.set_value(_inside_bounds(variable.value + step, variable), skip_validation=True)
    number = number_or_nan(part.argument)
    return part.lower < number < part.upper and (not part.outside or number != 0.0)


def _steps(argument: Any, variables: list[Any], missing: float) -> list[float]:
    """The smallest changes that, to first order, add what is missing; zeros where there are none."""
    try:
        derivatives = reverse_ad(argument)
        slopes = np.array([derivatives.get(variable, 0.0) for variable in variables], dtype=float)
    except (*_NO_VALUE, DifferentiationException):
        return [0.0] * len(variables)
    square = float(slopes @ slopes)
    return (slopes * missing / square if 1e-16 < square < math.inf else np.zeros_like(slopes)).tolist()


def _inside_bounds(number: float, variable: Any) -> float:
    lower, upper = variable.bounds
    room = math.inf if lower is None or upper is None else upper - lower
    inside = min(1e-2, 1e-2 * room)
    number = number if lower is None else max(number, lower + inside)
    return within_bounds(number if upper is None else min(number, upper - inside), variable)


class _Definedness(NodesOnce):
    """The value of each node, None where one is missing, or the part of it that has none."""

    def of_leaf(self, leaf: Any) -> Any:
        if getattr(leaf, "value", leaf) is None:
            return None
        number = number_or_nan(leaf)
        if math.isfinite(number):
            return number
        return UndefinedPart(f"the number {number:g} of {leaf.name!r}", leaf, number)

    def of_operation(self, node: Any, found: list[Any]) -> Any:
        if isinstance(node, Expr_ifExpression) and isinstance(found[0], (bool, float)):
            return found[1] if found[0] else found[2]  # the other side need not have a value
        constants = (each for each in found if each.__class__ in native_numeric_types and not math.isfinite(each))
        for number in constants:  # as values they would have been told of where they arise
            return UndefinedPart(f"the number {number:g}", number, number)
        undefined = next((each for each in found if isinstance(each, UndefinedPart)), None)
        if undefined is not None or None in found:
            return undefined
        try:
            number = node._apply_operation(found)
        except _NO_VALUE:
            number = math.nan
        number = math.nan if isinstance(number, complex) else float(number)
        return _undefined_here(node, found, number) or number


def _undefined_here(node: Any, numbers: list[float], number: float) -> UndefinedPart | None:
    """What a node lacks at the values of its arguments."""
    if isinstance(node, PowExpression):
        return _power(node, numbers, number)
    if isinstance(node, UnaryFunctionExpression):
        return _function(node, numbers[0], number)
    if math.isfinite(number):
        return None
    if isinstance(node, DivisionExpression):
        what = f"division by {_equation(node.arg(1), numbers[1])}"
        return UndefinedPart(what, node.arg(1), numbers[1], outside=_INSIDE)
    return UndefinedPart(f"{_words(node)} is not finite", node, number)


def _power(node: Any, numbers: Any, number: float) -> UndefinedPart | None:
    base, exponent = numbers
    fraction = exponent != math.floor(exponent)
    what = f"{_equation(node.arg(0), base)} to the power {exponent:g}"
    if math.isfinite(number):
        if base == 0.0 and fraction and exponent < 2.0:
            which = "derivative" if exponent < 1.0 else "second derivative"
            return UndefinedPart(f"the {which} of {what}", node.arg(0), base, lower=0.0)
        return None
    if base == 0.0 and not fraction:
        return UndefinedPart(what, node.arg(0), base, outside=_INSIDE)
    if base <= 0.0:
        return UndefinedPart(what, node.arg(0), base, lower=0.0)
    return UndefinedPart(f"overflow of {what}", node.arg(0), base, lower=-_LARGEST_EXPONENT, upper=_LARGEST_EXPONENT)


def _function(node: Any, argument: float, number: float) -> UndefinedPart | None:
    name, is_finite = node.getname(), math.isfinite(number)
    domain = _DOMAINS.get(name, (-math.inf, math.inf))
    if is_finite and (name in _GROWING or argument not in domain):
        return None
    which = "the derivative of " if is_finite else "overflow of " if name in _GROWING else ""
    what = f"{which}{name}(...) of {_equation(node.arg(0), argument)}"
    return UndefinedPart(what, node.arg(0), argument, *domain)


def _equation(argument: Any, number: float) -> str:
    """An expression and its value; a long one by the values of its variables."""
    if not hasattr(argument, "is_expression_type"):
        return f"{number:.6g}"
    text = str(argument)
    return f"{text} = {number:.6g}" if len(text) <= _SHOWN_CHARACTERS else f"{number:.6g}, {_words(argument)}"


def _words(expression: Any) -> str:
    text = str(expression)
    if len(text) <= _SHOWN_CHARACTERS:
        return text
    variables = list(variables_in(expression))
    shown = ", ".join(f"{variable.name} = {number_or_nan(variable):.6g}" for variable in variables[:_SHOWN_VARIABLES])
    more = ", ..." if len(variables) > _SHOWN_VARIABLES else ""
    return f"an expression of {shown}{more}"
