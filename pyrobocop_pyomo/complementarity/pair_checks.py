"""What a nonlinear solver cannot hold in a pair: discrete variables, and numbers that are none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

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
    for form in forms:
        for leaf in _leaves(form):
            number: Any = leaf
            if leaf.__class__ not in native_types:
                variable = leaf.is_variable_type()
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
