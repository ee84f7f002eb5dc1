"""Multipliers of a model's rows and bounds, whoever found them, and those of a phase's rows at its stages.

The latter are costates, and densities of what else restrains the motion.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.phases import Algebraic, Control, State
from pyrobocop_pyomo.phases.declarations import in_infinities
from pyrobocop_pyomo.phases.nodes import StageNodes
from pyrobocop_pyomo.phases.record import Statement


@dataclass(frozen=True, eq=False)
class RowMultipliers:
    """What the objective would change by, per unit, in the signs of Pyomo's suffixes; by the identity of components.

    Attributes
    ----------
    rows : mapping of int to float
        As in ``dual``: change of the objective as stated per unit of the right-hand side.
    lower, upper : mapping of int to float
        As in ``ipopt_zL_out`` and ``ipopt_zU_out``.
    """

    rows: Mapping[int, float]
    lower: Mapping[int, float]
    upper: Mapping[int, float]

    def of_row(self, row: Any) -> float:
        """That of a constraint; 0 where it has none, as a row without free variables."""
        return self.rows.get(id(row), 0.0)


@dataclass(frozen=True, eq=False)
class PhaseMultipliers:
    """Arrays of shape ``(N, s)`` over elements and stages, in the sign of Pyomo's ``dual``, per unit of time.

    Attributes
    ----------
    costates : dict of state name to array
        Change of the objective per unit of a state, there and then.
    starts : dict of state name to array, shape (N,)
        The same at element starts, where the scheme determines it apart from the stages.
    rows : list of (Statement, label, array)
        Of the rows of each constraint and residual equation.
    bounds : list of (name, side, array)
        Of the bounds of states and algebraics; side 0 is the lower one.
    room : dict of control name to (array, array)
        The bounds of controls at the stages; a fixed one has no room.
    """

    costates: Mapping[str, Array]
    starts: Mapping[str, Array]
    rows: list[tuple[Statement, Any, Array]]
    bounds: list[tuple[str, int, Array]]
    room: Mapping[str, tuple[Array, Array]]


def phase_multipliers(phase: Any, found: RowMultipliers, real: Grid) -> PhaseMultipliers:
    """Read the multipliers of a phase.

    Parameters
    ----------
    phase : PhaseBlock
    found : RowMultipliers
    real : Grid
        That of the phase in real time.

    Raises
    ------
    TrajectoryError
        When some row has no multiplier, or the scheme has stages without weight.
    """
    record = phase.record
    grid: Grid = record.grid
    scheme = grid.scheme
    if not (scheme.b > 0.0).all():
        raise TrajectoryError(f"phase '{phase.name}': {scheme.name} has stages without weight, and no costates there.")
    if record.discrete_states:
        raise TrajectoryError(f"phase '{phase.name}': states that a step map leads have no costates.")
    weights = _at_points(real, real.quadrature_weights)
    costates, starts = {}, {}
    for name in record.names_of_states:
        if name not in record.equation_of:
            continue
        if name in record.kept_derivatives:
            of_row = _by_index(found, phase.component(f"{name}_equation"))
            costates[name] = _at_points(grid, of_row) / weights
            continue
        of_row = _by_index(found, phase.component(f"{name}_collocation"))
        at_rows = np.array([[of_row[times[r]] for r in scheme.row_stages] for times in grid.stage_times])
        costates[name] = at_rows @ scheme.F / scheme.b
        if not scheme.end_is_a_node:
            of_end = _by_index(found, phase.component(f"{name}_continuity"))
            at_ends = np.array([of_end[end] for end in grid.mesh.boundaries[1:]])
            starts[name] = -(at_rows @ scheme.D[:, 0]) - at_ends * scheme.end_weights[0]
    rows_of = [entry for kind in ("constraint", "residual") for entry in _rows(phase, found, kind, grid, weights)]
    room = {name: _room(phase, name, grid) for name in record.names(Control)}
    return PhaseMultipliers(costates, starts, rows_of, _bounds(phase, found, grid, weights), room)


def _by_index(found: RowMultipliers, rows: Any) -> dict[Any, float]:
    known = found.rows
    by_index = {index: known.get(id(row)) for index, row in rows.items()}
    if None in by_index.values():
        missing = next(rows[index] for index, number in by_index.items() if number is None)
        raise TrajectoryError(f"'{missing.name}' has no multiplier.")
    return cast("dict[Any, float]", by_index)


def _at_points(grid: Grid, by_time: Mapping[float, float]) -> Array:
    return np.array([[by_time[time] for time in times] for times in grid.stage_times])


def _rows(
    phase: Any, found: RowMultipliers, kind: str, grid: Grid, weights: Array
) -> list[tuple[Statement, Any, Array]]:
    entries = []
    for statement in phase.record.statements_of(kind):
        by_label: defaultdict[Any, dict[float, float]] = defaultdict(lambda: dict.fromkeys(grid.points, 0.0))
        for index, row in phase.component(statement.name).items():
            time, label = index if isinstance(index, tuple) else (index, None)
            by_label[label][time] = found.of_row(row)
        entries += [(statement, label, _at_points(grid, by_time) / weights) for label, by_time in by_label.items()]
    return entries


def _bounds(phase: Any, found: RowMultipliers, grid: Grid, weights: Array) -> list[tuple[str, int, Array]]:
    entries = []
    for kind in (State, Algebraic):
        for name in phase.record.names(kind):
            variables = phase.component(name)
            ends = getattr(phase.record.declarations[name], "final", None) is not None
            identities = [id(variables[time]) for time in grid.points]
            for side, known in enumerate((found.lower, found.upper)):
                numbers = np.array([known.get(identity, 0.0) for identity in identities])
                if ends:
                    numbers[-1] = 0.0  # what is required at the end restrains nothing before
                # Multipliers of a solved program that restrain nothing are of the size of the barrier parameter.
                if (np.abs(numbers) > ROUNDING).any():
                    entries.append((name, side, numbers[grid.stage_positions] / weights))
    return entries


def _room(phase: Any, name: str, grid: Grid) -> tuple[Array, Array]:
    """Between which values a control may be at the stages."""
    nodes = phase.record.nodes(name)
    if isinstance(nodes, StageNodes):
        pairs = [(of.value, of.value) if of.fixed else (of.lb, of.ub) for of in nodes.variables(phase)]
        lower, upper = np.transpose([in_infinities(pair) for pair in pairs])
    else:
        sides = in_infinities(phase.record.declarations[name].bounds_at(0.0, name))
        lower, upper = (np.broadcast_to(side, len(grid.points)) for side in sides)
    return lower[grid.stage_positions], upper[grid.stage_positions]
