"""Operators of problem files, over numbers, Pyomo's expressions and CasADi's symbols."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, NamedTuple

from pyomo.core import expr

from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES
from pyrobocop_pyomo.optional_imports import casadi

# An expression in the order of a .nl file, each operator before its arguments: a float is a number, an int the index
# of a variable, and a tuple an operator with the count of its arguments.
Tokens = Sequence["float | int | tuple[str, int]"]


class Arithmetic(NamedTuple):
    """What operators and functions mean for one kind of number.

    Attributes
    ----------
    functions : mapping of str to callable
    share : callable
        Told of each value that is used more than once; returns what stands for it.
    """

    functions: dict[str, Callable[..., Any]]
    share: Callable[[Any], Any] = lambda value: value

    def evaluate(self, tokens: Tokens, variables: Sequence[Any]) -> Any:
        """Value of an expression, given the values of the variables."""
        values: list[Any] = []
        for token in reversed(tokens):  # arguments come before their operator
            if token.__class__ is float:
                values.append(token)
            elif token.__class__ is int:
                values.append(variables[token])
            else:
                name, count = token  # type: ignore[misc]
                arguments = [values.pop() for _ in range(count)]
                values.append(self.functions[name](*arguments))
        return values[-1]


def _functions(
    named: Callable[[str], Any], choose: Callable[..., Any], negate: Callable[[Any], Any]
) -> dict[str, Callable[..., Any]]:
    def smaller(*values: Any) -> Any:
        return reduce(lambda a, b: choose(a <= b, a, b), values)

    def larger(*values: Any) -> Any:
        return reduce(lambda a, b: choose(a >= b, a, b), values)

    return {
        **{name: named(name) for name in NUMPY_NAMES},
        "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow,
        "<": operator.lt, "<=": operator.le, "==": operator.eq, ">=": operator.ge, ">": operator.gt,
        "neg": operator.neg, "square": lambda value: value**2, "sum": lambda *terms: sum(terms),
        "choose": choose, "not": negate, "min": smaller, "max": larger,
        "positive part of difference": lambda a, b: larger(a - b, 0.0),
    }  # fmt: skip


def _or_nan(function: Callable[..., Any]) -> Callable[..., Any]:
    """NaN where there is no real number: the branch that is not chosen may have none."""

    def guarded(*arguments: Any) -> Any:
        try:
            number = function(*arguments)
        except (ArithmeticError, ValueError):
            return math.nan
        return math.nan if isinstance(number, complex) else number

    return guarded


def _choose_expression(condition: Any, a: Any, b: Any) -> Any:
    if condition.__class__ is bool:  # of two numbers
        return a if condition else b
    return expr.Expr_if(condition, a, b)


def _not(condition: Any) -> Any:
    if condition.__class__ is bool:
        return not condition
    smaller, larger = condition.args
    return larger <= smaller if condition.strict else larger < smaller


def _function_of_casadi(name: str) -> Callable[..., Any]:
    # By its name only when it is called: CasADi is imported with its first use.
    return lambda value: getattr(casadi, "fabs" if name == "abs" else name)(value)


_FLOATS = _functions(lambda name: getattr(math, name, abs), lambda c, a, b: a if c else b, operator.not_)
NUMBERS = Arithmetic({name: _or_nan(function) for name, function in _FLOATS.items()})
EXPRESSIONS = Arithmetic(
    _functions(lambda name: abs if name == "abs" else getattr(expr, name), _choose_expression, _not)
)
SYMBOLS = Arithmetic(
    _functions(_function_of_casadi, lambda *arguments: casadi.if_else(*arguments), lambda c: casadi.logic_not(c))
)
