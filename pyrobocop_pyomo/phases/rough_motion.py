"""A rough motion under the controls of a phase, put on it as a start: cheap, and as good as a start need be."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.numerics import Array

from .declarations import Parameter
from .horizon import real_grid
from .rate_arrays import PointRates
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
    signals = {}
    for name in record.names_of_signals:
        nodes = record.nodes(name)
        values = np.array([float(value(variable)) for variable in nodes.variables(block)])
        signals[name] = nodes.at_points(values)[indices.stage_positions]
    rates = PointRates(block, record, indices, grid, signals, {}, parameters)
    rates.refresh()
    state = initial_states(block, record, {})
    motion = np.full((len(indices.times), state.size), np.nan)
    motion[0] = state
    position = {time: place for place, time in enumerate(indices.times)}
    for i, width in enumerate(grid.mesh.widths.tolist()):
        first, last = indices.mesh.boundaries[i : i + 2]
        for begin, end in pairwise(np.union1d(indices.scheme.state_nodes, [0.0, 1.0]).tolist()):
            state = _step(rates, i, begin, end, width, state)
            if not np.abs(state).max() < LARGEST:
                return None
            time = last if end == 1.0 else float(first + (last - first) * end)
            if time in position:
                motion[position[time]] = state
    return motion if np.isfinite(motion).all() else None


def _step(rates: PointRates, i: int, begin: float, end: float, width: float, state: Array) -> Array:
    """The fourth-order step between two places of an element."""
    step, middle = (end - begin) * width, 0.5 * (begin + end)
    first = rates(i, begin, state)
    second = rates(i, middle, state + 0.5 * step * first)
    third = rates(i, middle, state + 0.5 * step * second)
    return np.asarray(state + step / 6.0 * (first + 2.0 * second + 2.0 * third + rates(i, end, state + step * third)))
