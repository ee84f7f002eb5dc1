"""Guesses for a phase that is declared already: by name, from a trajectory, on straight lines, or through waypoints.

Only values of variables that are free to move change: what is fixed stays, bounds stay, and a value outside of its
bounds is moved onto the nearest one. Everything is checked before anything is set.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array, differentiation_matrix
from pyrobocop_pyomo.numerics.arrays import finite_numbers
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Parameter, State
from .families import guesses_by_component, name_of
from .horizon import horizon_fraction, real_grid
from .nodes import InitialGuess, initial_number
from .phase_values import PhaseValues, read_values
from .record import PhaseRecord

Values = list[tuple[Any, float]]


def set_guesses(block: Any, guesses: Mapping[Any, InitialGuess]) -> None:
    """Set values by name; derivatives that are variables follow their states.

    Raises
    ------
    InitialGuessError
        Naming what is unknown, of the wrong length or not finite; nothing is set then.
    """
    guesses = guesses_by_component(block.record, guesses, f"phase '{block.name}'")
    named = {_name_of(block, key): guess for key, guess in guesses.items()}
    if len(named) != len(guesses):
        raise InitialGuessError(
            f"phase '{block.name}': an initial guess is given twice, by name and by variable. Give it once."
        )
    values = {name: guess_values(block, name, guess) for name, guess in named.items()}
    for assigned in values.values():
        _assign(assigned)
    _let_derivatives_follow(block, named)


def set_trajectory(block: Any, trajectory: Trajectory) -> None:
    """Set everything that a trajectory and the phase have in common; other names keep their values.

    The trajectory's own polynomials are evaluated at the phase's times, the whole horizon of the one stretched onto the
    whole horizon of the other.

    Raises
    ------
    InitialGuessError
        When they have no name in common.
    """
    record: PhaseRecord = block.record
    values, fraction = PhaseValues(block), horizon_fraction(block)
    begin = trajectory.grid.mesh.boundaries[0]
    found = values.sampled(trajectory, lambda t: begin + fraction(t) * trajectory.duration)
    shared = [name for name in record.names(Parameter) if name in trajectory.parameters]
    guesses: dict[str, InitialGuess] = {name: trajectory.parameters[name] for name in shared}
    if not any(name in record.declarations for name in (*found, *guesses)):
        raise InitialGuessError(
            f"phase '{block.name}': trajectory '{trajectory.name}' has {', '.join(trajectory.names) or 'no values'}; "
            f"the phase has {', '.join(record.declarations) or 'nothing'}. An initial guess needs a name in common."
        )
    if block.has_free_duration:
        guesses["duration"] = trajectory.duration
    set_guesses(block, guesses)
    real = real_grid(block).mesh.boundaries
    stretch = trajectory.duration / (real[-1] - real[0])
    for name, numbers in found.items():
        is_rate = name not in record.declarations
        numbers = stretch * numbers if is_rate else numbers
        _assign(list(zip(values.variables[name], numbers.tolist(), strict=True)))
    _let_derivatives_follow(block, found)


def set_straight_lines(block: Any) -> None:
    """Lead each state from its initial to its final value on a straight line.

    A range counts with the value nearest to the other end. Where only one end is stated the state stays there, and
    where none is it keeps its initial guess.
    """
    times = block.record.grid.times
    span = times[-1] - times[0]
    lines: dict[str, InitialGuess] = {}
    for name in block.record.names_of_states:
        variable = block.component(name)
        declaration = block.record.declarations[name]
        assert isinstance(declaration, State)
        first, last = variable[times[0]], variable[times[-1]]
        from_start = first.fixed or declaration.initial is not None
        from_end = last.fixed or declaration.final is not None
        if not from_start and not from_end:
            continue
        start, end = (first if from_start else last).value, (last if from_end else first).value
        start, end = (end if start is None else start), (start if end is None else end)
        if start is None:
            continue
        # Twice, because both ends may be ranges: nearest to the other, then the other nearest to it.
        start = start if first.fixed else within_bounds(within_bounds(end, last) if from_end else start, first)
        end = end if last.fixed else within_bounds(start, last)
        lines[name] = [start + (end - start) * ((t - times[0]) / span) for t in times]
    set_guesses(block, lines)


def waypoint_initial_guess(
    phase: Any, waypoints: Mapping[Any, Sequence[float]], *, even_in: Iterable[Any] | None = None
) -> dict[str, Callable[[float], float]]:
    """Initial guess of states on straight lines through waypoints, for ``phase.initialize``.

    Parameters
    ----------
    phase : PhaseBlock
    waypoints : dict of str or Var to list of float
        Values of each state at all waypoints, the first at the start of the phase and the last at its end. Two or more
        values, the same number for every state.
    even_in : list of str or Var, optional
        States in whose space the speed is constant. They need the same unit: positions, for example, but not angles.
        All states by default.

    Returns
    -------
    dict of str to function
        Of the time index.

    Raises
    ------
    InitialGuessError
        When names, lengths or values do not fit.

    Examples
    --------
    ::

        waypoints = {"x": [0, 2, 4], "y": [0, 1, 0], "theta": [0, 0, 1]}
        phase.initialize(rcp.scenes.waypoint_initial_guess(phase, waypoints, even_in="xy"))
    """
    fraction = horizon_fraction(phase)
    names = [_name_of(phase, key) for key in waypoints]
    lines = finite_numbers(list(waypoints.values()), f"phase '{phase.name}': waypoints", InitialGuessError)
    if lines.ndim != 2 or lines.shape[1] < 2:
        raise InitialGuessError(
            f"phase '{phase.name}': waypoints of the shape {lines.shape}; expected one list per state, all of one "
            "length, two values or more: {'x': [0, 1, 2], ...}."
        )
    values = dict(zip(names, lines, strict=True))
    counted = list(values) if even_in is None else [_name_of(phase, key) for key in even_in]
    if not counted or set(counted) - set(values):
        raise InitialGuessError(
            f"phase '{phase.name}': even_in has {', '.join(counted) or 'nothing'}; waypoints are given for "
            f"{', '.join(values)}. Name one or more of these."
        )
    lengths = np.sqrt(sum(np.diff(values[name]) ** 2 for name in counted))
    if lengths.sum() == 0.0:
        lengths = np.ones_like(lengths)  # only other states change: equal time for every line
    reached = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    return {name: _along(reached, numbers, fraction) for name, numbers in values.items()}


def _along(reached: Array, values: Array, fraction: Callable[[float], float]) -> Callable[[float], float]:
    return lambda t: float(np.interp(fraction(t), reached, values))


def guess_values(block: Any, name: str, guess: InitialGuess) -> Values:
    """The variables behind a name, each once, with the values that an initial guess means for them."""
    what = f"phase '{block.name}': '{name}'"
    component = block.component(name)
    if not component.is_indexed():
        number = initial_number(guess, what)
        if name == "duration" and number <= 0:
            raise InitialGuessError(f"{what}: the initial guess is {number:g}; it must be positive.")
        return [(component, number)]
    nodes = block.record.nodes(name)
    return list(zip(nodes.variables(block), nodes.from_guess(guess, what).tolist(), strict=True))


def _name_of(block: Any, key: Any) -> str:
    known = [*block.record.declarations, *(f"{name}_derivative" for name in block.record.names_of_states), "duration"]
    name = name_of(key)
    component = block.component(name)
    if name not in known or component is None or not (isinstance(key, str) or component is key):
        raise InitialGuessError(
            f"phase '{block.name}': an initial guess is given for '{name}', which it does not have; it has "
            f"{', '.join(known_name for known_name in known if block.component(known_name) is not None) or 'nothing'}."
        )
    return name


def _let_derivatives_follow(block: Any, given: Container[str]) -> None:
    """Derivative variables get the slopes of the polynomials through the states that were given: their rows hold."""
    grid = block.record.grid
    differentiate = differentiation_matrix(grid.scheme.state_nodes, grid.scheme.c)
    for name in sorted(block.record.kept_derivatives):
        if name in given and f"{name}_derivative" not in given:
            nodes = read_values(block.record.nodes(name).variables(block))[grid.node_positions]
            slopes = np.empty(len(grid.points))
            slopes[grid.stage_positions] = nodes @ differentiate.T / real_grid(block).mesh.widths[:, None]
            _assign(list(zip(block.component(f"{name}_derivative").values(), slopes.tolist(), strict=True)))


def _assign(values: Values) -> None:
    for data, number in values:
        if not data.fixed:
            data.set_value(within_bounds(number, data), skip_validation=True)
