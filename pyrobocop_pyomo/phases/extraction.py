"""From the current values of a phase to a `Trajectory`."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import Complementarity, canonical_form, side_values
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.trajectories import Trajectory

from .controls import knots_of, variables_name
from .declarations import Algebraic, Control, Parameter, is_held
from .horizon import real_grid, real_time
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
        grid=real_grid(block, record),
        states={name: _read(block, name, grid.times) for name in record.names_of_states},
        signals={name: _read(block, name, grid.points) for name in names},
        parameters={name: float(value(block.component(name))) for name in record.names(Parameter)},
        pairs=_read_pairs(block, grid),
        rates={
            name: _read_rates(block, name, record.grid.points)
            for name in record.names_of_states
            if _has_rate(block, record, name)
        },
        linear=_read_linear(block, record),
        held=frozenset(name for name, declaration in record.declarations.items() if is_held(declaration)),
        phase=block,
    )


def _read(block: Any, name: str, times: tuple[float, ...]) -> np.ndarray:
    variable = block.component(name)
    values = [value(variable[time], exception=False) for time in times]
    if None in values:
        missing = variable[times[values.index(None)]]
        raise TrajectoryError(f"'{missing.name}' has no value. Solve the model first, or give it a guess.")
    return np.array(values, dtype=float)


def _has_rate(block: Any, record: PhaseRecord, name: str) -> bool:
    return name in record.equation_of or block.component(f"{name}_derivative") is not None


def _read_rates(block: Any, name: str, points: tuple[float, ...]) -> np.ndarray:
    rates = block.derivative(name)
    return np.array([float(value(rates[time])) for time in points])


def _read_linear(block: Any, record: PhaseRecord) -> dict[str, np.ndarray]:
    """Knots and values of the piecewise linear controls, in real time."""
    found = {}
    for name in record.names(Control):
        control = record.declarations[name]
        assert isinstance(control, Control)
        if control.parametrization == "piecewise_linear":
            knots = knots_of(record, control, f"'{block.name}.{name}'")
            values = block.component(variables_name(name, control)).values()
            clocks = [float(value(real_time(block, record, knot))) for knot in knots]
            found[name] = np.array([clocks, [each.value for each in values]], dtype=float)
    return found


def _read_pairs(block: Any, grid: Grid) -> dict[str, np.ndarray]:
    """Both sides of every pair over the points, by the name under which the user stated it; a range has two."""
    series: dict[str, np.ndarray] = {}
    position = {time: i for i, time in enumerate(grid.points)}
    for component in block.component_objects(Complementarity, descend_into=False):
        for index, data in component.items():
            time, *labels = index if isinstance(index, tuple) else (index,)
            if time not in position:
                continue
            name = component.local_name + "".join(f"[{label}]" for label in labels)
            for pair in canonical_form(data).pairs:
                label = f"{name} ({pair.role})" if pair.role else name
                sides = series.setdefault(label, np.full((2, len(grid.points)), np.nan))
                sides[:, position[time]] = side_values(pair)
    return series
