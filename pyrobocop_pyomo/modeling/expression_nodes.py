"""What the nodes of Pyomo's expressions mean over any kind of number.

Floats, arrays, Taylor forms in interval arithmetic and symbols of CasADi know arithmetic by themselves. What differs
between them is a table from the name of a function to what it does: ``"sin"``, ..., the relations of `comparisons`, and
``"choose"`` for a condition with two alternatives, and ``"call"`` for an output of a `Function` with its arguments.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import cache, reduce
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.expression import NamedExpressionData
from pyomo.core.expr import numeric_expr, relational_expr
from pyomo.core.expr.numvalue import NumericValue

# Kinds of nodes: operators with a fixed count of arguments, then the others.
PRODUCT, DIVISION, NEGATION, POWER, CHOICE = range(1, 6)
CONSTANT, LEAF, NAMED, SUMMATION, FUNCTION, RELATION, UNKNOWN, CALL = range(10, 18)

_KIND_OF_BASE: dict[type, int] = {
    numeric_expr.ProductExpression: PRODUCT,
    numeric_expr.DivisionExpression: DIVISION,
    numeric_expr.NegationExpression: NEGATION,
    numeric_expr.PowExpression: POWER,
    numeric_expr.Expr_ifExpression: CHOICE,
    numeric_expr.SumExpression: SUMMATION,
    numeric_expr.UnaryFunctionExpression: FUNCTION,
    relational_expr.InequalityExpression: RELATION,
    relational_expr.EqualityExpression: RELATION,
    relational_expr.RangedExpression: RELATION,
    NamedExpressionData: NAMED,
    numeric_expr.ExternalFunctionExpression: CALL,
}

# Pyomo's functions of one argument, with NumPy's names for them.
NUMPY_NAMES = {
    "sin": "sin", "cos": "cos", "tan": "tan", "asin": "arcsin", "acos": "arccos", "atan": "arctan", "sinh": "sinh",
    "cosh": "cosh", "tanh": "tanh", "asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh", "exp": "exp",
    "log": "log", "log10": "log10", "sqrt": "sqrt", "ceil": "ceil", "floor": "floor", "abs": "absolute",
}  # fmt: skip


# What arithmetic means for every kind of number.
ARITHMETIC: dict[int, Callable[..., Any]] = {
    PRODUCT: operator.mul,
    DIVISION: operator.truediv,
    NEGATION: operator.neg,
    POWER: operator.pow,
    SUMMATION: lambda *terms: reduce(operator.add, terms) if terms else 0.0,
}


def comparisons(both: Callable[[Any, Any], Any]) -> dict[str, Callable[..., Any]]:
    """What relations mean, given what it means that two of them hold at once."""
    return {
        "==": lambda a, b: a == b,
        "<=": lambda a, b: a <= b,
        "<": lambda a, b: a < b,
        "<=<=": lambda a, b, c: both(a <= b, b <= c),
        "<=<": lambda a, b, c: both(a <= b, b < c),
        "<<=": lambda a, b, c: both(a < b, b <= c),
        "<<": lambda a, b, c: both(a < b, b < c),
    }


FLOAT_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name, abs) for name in NUMPY_NAMES},
    **comparisons(lambda a, b: a and b),
    "choose": lambda condition, a, b: a if condition else b,
    "call": lambda output, *arguments: output.evaluate(arguments),
}


# What functions and comparisons mean where expressions are evaluated with arrays.
ARRAY_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, numpy_name) for name, numpy_name in NUMPY_NAMES.items()},
    **comparisons(np.logical_and),
    "choose": np.where,
    "call": lambda output, *arguments: output.evaluate_arrays(arguments),
}


@cache
def kind_of_node(cls: type) -> int:
    """Kind of the nodes of a class; Pyomo derives several classes from each of its operators."""
    if cls in native_numeric_types:
        return CONSTANT
    for base in cls.__mro__:
        if base in _KIND_OF_BASE:
            return _KIND_OF_BASE[base]
    numeric = issubclass(cls, NumericValue) and not issubclass(cls, numeric_expr.NumericExpression)
    return LEAF if numeric else UNKNOWN


def comparison_name(node: Any) -> str:
    """Name of a relation among `comparisons`."""
    if isinstance(node, relational_expr.EqualityExpression):
        return "=="
    strict = node.strict if isinstance(node.strict, tuple) else (node.strict,)
    return "".join("<" if is_strict else "<=" for is_strict in strict)
