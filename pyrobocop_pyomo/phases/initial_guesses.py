"""Guesses for a phase that is declared already: by name, from a trajectory, or as straight lines.

Only values of variables that are free to move change: what is fixed stays, bounds stay, and a value outside of its
bounds is moved onto the nearest one. Everything is checked before anything is set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import GuessError
from pyrobocop_pyomo.numerics import Grid, differentiation_matrix
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import Guess, guess_at, number_guess, stage_guess, state_guess

from .building import within
from .controls import knots_of, variables_name
from .declarations import Control, Parameter, State, is_held
from .horizon import real_grid
from .record import PhaseRecord

Array = NDArray[np.float64]
Values = list[tuple[Any, float]]


def set_guesses(block: Any, record: PhaseRecord, guesses: Mapping[Any, Guess]) -> None:
    """Set values by name; derivatives that are variables follow their states.

    Raises
    ------
    GuessError
        Naming what is unknown, of the wrong length or not finite; nothing is set then.
    """
    named = {_name_of(block, record, key): guess for key, guess in guesses.items()}
    if len(named) != len(guesses):
        raise GuessError(f"phase '{block.name}': a guess is given twice, by name and by variable. Give it once.")
    values = {name: guess_values(block, record, name, guess) for name, guess in named.items()}
    for each in values.values():
        _assign(each)
    for name in record.names_of_states:
        if name in named and name in record.kept_derivatives and f"{name}_derivative" not in named:
            _assign(_slopes(block, record, name))


def set_trajectory(block: Any, record: PhaseRecord, trajectory: Trajectory) -> None:
    """Set everything that a trajectory and the phase have in common; other names keep their values.

    The trajectory's own polynomials are evaluated at the phase's times, the whole horizon of the one stretched onto the
    whole horizon of the other.

    Raises
    ------
    GuessError
        When they have no name in common.
    """
    grid = record.grid
    fractions = _fractions(block, grid)
    # A trajectory answers at an element boundary for the element that ends there; a stage at an element start that no
    # other element shares belongs to the one that begins.
    starts = grid.scheme.starts_on_a_stage and not grid.elements_share_points
    begins = {times[0] for times in grid.stage_times} if starts else set()
    sampled = {
        "time": _evaluate(trajectory, [fractions(t) for t in grid.times]),
        "points": _evaluate(trajectory, [fractions(t) for t in grid.points], [t in begins for t in grid.points]),
        "elements": _evaluate(trajectory, [fractions(t) for t in element_middles(grid)]),
    }
    guesses: dict[str, Guess] = {}
    for name, declaration in record.declarations.items():
        if isinstance(declaration, Parameter):
            if name in trajectory.parameters:
                guesses[name] = trajectory.parameters[name]
        elif name in trajectory.names:
            if isinstance(declaration, Control) and declaration.parametrization == "piecewise_linear":
                knots = knots_of(record, declaration, f"phase '{block.name}': '{name}'")
                guesses[name] = _evaluate(trajectory, [fractions(t) for t in knots])[name]
                continue
            kind = "time" if isinstance(declaration, State) else "elements" if is_held(declaration) else "points"
            guesses[name] = sampled[kind][name]
    if not guesses:
        raise GuessError(
            f"phase '{block.name}': trajectory '{trajectory.name}' has {', '.join(trajectory.names) or 'no values'}; "
            f"the phase has {', '.join(record.declarations) or 'nothing'}. A guess needs a name in common."
        )
    if _is_free(block, "duration"):
        guesses["duration"] = trajectory.duration
    set_guesses(block, record, guesses)
    # The trajectory's own rates: between schemes, those of the polynomial through the new nodes would be less exact.
    rates = {name: each for name, each in trajectory.rates.items() if name in record.kept_derivatives}
    if rates:
        slopes = _evaluate(
            replace(trajectory, states={}, signals=rates), [fractions(t) for t in grid.points],
            [t in begins for t in grid.points],
        )  # fmt: skip
        real = real_grid(block, record).mesh.boundaries
        stretch = trajectory.duration / (real[-1] - real[0])
        set_guesses(block, record, {f"{name}_derivative": stretch * each for name, each in slopes.items()})


def set_straight_lines(block: Any, record: PhaseRecord) -> None:
    """Lead each state from its initial to its final value on a straight line.

    A range counts with the value nearest to the other end. Where only one end is stated the state stays there, and
    where none is it keeps its guess.
    """
    times = record.grid.times
    span = times[-1] - times[0]
    lines: dict[str, Guess] = {}
    for name in record.names_of_states:
        variable = block.component(name)
        declaration = record.declarations[name]
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
        start = start if first.fixed else within(within(end, last.bounds) if from_end else start, first.bounds)
        end = end if last.fixed else within(start, last.bounds)
        lines[name] = [start + (end - start) * ((t - times[0]) / span) for t in times]
    set_guesses(block, record, lines)


def guess_values(block: Any, record: PhaseRecord, name: str, guess: Guess) -> Values:
    """The variables behind a name, each once, with the values that a guess means for them."""
    what, grid = f"phase '{block.name}': '{name}'", record.grid
    component = block.component(name)
    declaration = record.declarations.get(name)
    if not component.is_indexed():
        number = number_guess(guess, what)
        if name == "duration" and number <= 0:
            raise GuessError(f"{what}: the guess is {number:g}; it must be positive.")
        return [(component, number)]
    if isinstance(declaration, State):
        return _paired([component[t] for t in grid.times], state_guess(guess, grid, what))
    if isinstance(declaration, Control) and declaration.parametrization == "piecewise_linear":
        knots = knots_of(record, declaration, what)
        return _paired(
            list(block.component(variables_name(name, declaration)).values()),
            guess_at(guess, knots, what, f"{len(knots)} knots"),
        )
    if declaration is None or not is_held(declaration):
        return _paired([component[t] for t in grid.points], stage_guess(guess, grid, what))
    # One variable for several points: the mean over its elements, each weighted by its width.
    per_element = guess_at(guess, element_middles(grid), what, f"{grid.mesh.elements} elements")
    sums: dict[int, tuple[Any, list[int]]] = {}
    for i, times in enumerate(grid.stage_times):
        data = component[times[-1]]
        sums.setdefault(id(data), (data, []))[1].append(i)
    widths = grid.mesh.widths
    return [(data, float(np.average(per_element[own], weights=widths[own]))) for data, own in sums.values()]


def element_middles(grid: Grid) -> list[float]:
    """The time index in the middle of each element."""
    return [(start + end) / 2 for start, end in pairwise(grid.mesh.boundaries)]


def _name_of(block: Any, record: PhaseRecord, key: Any) -> str:
    known = [*record.declarations, *(f"{name}_derivative" for name in record.names_of_states), "duration"]
    name = key if isinstance(key, str) else getattr(key, "local_name", repr(key))
    component = block.component(name)
    if name not in known or component is None or not (isinstance(key, str) or component is key):
        if name == "duration":
            raise GuessError(f"phase '{block.name}': its duration is the number {block.duration:g} and needs no guess.")
        raise GuessError(
            f"phase '{block.name}': a guess is given for '{name}', which it does not have; it has "
            f"{', '.join(each for each in known if block.component(each) is not None) or 'nothing'}."
        )
    return name


def _is_free(block: Any, name: str) -> bool:
    component = block.component(name)
    return component is not None and component.ctype is Var


def _paired(data: Sequence[Any], values: Array) -> Values:
    return list(zip(data, values.tolist(), strict=True))


def _slopes(block: Any, record: PhaseRecord, name: str) -> Values:
    """Derivative variables at the slopes of the polynomial through the state's values: their rows then hold."""
    grid, variable = record.grid, block.component(name)
    differentiate = differentiation_matrix(grid.scheme.state_nodes, grid.scheme.c)
    widths = real_grid(block, record).mesh.widths
    slopes: dict[float, float] = {}
    for times, stages, width in zip(grid.node_times, grid.stage_times, widths, strict=True):
        nodes = np.array([variable[t].value for t in times], dtype=float)
        slopes |= dict(zip(stages, (differentiate @ nodes / width).tolist(), strict=True))
    derivative = block.component(f"{name}_derivative")
    return [(derivative[t], slopes[t]) for t in grid.points]


def _fractions(block: Any, grid: Grid) -> Any:
    """Where in the horizon a time index lies, from 0 to 1."""
    clock = {t: float(value(block.clock(t))) for t in (grid.times[0], grid.times[-1])}
    start, span = clock[grid.times[0]], clock[grid.times[-1]] - clock[grid.times[0]]
    return lambda t: (float(value(block.clock(t))) - start) / span


def _evaluate(trajectory: Trajectory, fractions: Sequence[float], begins: Sequence[bool] = ()) -> dict[str, Array]:
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    times = np.clip(boundaries[0] + np.array(fractions) * trajectory.duration, boundaries[0], boundaries[-1])
    # A control may jump at an element end, and rounding must not carry a time to the other side of it.
    nearest = boundaries[np.abs(times[:, None] - boundaries[None, :]).argmin(axis=1)]
    times = np.where(np.abs(times - nearest) < 1e-12 * (1 + np.abs(boundaries).max()), nearest, times)
    if any(begins):
        times = np.where(begins, np.nextafter(times, boundaries[-1]), times)
    return trajectory(times)


def _assign(values: Values) -> None:
    for data, number in values:
        if not data.fixed:
            data.set_value(within(number, data.bounds), skip_validation=True)
