"""A rough motion under the controls of a phase, put on it as a start: cheap, and as good as a start need be."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.variable_values import values_restored
from pyrobocop_pyomo.numerics import Array

from .declarations import Parameter
from .horizon import real_grid
from .rate_arrays import PointRates, compiled_rates
from .record import PhaseRecord
from .simulation import initial_states

# A motion that leaves these numbers is of no use.
LARGEST = 1e6


def put_rough_motion(block: Any) -> bool:
    """Let the states of a phase follow its controls and algebraics, by one step of Runge and Kutta from node to node.

    Parameters
    ----------
    block : PhaseBlock
        Every free variable has a value; algebraics keep theirs, whatever the equations say.

    Returns
    -------
    bool
        Whether there is such a motion: every state has an explicit equation, and stays moderate. Otherwise values are
        as before.
    """
    record = block.record
    explicit = set(record.equation_of) - record.discrete_states >= set(record.names_of_states)
    if not explicit or record.delayed_names or not record.names_of_states:
        return False
    try:
        with np.errstate(all="ignore"):
            motion = _motion(block, record)
    except (PyRobocopError, ArithmeticError, ValueError, TypeError, KeyError):
        return False  # a rule may raise anything at such values
    if motion is None:
        return False
    for name, values in zip(record.names_of_states, motion.T.tolist(), strict=True):
        for variable, number in zip(record.nodes(name).variables(block), values, strict=True):
            if variable.is_variable_type() and not variable.fixed:  # a moving end is an expression
                variable.set_value(number, skip_validation=True)
    return True


def _motion(block: Any, record: PhaseRecord) -> Array | None:
    """States at the times of the grid, shape ``(times, states)``; None where they have no moderate values."""
    grid, indices = real_grid(block, record), record.grid
    parameters = {name: float(block.component(name).value) for name in record.names(Parameter)}
    with values_restored(block.component_data_objects(Var)):
        rates = compiled_rates(block, record, grid, parameters)
    if rates is None:
        return None
    rates.refresh()
    signals = {}
    for name in record.names_of_signals:
        nodes = record.nodes(name)
        values = np.array([float(value(variable)) for variable in nodes.variables(block)])
        signals[name] = nodes.at_points(values)[indices.stage_positions]
    state = initial_states(block, record, {})
    motion = np.full((len(indices.times), state.size), np.nan)
    motion[0] = state
    position = {time: place for place, time in enumerate(indices.times)}
    local = np.union1d(indices.scheme.state_nodes, [0.0, 1.0])
    halves = np.sort(np.concatenate([local, 0.5 * (local[1:] + local[:-1])]))
    weights = indices.scheme.stage_polynomial_at(halves.tolist()).T
    for i, width in enumerate(grid.mesh.widths):
        first, last = indices.mesh.boundaries[i : i + 2]
        at = {name: (per_stage[i] @ weights).tolist() for name, per_stage in signals.items()}
        times = (first + halves * (last - first)).tolist()
        for k, (begin, end) in enumerate(pairwise(local.tolist())):
            places = [(times[2 * k + j], {name: values[2 * k + j] for name, values in at.items()}) for j in range(3)]
            state = _step(rates, record.names_of_states, state, (end - begin) * width, places)
            if not np.abs(state).max() < LARGEST:
                return None
            time = last if end == 1.0 else float(first + (last - first) * end)
            if time in position:
                motion[position[time]] = state
    return motion if np.isfinite(motion).all() else None


def _step(rates: PointRates, names: list[str], state: Array, step: float, places: Any) -> Array:
    """The fourth-order step, with what is given at its start, middle and end."""

    def slope(place: Any, at: Array) -> Array:
        index, given = place
        found = rates(index, {**given, **dict(zip(names, at.tolist(), strict=True))})
        return np.array([found[name] for name in names])

    start, middle, end = places
    first = slope(start, state)
    second = slope(middle, state + 0.5 * step * first)
    third = slope(middle, state + 0.5 * step * second)
    last = slope(end, state + step * third)
    return np.asarray(state + step / 6.0 * (first + 2.0 * second + 2.0 * third + last))
