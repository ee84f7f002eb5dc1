"""Which states continue from one phase to the next, and what is wrong with those that do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyrobocop_pyomo.errors import LinkError, TranscriptionError

from .declarations import Parameter


def states_of_both(
    what: str, first: Any, second: Any, determined: set[str], omitted: set[str], read: set[str]
) -> dict[str, str]:
    """{state of the second: state of the first} for all common names that nothing else determines.

    Parameters
    ----------
    what : str
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
    LinkError
        When a state is left over.
    """
    before, after = first.record.names_of_states, second.record.names_of_states
    continued = {name: name for name in after if name in before and name not in determined | omitted}
    for name in after:
        start = second.component(name)[second.initial_time]
        if name not in continued and name not in determined | omitted and not start.fixed:
            raise LinkError(
                f"{what}: nothing gives the start of state '{name}'; '{first.name}' has the states "
                f"{', '.join(before) or 'none'}. Give '{name}' in jump=, or leave it alone by omit=['{name}']."
            )
    for name in before:
        if name not in continued and name not in read | omitted | determined:
            raise LinkError(
                f"{what}: state '{name}' of '{first.name}' goes nowhere; '{second.name}' has the states "
                f"{', '.join(after) or 'none'}. Use it in jump=, or leave it alone by omit=['{name}']."
            )
    return continued


def states_given(what: str, first: Any, second: Any, states: Any, determined: set[str]) -> dict[str, str]:
    """{state of the second: state of the first} for the user's own list or mapping.

    Raises
    ------
    LinkError
        When a name is no state, or a start is given twice.
    """
    given = states.items() if isinstance(states, Mapping) else [(each, each) for each in listed(states)]
    continued: dict[str, str] = {}
    for source, target in given:
        before, after = _state_name(what, first, source), _state_name(what, second, target)
        if after in determined | set(continued):
            raise LinkError(f"{what}: the start of state '{after}' is given twice. Take it out of states=.")
        continued[after] = before
    return continued


def omitted_states(what: str, first: Any, second: Any, omit: Any) -> set[str]:
    """Names of the states to leave alone.

    Raises
    ------
    LinkError
        When a name is a state of neither phase.
    """
    names = {name_of(each) for each in listed(omit)}
    for name in names:
        if name not in first.record.names_of_states and name not in second.record.names_of_states:
            raise LinkError(f"{what}: omit= names '{name}', which is a state of neither phase.")
    return names


def shared_parameter(what: str, first: Any, second: Any, parameter: Any) -> str:
    """Name of a parameter that both phases have.

    Raises
    ------
    LinkError
        When one of them does not.
    """
    name = name_of(parameter)
    for phase in (first, second):
        known = phase.record.names(Parameter)
        if name not in known:
            raise LinkError(
                f"{what}: '{name}' is no parameter of '{phase.name}'; its parameters are {', '.join(known) or 'none'}."
            )
    return name


def name_of(variable: Any) -> str:
    """A name given as such, or by a variable of either phase."""
    return variable if isinstance(variable, str) else getattr(variable, "local_name", repr(variable))


def listed(names: Any) -> list[Any]:
    """Several names, or one alone, as a list."""
    return [names] if isinstance(names, str) else list(names)


def _state_name(what: str, phase: Any, state: Any) -> str:
    try:
        return phase.state_name(name_of(state))
    except TranscriptionError as error:
        raise LinkError(f"{what}: {error}") from None
