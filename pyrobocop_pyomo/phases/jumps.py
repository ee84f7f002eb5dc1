"""What the rule of a jump may answer, and which states it gives."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression
from pyomo.core.expr.visitor import identify_variables

from pyrobocop_pyomo.errors import LinkError

from .phase_end import PhaseEnd
from .rule_results import labelled_rows


@dataclass
class Relations:
    """Relations that a jump states.

    Attributes
    ----------
    rows : dict of label to relation
    determined : set of str
        States of the second phase whose start stands in an equality.
    """

    rows: dict[Hashable, Any] = field(default_factory=dict)
    determined: set[str] = field(default_factory=set)


def sort_jump(
    what: str, second: Any, pre: PhaseEnd, post: PhaseEnd, jump: Callable[..., Any] | None
) -> tuple[dict[str, Any], Relations]:
    """Ask the rule; expressions by state, and relations.

    Raises
    ------
    LinkError
        When the answer is neither, or names what is no state of the second phase.
    """
    if jump is None:
        return {}, Relations()
    try:
        answer = jump(pre, post)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        raise LinkError(
            f"{what}: a variable cannot be the key of a dict. Write {{'speed': ...}}, the name of the state, "
            "or the relation post.speed == ..."
        ) from error
    starts = {id(second.component(name)[second.initial_time]): name for name in second.record.names_of_states}
    if isinstance(answer, Mapping):
        expressions: dict[str, Any] = {}
        for state, expression in answer.items():
            name = _name(what, second, list(starts.values()), state)
            if isinstance(expression, RelationalExpression) or not _is_numeric(expression):
                raise LinkError(
                    f"{what}: the jump gives '{expression}' as the start of '{name}'; expected an expression."
                )
            if name in expressions:
                raise LinkError(f"{what}: the jump gives the start of '{name}' twice.")
            expressions[name] = expression
        return expressions, Relations()
    relations = Relations()
    for label, relation in labelled_rows("constraint", answer).items():
        if not isinstance(relation, (RelationalExpression, tuple)):
            raise LinkError(
                f"{what}: the jump answered {relation!r}; expected {{state: expression}}, or one or several relations "
                "between pre and post. Is the return statement missing?"
            )
        relations.rows[0 if label is None else label] = relation
        if isinstance(relation, EqualityExpression):
            seen = {id(variable) for variable in identify_variables(relation, include_fixed=True)}
            relations.determined |= {name for key, name in starts.items() if key in seen}
    return {}, relations


def _name(what: str, second: Any, states: Iterable[str], state: Any) -> str:
    name = state if isinstance(state, str) else getattr(state, "local_name", repr(state))
    if name not in states or (not isinstance(state, str) and second.component(name) is not state):
        raise LinkError(
            f"{what}: the jump gives a start to '{name}', which is no state of '{second.name}'; its states are "
            f"{', '.join(states) or 'none'}."
        )
    return name


def _is_numeric(expression: Any) -> bool:
    return expression.__class__ in native_numeric_types or bool(getattr(expression, "is_numeric_type", bool)())
