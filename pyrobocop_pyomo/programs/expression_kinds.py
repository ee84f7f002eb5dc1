"""What the classes of Pyomo's expression nodes mean to a walk over them."""

from __future__ import annotations

from typing import Any

from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.expression import NamedExpressionData
from pyomo.core.expr import numeric_expr, relational_expr
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.errors import ModelError

from .expression_codes import CHOICE, DIVISION, FLOAT_FUNCTIONS, NEGATION, POWER, PRODUCT

# Operators with a fixed count of arguments have their codes as kinds; the others have these.
CONSTANT, LEAF, NAMED, SUMMATION, FUNCTION, RELATION = range(10, 16)

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
}
REMEDY = "Use derivatives='asl', or the ipopt executable."


class NodeKinds(dict[type, int]):
    """Kind of each class of nodes, found out when a class is first met: Pyomo derives several from each.

    Raises
    ------
    ModelError
        For a class that has no derivatives here: external functions, minima and maxima, strings.
    """

    def __missing__(self, cls: type) -> int:
        if cls in native_numeric_types:
            kind: int | None = CONSTANT
        else:
            kind = next((_KIND_OF_BASE[base] for base in cls.__mro__ if base in _KIND_OF_BASE), None)
        if kind is None and issubclass(cls, NumericValue) and not issubclass(cls, numeric_expr.NumericExpression):
            kind = LEAF
        if kind is None:
            raise ModelError(
                f"an expression holds a {cls.__name__}, which the vectorised backend does not know. {REMEDY}"
            )
        self[cls] = kind
        return kind


def function_name(node: Any) -> str:
    """Name of a function of one argument.

    Raises
    ------
    ModelError
        For a function that is not among those of `expression_codes`.
    """
    name: str = node.getname()
    if name not in FLOAT_FUNCTIONS:
        raise ModelError(f"'{node}': vectorised expressions do not know the function '{name}'. {REMEDY}")
    return name


def comparison_name(node: Any) -> str:
    """Name of a relation among the functions of `expression_codes`."""
    if isinstance(node, relational_expr.EqualityExpression):
        return "=="
    strict = node.strict if isinstance(node.strict, tuple) else (node.strict,)
    return "".join("<" if each else "<=" for each in strict)
