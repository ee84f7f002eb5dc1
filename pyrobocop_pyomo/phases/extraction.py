"""From the current values of a phase to a `Trajectory`."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import Complementarity, canonical_pair
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Grid, Mesh
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Algebraic, Control, Parameter, is_held
from .record import PhaseRecord


def extract_trajectory(block: Any, record: PhaseRecord) -> Trajectory:
    """Read the values of a phase, in real time.

    Raises
    ------
    TrajectoryError
        When a variable has no value.
    """
    grid = record.grid
    names = record.names(Algebraic) + record.names(Control)
    return Trajectory(
        name=block.name,
        grid=_real_time(block, record),
        states={name: _read(block, name, grid.times) for name in record.names_of_states},
        signals={name: _read(block, name, grid.points) for name in names},
        parameters={name: float(value(block.component(name))) for name in record.names(Parameter)},
        pairs=_read_pairs(block, grid),
        rates={
            name: _read_rates(block, name, record.grid.points)
            for name in record.names_of_states
            if _has_rate(block, record, name)
        },
        held=frozenset(name for name, declaration in record.declarations.items() if is_held(declaration)),
        phase=block,
    )


def _read(block: Any, name: str, times: tuple[float, ...]) -> np.ndarray:
    variable = block.component(name)
    values = [variable[time].value for time in times]
    if None in values:
        missing = variable[times[values.index(None)]]
        raise TrajectoryError(f"'{missing.name}' has no value. Solve the model first, or give it a guess.")
    return np.array(values, dtype=float)


def _has_rate(block: Any, record: PhaseRecord, name: str) -> bool:
    return name in record.equation_of or block.component(f"{name}_derivative") is not None


def _read_rates(block: Any, name: str, points: tuple[float, ...]) -> np.ndarray:
    rates = block.derivative(name)
    return np.array([float(value(rates[time])) for time in points])


def _real_time(block: Any, record: PhaseRecord) -> Grid:
    if record.start_is_known and not block.has_free_duration:
        return record.grid
    duration, start = float(value(block.duration)), float(value(record.start))
    mesh = Mesh(tuple(record.clock(t, duration, start) for t in record.grid.mesh.boundaries))
    return Grid(record.grid.scheme, mesh)


def _read_pairs(block: Any, grid: Grid) -> dict[str, np.ndarray]:
    """Both sides of every pair over the points, by the name under which the user stated it."""
    series: dict[str, np.ndarray] = {}
    position = {time: i for i, time in enumerate(grid.points)}
    for component in block.component_objects(Complementarity, descend_into=False):
        for index, data in component.items():
            time, *labels = index if isinstance(index, tuple) else (index,)
            if time not in position:
                continue
            name = component.local_name + "".join(f"[{label}]" for label in labels)
            pair = canonical_pair(data)
            sides = series.setdefault(name, np.full((2, len(grid.points)), np.nan))
            sides[:, position[time]] = value(pair.a), value(pair.b)
    return series
