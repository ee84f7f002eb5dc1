"""What a nonlinear solver cannot hold in a pair: discrete variables, and numbers that are none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyomo.core.expr.numvalue import native_types, value

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalForm


def refuse_discrete(forms: Iterable[CanonicalForm]) -> None:
    """Refuse unfixed integer and binary variables in a side.

    Raises
    ------
    ComplementarityError
        If there is one.
    """
    for form in forms:
        for leaf in _leaves(form):
            if _is_variable(leaf) and not (leaf.is_continuous() or leaf.fixed):
                raise ComplementarityError(
                    f"'{form.source.name}': holds the discrete variable '{leaf.name}'. Ipopt solves continuous "
                    "problems: relax its domain or fix it, or use pyrobocop.complementarity_to_disjunctions."
                )


def refuse_nan(forms: Iterable[CanonicalForm]) -> None:
    """Refuse coefficients, parameters and values of variables that are NaN.

    Raises
    ------
    ComplementarityError
        If there is one.
    """
    for form in forms:
        for leaf in _leaves(form):
            number = leaf if leaf.__class__ in native_types else value(leaf, exception=False)
            if isinstance(number, float) and number != number:
                what = (
                    f"the value of variable '{leaf.name}' is NaN. Give it a number, or None for no value"
                    if _is_variable(leaf)
                    else f"the parameter '{leaf.name}' is NaN. Give it a number"
                    if hasattr(leaf, "name")
                    else "a coefficient is NaN. Correct the number that it was computed from"
                )
                raise ComplementarityError(f"'{form.source.name}': {what}.")


def _is_variable(leaf: Any) -> bool:
    return leaf.__class__ not in native_types and leaf.is_variable_type()


def _leaves(form: CanonicalForm) -> Iterator[Any]:
    """Every number, parameter and variable once; a shared subexpression is entered once."""
    stack = [each for pair in form.pairs for each in (pair.a, pair.b)]
    stack += [each for row in form.rows for each in row.args]
    seen: set[int] = set()
    while stack:
        node = stack.pop()
        if node.__class__ in native_types:
            yield node
        elif id(node) not in seen:
            seen.add(id(node))
            if node.is_expression_type():
                stack.extend(node.args)
            else:
                yield node
