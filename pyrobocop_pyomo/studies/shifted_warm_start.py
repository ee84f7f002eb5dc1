"""A plan moved ahead in time on its own grid, by weights that are found once for each distance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.phases.nodes import IntervalNodes, KnotNodes, Nodes, StateNodes
from pyrobocop_pyomo.phases.phase_values import PhaseValues, read_values, sample_times
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

Move = Callable[[Array], Array]


class ShiftedPlan:
    """Values of a phase read later: what `PhaseValues.sampled` gives for its own trajectory, at other times.

    Parameters
    ----------
    phase : PhaseBlock
        With fixed times.
    values : PhaseValues
        Of the phase.
    """

    def __init__(self, phase: Any, values: PhaseValues) -> None:
        self._phase, self._values = phase, values
        # A controller has one distance, or a few that its clock gives.
        self._moves_for = lru_cache(maxsize=8)(self.moves)

    def ahead(self, values: Mapping[str, Array], advance: float) -> dict[str, Array]:
        """The values that stand `advance` later in a plan; beyond its end the last ones.

        Parameters
        ----------
        values : mapping of name to array
            As `PhaseValues.read` gives them.
        advance : float
            In the time of the phase.
        """
        moves = self._moves_for(advance)
        return {name: moves[name](found) for name, found in values.items()}

    def moves(self, advance: float) -> dict[str, Move]:
        """What `ahead` does with the values of each name: a linear function of them."""
        alike: dict[tuple[type, tuple[float, ...]], Move] = {}
        moves = {}
        for name, nodes in self._values.nodes.items():
            key = type(nodes), nodes.times
            if key not in alike:
                alike[key] = _move(self._phase.grid, nodes, advance)
            moves[name] = alike[key]
        return moves


def _move(grid: Grid, nodes: Nodes, advance: float) -> Move:
    times = sample_times(grid, nodes, lambda t: t + advance)
    if isinstance(nodes, KnotNodes):
        return lambda values: np.interp(times, nodes.times, values)
    boundaries = np.array(grid.mesh.boundaries)
    element = np.clip(np.searchsorted(boundaries, times, side="left") - 1, 0, grid.mesh.elements - 1)
    if isinstance(nodes, IntervalNodes):
        interval = nodes.of_elements[element]
        return lambda values: nodes.from_samples(values[interval])
    local = np.clip((times - boundaries[element]) / grid.mesh.widths[element], 0.0, 1.0)
    if isinstance(nodes, StateNodes):
        weights, positions = grid.scheme.state_at(local), grid.node_positions[element]
    else:
        weights, positions = grid.scheme.stage_polynomial_at(local), grid.stage_positions[element]
    return lambda values: np.einsum("tk,tk->t", weights, values[positions])


class PlaceInProgram:
    """Where the values of a phase stand among the variables of a program.

    Parameters
    ----------
    values : PhaseValues
    variables : sequence of VarData
        Of the program.

    Attributes
    ----------
    columns : dict of str to int array
        Of each name of the phase; -1 for what is no variable of the program.
    """

    def __init__(self, values: PhaseValues, variables: Sequence[Any]) -> None:
        self.variables = variables
        column_of = {id(variable): column for column, variable in enumerate(variables)}
        self.columns: dict[str, NDArray[np.intp]] = {}
        self._others: dict[str, list[Any]] = {}
        for name, own in values.variables.items():
            self.columns[name] = np.array([column_of.get(id(variable), -1) for variable in own], dtype=np.intp)
            self._others[name] = [variable for variable in own if id(variable) not in column_of]

    def read(self, x: FloatArray) -> dict[str, Array]:
        """The values of the phase at a point of the program; what is no variable of it is read from the model.

        Raises
        ------
        TrajectoryError
            When that has no value.
        """
        found = {}
        for name, columns in self.columns.items():
            numbers = x[columns]
            if others := self._others[name]:
                numbers[columns < 0] = read_values(others)
            found[name] = numbers
        return found

    def put(self, values: Mapping[str, Array], x: FloatArray) -> None:
        """Put values of the phase into a point; what is no variable of the program, and not fixed, into the model."""
        for name, numbers in values.items():
            columns = self.columns[name]
            is_free = columns >= 0
            x[columns[is_free]] = numbers[is_free]
            for variable, number in zip(self._others[name], numbers[~is_free].tolist(), strict=True):
                if not variable.fixed:
                    variable.set_value(number, skip_validation=True)
