"""The same problem on fewer elements, as numbers: where a fine mesh starts from.

The number of iterations grows with the number of pairs, though the solution hardly changes with the mesh. Of a scheme
whose only stage ends the element (implicit Euler), the row of a wide element is the row of the last narrow one in it,
once the states in between lie on a line: ``(X' - X) / k = h f(X')`` says ``X' - X = k h f(X')``. So a coarse mesh needs
no second model: of the program of the fine one, it leaves out variables and rows.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.nodes import StageNodes, StateNodes
from pyrobocop_pyomo.programs.aggregated_program import AggregatedProgram
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# So many variables may belong to no phase: parameters, durations. More are variables over sets of the user's own, of
# whose times nothing is known.
_GLOBAL_VARIABLES = 100

_GLOBAL, _GENERATED = -1, -2
# From so many pairs on, a problem is solved on a coarse mesh of about so many elements first, where it can be.
COARSENED_PAIRS, COARSE_ELEMENTS = 1000, 400


def is_worth_coarsening(pairs: int) -> bool:
    """Whether a problem with so many pairs is solved on a coarse mesh first."""
    return pairs >= COARSENED_PAIRS


def coarsen(compiled: CompiledModel, generated: Any, elements: int) -> AggregatedProgram | None:
    """A program on a mesh of about so many elements; None where it cannot be read off from the fine one.

    Parameters
    ----------
    compiled : CompiledModel
    generated : Block or None
        Variables on it belong to where the rows are in which they appear.
    elements : int
        Of the longest phase.
    """
    phases = phases_of(compiled.model)
    if not phases or not all(_can_be_coarsened(phase) for phase in phases):
        return None
    step = math.ceil(max(phase.grid.mesh.elements for phase in phases) / elements)
    if step < 2:
        return None
    places = _ColumnPlaces(compiled, phases, generated)
    if np.count_nonzero(places.phase == _GLOBAL) > _GLOBAL_VARIABLES:
        return None
    stay = []
    for phase in phases:
        stays = np.zeros(phase.grid.mesh.elements + 1, dtype=bool)
        stays[::step] = stays[-1] = True
        stay.append(stays)
    return _aggregated(compiled, phases, places, stay)


def _can_be_coarsened(phase: Any) -> bool:
    scheme, record = phase.grid.scheme, phase.record
    names = (*record.names_of_states, *record.names_of_signals)
    return (
        scheme.stages == 1
        and scheme.c[0] == 1.0
        and not record.discrete_states
        and not record.free_widths
        and all(isinstance(record.nodes(name), (StateNodes, StageNodes)) for name in names)
    )


class _ColumnPlaces:
    """Where the variables of a program are.

    Attributes
    ----------
    phase, boundary : int array, shape (n,)
        Number of the phase, and of the element boundary where a state is or that ends the element of a signal;
        a negative number of phase for what has no such place.
    column_at : dict of (phase, name, boundary) to int
        Column of a variable.
    """

    def __init__(self, compiled: CompiledModel, phases: list[Any], generated: Any) -> None:
        place_of: dict[int, tuple[int, str, int]] = {}
        for number, phase in enumerate(phases):
            record = phase.record
            boundary_of = {time: i for i, time in enumerate(phase.grid.mesh.boundaries)}
            kept = [f"{state}_derivative" for state in record.kept_derivatives]
            for name in (*record.names_of_states, *record.names_of_signals, *kept):
                nodes = record.nodes(name)
                for time, variable in zip(nodes.times, nodes.variables(phase), strict=True):
                    place_of[id(variable)] = number, name, boundary_of[time]
        self.phase = np.full(compiled.nlp.n, _GLOBAL)
        self.boundary = np.full(compiled.nlp.n, -1)
        self.column_at: dict[tuple[int, str, int], int] = {}
        for column, variable in enumerate(compiled.variables):
            place = place_of.get(id(variable))
            if place is not None:
                self.phase[column], _, self.boundary[column] = place
                self.column_at[place] = column
            elif variable.parent_block() is generated:
                self.phase[column] = _GENERATED


def _aggregated(
    compiled: CompiledModel, phases: list[Any], places: _ColumnPlaces, stay: list[Array]
) -> AggregatedProgram:
    nlp = compiled.nlp
    rows, columns = nlp.jacobian_structure
    kept_rows = np.ones(nlp.m, dtype=bool)
    for number, stays in enumerate(stay):
        # A row belongs to the last boundary that it reads; those between two that stay are left out.
        last = _last_boundary(nlp, places.phase == number, places)
        kept_rows &= (last < 0) | stays[last]
    kept = np.zeros(nlp.n, dtype=bool)
    kept[columns[kept_rows[rows]]] = True
    kept |= places.phase == _GLOBAL
    for number, stays in enumerate(stay):
        of_phase = places.phase == number
        kept[of_phase] = stays[places.boundary[of_phase]]
    return AggregatedProgram(nlp, *_interpolation(compiled, phases, places, stay, kept), np.flatnonzero(kept_rows))


def _last_boundary(nlp: Any, of_phase: Array, places: _ColumnPlaces) -> Array:
    """Of each row, the last boundary of a phase that it reads, also through generated variables; -1 for none."""
    rows, columns = nlp.jacobian_structure
    boundary = np.where(of_phase, places.boundary, -1)
    last = np.full(nlp.m, -1)
    np.maximum.at(last, rows, boundary[columns])
    through = places.phase[columns] == _GENERATED
    np.maximum.at(boundary, columns[through], last[rows[through]])
    np.maximum.at(last, rows, boundary[columns])
    return last


def _interpolation(
    compiled: CompiledModel, phases: list[Any], places: _ColumnPlaces, stay: list[Array], kept: Array
) -> tuple[csr_array, Array, Any]:
    """The matrix and offset that lead from the variables that are kept to all, and which those are."""
    kept_columns = np.flatnonzero(kept)
    number_of = np.full(kept.size, -1)
    number_of[kept_columns] = np.arange(kept_columns.size)
    entries = [(column, number, 1.0) for number, column in enumerate(kept_columns.tolist())]
    offset = np.where(kept, 0.0, compiled.current_point())
    for (of, name, boundary), column in places.column_at.items():
        if kept[column]:
            continue
        offset[column] = 0.0
        phase, staying = phases[of], np.flatnonzero(stay[of])
        after = int(staying[np.searchsorted(staying, boundary)])
        weights = {after: 1.0}  # a signal keeps its value over a wide element
        nodes = phase.record.nodes(name)
        if isinstance(nodes, StateNodes):
            before = int(staying[np.searchsorted(staying, boundary) - 1])
            times = phase.grid.mesh.boundaries
            share = (times[boundary] - times[before]) / (times[after] - times[before])
            weights = {before: 1.0 - share, after: share}
        for at, weight in weights.items():
            source = places.column_at.get((of, name, at))
            if source is not None:
                entries.append((column, int(number_of[source]), weight))
            else:  # fixed, or not used
                value = phase.component(nodes.component)[phase.grid.mesh.boundaries[at]].value
                offset[column] += weight * (value or 0.0)
    matrix_rows, matrix_columns, weights_of = zip(*entries, strict=True)
    shape = (kept.size, kept_columns.size)
    return scipy.sparse.csr_array((weights_of, (matrix_rows, matrix_columns)), shape=shape), offset, kept_columns
