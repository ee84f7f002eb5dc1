"""What a simulation is given and what it has to find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GuessError
from pyrobocop_pyomo.transcription import Guess, number_guess

from .controls import knots_of, variables_name
from .declarations import Algebraic, Control
from .initial_guesses import guess_values
from .record import PhaseRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unknowns:
    """What the equations at a collocation point determine.

    Attributes
    ----------
    implicit : tuple of str
        States whose derivatives stand in residual equations.
    algebraics : tuple of str
        Algebraics to find.
    order : tuple of str
        All algebraics and controls in the order of a trajectory.
    """

    implicit: tuple[str, ...]
    algebraics: tuple[str, ...]
    order: tuple[str, ...]


def find_unknowns(block: Any, record: PhaseRecord, given: Mapping[str, Guess]) -> Unknowns:
    """Tell what is to be found from what is given.

    Raises
    ------
    GuessError
        When a name is unknown, or equations and unknowns do not match.
    """
    algebraics, controls = record.names(Algebraic), record.names(Control)
    for name in given:
        if name not in algebraics + controls:
            raise GuessError(
                f"phase '{block.name}': '{name}' is given to a simulation, but it is neither control nor algebraic; "
                f"these are {', '.join(controls + algebraics) or 'none'}."
            )
    implicit = tuple(name for name in record.names_of_states if name not in record.equation_of)
    free = tuple(name for name in algebraics if name not in given)
    equations = record.residuals_per_point
    if equations == len(implicit) and free:
        free = ()  # pairs alone determine them, or nothing: they keep their guess
    if equations != len(implicit) + len(free):
        raise GuessError(
            f"phase '{block.name}': a simulation has {equations} residual equations per point for "
            f"{len(implicit) + len(free)} unknowns: {', '.join((*implicit, *free)) or 'none'}. Complementarity is not "
            "simulated; give the algebraics that pairs determine in controls={...}, and no others."
        )
    return Unknowns(implicit, free, (*algebraics, *controls))


def given_signals(block: Any, record: PhaseRecord, given: Mapping[str, Guess], unknowns: Unknowns) -> dict[str, Array]:
    """Values per element and stage of everything that is not to be found: as given, or as the phase holds them.

    Raises
    ------
    GuessError
        When a value has the wrong length, is missing or is not finite.
    """
    signals = {}
    at_knots = values_at_knots(block, record, given)
    for name in unknowns.order:
        if name in unknowns.algebraics:
            continue
        component = block.component(name)
        if name in at_knots:
            knots = knots_of(record, record.declarations[name], f"phase '{block.name}': '{name}'")  # type: ignore[arg-type]
            at = {t: float(np.interp(t, knots, at_knots[name])) for t in record.grid.points}
        elif name in given:
            number_of = {id(data): number for data, number in guess_values(block, record, name, given[name])}
            at = {t: number_of[id(component[t])] for t in record.grid.points}
        else:
            at = {t: _number(component[t]) for t in record.grid.points}
        signals[name] = np.array([[at[t] for t in times] for times in record.grid.stage_times])
    return signals


def values_at_knots(block: Any, record: PhaseRecord, given: Mapping[str, Guess]) -> dict[str, Array]:
    """Values of the piecewise linear controls at their knots: as given, or as the phase holds them.

    Raises
    ------
    GuessError
        When a value has the wrong length, is missing or is not finite.
    """
    values = {}
    for name in record.names(Control):
        control = record.declarations[name]
        if isinstance(control, Control) and control.parametrization == "piecewise_linear":
            if name in given:
                values[name] = np.array([number for _, number in guess_values(block, record, name, given[name])])
            else:
                held = block.component(variables_name(name, control)).values()
                values[name] = np.array([_number(data) for data in held])
    return values


def initial_states(block: Any, record: PhaseRecord, given: Mapping[str, float]) -> Array:
    """Where the states start: as given, or as the phase holds them.

    Raises
    ------
    GuessError
        When a name is no state or a value no finite number.
    """
    names = record.names_of_states
    unknown = [name for name in given if name not in names]
    if unknown:
        raise GuessError(
            f"phase '{block.name}': an initial value is given for '{unknown[0]}'; its states are "
            f"{', '.join(names) or 'none'}."
        )
    first = record.grid.times[0]
    return np.array(
        [
            number_guess(given[name], f"phase '{block.name}': initial value of '{name}'")
            if name in given
            else _number(block.component(name)[first])
            for name in names
        ],
        dtype=float,
    )


def _number(data: Any) -> float:
    if data.value is None:
        raise GuessError(f"'{data.name}' has no value to simulate with. Give it in the call, or a guess.")
    return float(data.value)
