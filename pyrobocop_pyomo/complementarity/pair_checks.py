"""What a nonlinear solver cannot hold in a pair: discrete variables, and numbers that are none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyomo.core.base.var import VarData
from pyomo.core.expr import MonomialTermExpression
from pyomo.core.expr.numvalue import native_types, value

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm


def refuse_leaves(forms: Iterable[CanonicalForm], *, discrete_allowed: bool = False) -> None:
    """Refuse NaN as a coefficient, parameter or value of a variable, and unfixed discrete variables.

    Raises
    ------
    ComplementarityError
        If there is one.
    """
    checked: set[int] = set()
    for form in forms:
        for leaf in _leaves(form, checked):
            number: Any = leaf
            if leaf.__class__ not in native_types:
                variable = isinstance(leaf, VarData) or leaf.is_variable_type()
                if variable and not discrete_allowed and not (leaf.is_continuous() or leaf.fixed):
                    raise ComplementarityError(
                        f"'{form.source.name}': holds the discrete variable '{leaf.name}'. Ipopt solves continuous "
                        "problems: relax its domain or fix it, or use pyrobocop.complementarity_to_disjunctions."
                    )
                number = leaf.value if variable else value(leaf, exception=False)
            if number != number:  # true of NaN alone
                raise ComplementarityError(f"'{form.source.name}': {_what_is_nan(leaf)}.")


def _what_is_nan(leaf: Any) -> str:
    if leaf.__class__ in native_types:
        return "a coefficient is NaN. Correct the number that it was computed from"
    if leaf.is_variable_type():
        return f"the value of variable '{leaf.name}' is NaN. Give it a number, or None for no value"
    return f"the parameter '{leaf.name}' is NaN. Give it a number"


def _leaves(form: CanonicalForm, seen: set[int]) -> Iterator[Any]:
    """Every number that is NaN, and every parameter and variable that is not yet in `seen`.

    A variable or an expression that several forms share is entered with the first of them only: `seen` outlives the
    form. Nearly all nodes are terms of sums, which are taken apart here and not put on the stack.
    """
    stack = [each for pair in form.pairs for each in (pair.a, pair.b)]
    for row in form.rows:
        stack.extend(row.args)
    while stack:
        node = stack.pop()
        if node.__class__ is MonomialTermExpression:
            coefficient, node = node.args
            if coefficient.__class__ not in native_types:
                stack.append(coefficient)
            elif coefficient != coefficient:
                yield coefficient
        if node.__class__ in native_types:
            if node != node:
                yield node
        elif id(node) not in seen:
            seen.add(id(node))
            if isinstance(node, VarData) or not node.is_expression_type():
                yield node
            else:
                stack.extend(node.args)
