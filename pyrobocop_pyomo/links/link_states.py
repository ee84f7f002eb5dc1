"""What a link joins: ends of phases, states that continue, and states that jump."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import array, plain_expressions
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases import Algebraic, Control
from pyrobocop_pyomo.phases.families import equations_by_component, name_of, names_by_component
from pyrobocop_pyomo.phases.record import labelled_rows


class PhaseEnd:
    """What a phase declares, at its start or at its end, as attributes.

    A state is its variable there, a parameter its variable. An algebraic or control is the value of its polynomial,
    which a scheme without a point at that end extrapolates from its first or last element; a piecewise linear one has
    a knot there. Other components of the phase are handed over too, those indexed by time at that time. `duration` is
    that of the phase.

    Parameters
    ----------
    phase : PhaseBlock
    last : bool
        True for the end, False for the start.
    """

    def __init__(self, phase: Any, last: bool) -> None:
        self._phase = phase
        self._last = last
        self._read: set[str] = set()

    @property
    def duration(self) -> Any:
        """Duration of the phase: a number or a variable."""
        return self._phase.duration

    @property
    def time(self) -> Any:
        """Real time of this end: a number, or an expression in free durations."""
        return self._phase.time_at(self._index)

    @property
    def _index(self) -> float:
        return self._phase.final_time if self._last else self._phase.initial_time

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        declared, families = self._phase.record.declarations, self._phase.record.families
        if name in families:
            names = families[name]
            return array([getattr(self, member) for member in names.members]).reshape(names.shape)
        component = self._phase.component(name)
        if component is None:
            raise ModelError(
                f"phase '{self._phase.name}' has no '{name}', which a link asks for at its "
                f"{'end' if self._last else 'start'}; declared are {', '.join(declared) or 'none'}."
            )
        self._read.add(name)
        if isinstance(declared.get(name), (Algebraic, Control)):
            return component.at(self._index)  # it follows the mesh
        return component[self._index] if component.is_indexed() and self._index in component else component


def states_of_both(label: str, first: Any, second: Any, given: set[str], read: set[str]) -> dict[str, str]:
    """{state of the second: state of the first} for all common names that nothing else determines.

    Parameters
    ----------
    label : str
        The link, for messages.
    first, second : PhaseBlock
    given : set of str
        States to leave alone: those whose start a jump gives, and those that are omitted.
    read : set of str
        What a jump reads at the end of the first.

    Raises
    ------
    ModelError
        When a state is left over.
    """
    before, after = first.record.names_of_states, second.record.names_of_states
    continued = {name: name for name in after if name in before and name not in given}
    for name in after:
        start = second.component(name)[second.initial_time]
        if name not in continued and name not in given and not start.fixed:
            raise ModelError(
                f"{label}: nothing gives the start of state '{name}'; '{first.name}' has the states "
                f"{', '.join(before) or 'none'}. Give '{name}' in jump=, or leave it alone by omit=['{name}']."
            )
    for name in before:
        if name not in continued and name not in given | read:
            raise ModelError(
                f"{label}: state '{name}' of '{first.name}' goes nowhere; '{second.name}' has the states "
                f"{', '.join(after) or 'none'}. Use it in jump=, or leave it alone by omit=['{name}']."
            )
    return continued


def states_given(label: str, first: Any, second: Any, states: Any, determined: set[str]) -> dict[str, str]:
    """{state of the second: state of the first} for the user's own list or mapping.

    Raises
    ------
    ModelError
        When a name is no state, or a start is given twice.
    """
    sources = states if isinstance(states, Mapping) else names_by_component(first.record, listed(states))
    continued: dict[str, str] = {}
    for source in sources:
        target = states[source] if isinstance(states, Mapping) else source
        before, after = _state_name(label, first, name_of(source)), _state_name(label, second, name_of(target))
        if after in determined | set(continued):
            raise ModelError(f"{label}: the start of state '{after}' is given twice. Take it out of states=.")
        continued[after] = before
    return continued


def omitted_states(label: str, first: Any, second: Any, omit: Any) -> set[str]:
    """Names of the states to leave alone.

    Raises
    ------
    ModelError
        When a name is a state of neither phase.
    """
    named = names_by_component(second.record, names_by_component(first.record, listed(omit)))
    names = {name_of(state) for state in named}
    known = {*first.record.names_of_states, *second.record.names_of_states}
    for name in names - known:
        raise ModelError(f"{label}: omit= names '{name}', which is a state of neither phase.")
    return names


def listed(names: Any) -> list[Any]:
    """Several names, or one alone, as a list."""
    return [names] if isinstance(names, str) else list(names)


def _state_name(label: str, phase: Any, state: Any) -> str:
    try:
        return phase.state_name(state)
    except ModelError as error:
        raise ModelError(f"{label}: {error}") from None


def jump_of(
    what: str, second: Any, pre: PhaseEnd, post: PhaseEnd, jump: Callable[..., Any] | None
) -> tuple[dict[str, Any], dict[Any, Any], set[str]]:
    """Ask the rule: expressions by state, relations by label, and the states whose start these give.

    Raises
    ------
    ModelError
        When the result is neither, or names what is no state of the second phase.
    """
    expressions: dict[str, Any] = {}
    relations: dict[Any, Any] = {}
    if jump is None:
        return expressions, relations, set()
    try:
        result = jump(pre, post)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        raise ModelError(
            f"{what}: a variable cannot be the key of a dict. Write {{'speed': ...}}, the name of the state, "
            "or the relation post.speed == ..."
        ) from error
    if isinstance(result, Mapping):
        for state, expression in plain_expressions(equations_by_component(second.record, result, what)).items():
            name = _state_name(f"{what}, its jump", second, state)
            numeric = expression.__class__ in native_numeric_types or hasattr(expression, "is_numeric_type")
            if isinstance(expression, RelationalExpression) or not numeric:
                raise ModelError(
                    f"{what}: the jump gives '{expression}' as the start of '{name}'; expected an expression."
                )
            if name in expressions:
                raise ModelError(f"{what}: the jump gives the start of '{name}' twice.")
            expressions[name] = expression
        return expressions, relations, set(expressions)
    seen: set[int] = set()
    for label, relation in labelled_rows("constraint", plain_expressions(result)).items():
        if not isinstance(relation, (RelationalExpression, tuple)):
            raise ModelError(
                f"{what}: the jump returned {relation!r}; expected {{state: expression}}, or one or several relations "
                "between pre and post. Is the return statement missing?"
            )
        relations[0 if label is None else label] = relation
        if isinstance(relation, EqualityExpression):
            seen |= {id(variable) for variable in variables_in(relation, include_fixed=True)}
    names = second.record.names_of_states
    return expressions, relations, {n for n in names if id(second.component(n)[second.initial_time]) in seen}
