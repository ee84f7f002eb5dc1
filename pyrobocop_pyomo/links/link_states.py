"""What a link joins: ends of phases, states that continue, and states that jump."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import array, plain_expressions
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, State
from pyrobocop_pyomo.phases.families import equations_by_component, names_by_component
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
        declared = self._phase.record.declarations
        if name in self._phase.record.families:
            names = self._phase.record.families[name]
            return array([getattr(self, member) for member in names.members]).reshape(names.shape)
        component = self._phase.component(name)
        if component is None:
            raise ModelError(
                f"phase '{self._phase.name}' has no '{name}', which a link asks for at its "
                f"{'end' if self._last else 'start'}; declared are {', '.join(declared) or 'none'}."
            )
        self._read.add(name)
        declaration = declared.get(name)
        if isinstance(declaration, State):
            return component[self._index]
        if isinstance(declaration, (Algebraic, Control)):
            return component.at(self._index)  # it follows the mesh
        return component[self._index] if component.is_indexed() and self._index in component else component


def states_of_both(
    label: str, first: Any, second: Any, determined: set[str], omitted: set[str], read: set[str]
) -> dict[str, str]:
    """{state of the second: state of the first} for all common names that nothing else determines.

    Parameters
    ----------
    label : str
        The link, for messages.
    first, second : PhaseBlock
    determined : set of str
        States of the second whose start a jump gives.
    omitted : set of str
        States to leave alone.
    read : set of str
        What a jump reads at the end of the first.

    Raises
    ------
    ModelError
        When a state is left over.
    """
    before, after = first.record.names_of_states, second.record.names_of_states
    continued = {name: name for name in after if name in before and name not in determined | omitted}
    for name in after:
        start = second.component(name)[second.initial_time]
        if name not in continued and name not in determined | omitted and not start.fixed:
            raise ModelError(
                f"{label}: nothing gives the start of state '{name}'; '{first.name}' has the states "
                f"{', '.join(before) or 'none'}. Give '{name}' in jump=, or leave it alone by omit=['{name}']."
            )
    for name in before:
        if name not in continued and name not in read | omitted | determined:
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
    if isinstance(states, Mapping):
        given = list(states.items())
    else:
        given = [(state, state) for state in names_by_component(first.record, listed(states))]
    continued: dict[str, str] = {}
    for source, target in given:
        before, after = _state_name(label, first, source), _state_name(label, second, target)
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
    for name in names:
        if name not in first.record.names_of_states and name not in second.record.names_of_states:
            raise ModelError(f"{label}: omit= names '{name}', which is a state of neither phase.")
    return names


def shared_parameter(label: str, first: Any, second: Any, parameter: Any) -> str:
    """Name of a parameter that both phases have.

    Raises
    ------
    ModelError
        When one of them does not.
    """
    name = name_of(parameter)
    for phase in (first, second):
        known = phase.record.names(Parameter)
        if name not in known:
            raise ModelError(
                f"{label}: '{name}' is no parameter of '{phase.name}'; its parameters are {', '.join(known) or 'none'}."
            )
    return name


def name_of(variable: Any) -> str:
    """A name given as such, or by a variable of either phase."""
    return variable if isinstance(variable, str) else getattr(variable, "local_name", None) or repr(variable)


def listed(names: Any) -> list[Any]:
    """Several names, or one alone, as a list."""
    return [names] if isinstance(names, str) else list(names)


def _state_name(label: str, phase: Any, state: Any) -> str:
    try:
        return phase.state_name(name_of(state))
    except ModelError as error:
        raise ModelError(f"{label}: {error}") from None


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
    ModelError
        When the result is neither, or names what is no state of the second phase.
    """
    if jump is None:
        return {}, Relations()
    try:
        result = jump(pre, post)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        raise ModelError(
            f"{what}: a variable cannot be the key of a dict. Write {{'speed': ...}}, the name of the state, "
            "or the relation post.speed == ..."
        ) from error
    starts = {id(second.component(name)[second.initial_time]): name for name in second.record.names_of_states}
    if isinstance(result, Mapping):
        expressions: dict[str, Any] = {}
        for state, expression in plain_expressions(equations_by_component(second.record, result, what)).items():
            name = _name(what, second, list(starts.values()), state)
            if isinstance(expression, RelationalExpression) or not _is_numeric(expression):
                raise ModelError(
                    f"{what}: the jump gives '{expression}' as the start of '{name}'; expected an expression."
                )
            if name in expressions:
                raise ModelError(f"{what}: the jump gives the start of '{name}' twice.")
            expressions[name] = expression
        return expressions, Relations()
    relations = Relations()
    for label, relation in labelled_rows("constraint", plain_expressions(result)).items():
        if not isinstance(relation, (RelationalExpression, tuple)):
            raise ModelError(
                f"{what}: the jump returned {relation!r}; expected {{state: expression}}, or one or several relations "
                "between pre and post. Is the return statement missing?"
            )
        relations.rows[0 if label is None else label] = relation
        if isinstance(relation, EqualityExpression):
            seen = {id(variable) for variable in variables_in(relation, include_fixed=True)}
            relations.determined |= {name for key, name in starts.items() if key in seen}
    return {}, relations


def _name(label: str, second: Any, states: Iterable[str], state: Any) -> str:
    name = state if isinstance(state, str) else getattr(state, "local_name", None) or repr(state)
    if name not in states or (not isinstance(state, str) and second.component(name) is not state):
        raise ModelError(
            f"{label}: the jump gives a start to '{name}', which is no state of '{second.name}'; its states are "
            f"{', '.join(states) or 'none'}."
        )
    return name


def _is_numeric(expression: Any) -> bool:
    return expression.__class__ in native_numeric_types or bool(getattr(expression, "is_numeric_type", bool)())
