"""What a simulation is given and what it has to find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.transcription import InitialGuess, initial_number

from .declarations import Algebraic, Control
from .phase_values import read_values
from .record import PhaseRecord

Array = NDArray[np.float64]

_NO_VALUE = "has no value to simulate with. Give it in the call, or an initial guess."


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


def find_unknowns(block: Any, record: PhaseRecord, given: Mapping[str, InitialGuess]) -> Unknowns:
    """Tell what is to be found from what is given.

    Raises
    ------
    InitialGuessError
        When a name is unknown, or equations and unknowns do not match.
    """
    algebraics, controls = record.names(Algebraic), record.names(Control)
    for name in given:
        if name not in algebraics + controls:
            raise InitialGuessError(
                f"phase '{block.name}': '{name}' is given to a simulation, but it is neither control nor algebraic; "
                f"these are {', '.join(controls + algebraics) or 'none'}."
            )
    implicit = tuple(name for name in record.names_of_states if name not in record.equation_of)
    free = tuple(name for name in algebraics if name not in given)
    equations = record.residuals_per_point
    if equations == len(implicit) and free:
        free = ()  # pairs alone determine them, or nothing: they keep their guess
    if equations != len(implicit) + len(free):
        raise InitialGuessError(
            f"phase '{block.name}': a simulation has {equations} residual equations per point for "
            f"{len(implicit) + len(free)} unknowns: {', '.join((*implicit, *free)) or 'none'}. Complementarity is not "
            "simulated; give the algebraics that pairs determine in controls={...}, and no others."
        )
    return Unknowns(implicit, free, (*algebraics, *controls))


def given_values(
    block: Any, record: PhaseRecord, given: Mapping[str, InitialGuess], unknowns: Unknowns
) -> dict[str, Array]:
    """Values over its nodes of everything that is not to be found: as given, or as the phase has them.

    Raises
    ------
    InitialGuessError
        When a value has the wrong length, is missing or is not finite.
    """
    values = {}
    for name in unknowns.order:
        if name not in unknowns.algebraics:
            nodes = record.nodes(name)
            if name in given:
                values[name] = nodes.from_guess(given[name], f"phase '{block.name}': '{name}'")
            else:
                values[name] = read_values(nodes.variables(block), InitialGuessError, _NO_VALUE)
    return values


def initial_states(block: Any, record: PhaseRecord, given: Mapping[str, float]) -> Array:
    """Where the states start: as given, or as the phase holds them.

    Raises
    ------
    InitialGuessError
        When a name is no state or a value no finite number.
    """
    names = record.names_of_states
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InitialGuessError(
            f"phase '{block.name}': an initial value is given for '{unknown[0]}'; its states are "
            f"{', '.join(names) or 'none'}."
        )
    first = record.grid.times[0]
    return np.array(
        [
            initial_number(given[name], f"phase '{block.name}': initial value of '{name}'")
            if name in given
            else float(read_values([block.component(name)[first]], InitialGuessError, _NO_VALUE)[0])
            for name in names
        ],
        dtype=float,
    )
