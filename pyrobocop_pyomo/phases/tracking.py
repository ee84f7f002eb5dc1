"""Following a reference: the integral of the squared deviation from it."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Real
from typing import Any, NoReturn

import numpy as np
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expressions import is_indexed_component
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.modeling.rule_slips import takes_arguments
from pyrobocop_pyomo.numerics import Grid, Mesh, lobatto
from pyrobocop_pyomo.numerics.arrays import finite_numbers, increasing_numbers
from pyrobocop_pyomo.trajectories import Trajectory

from .families import family_in, name_of, references_by_component


def tracking_cost(block: Any, variable: Any, reference: Any, weight: Any) -> Any:
    """See `PhaseBlockData.tracking`."""
    if (names := family_in(block.record, variable)) is not None:
        every = zip(names.members, references_by_component(names, reference, f"phase '{block.name}'"), strict=True)
        return sum(tracking_cost(block, member, of, weight) for member, of in every)
    name = name_of(variable)
    what = f"phase '{block.name}': tracking '{name}'"
    component = block.component(name) if name in block.record.declarations else None
    if component is None or not component.is_indexed() or not (isinstance(variable, str) or component is variable):
        raise ModelError(f"{what}: it is no state, algebraic or control of this phase.")
    wanted = _rule(block, name, reference, f"{what}: the reference")
    weigh = _rule(block, name, weight, f"{what}: the weight")
    # Read through the phase that the rule is given, so that it holds between the points of the mesh as well.
    return block.integral(lambda b, t: weigh(b, t) * (b.component(name)[t] - wanted(b, t)) ** 2)


def _rule(block: Any, name: str, given: Any, label: str) -> Callable[[Any, Any], Any]:
    """What is given for all times, as a rule of the phase."""
    if isinstance(given, (Real, NumericValue)):  # the latter can be called, too
        return lambda b, t: given
    if is_indexed_component(given):
        missing = [t for t in block.points if t not in given]
        if missing:
            raise ModelError(
                f"{label} '{given.name}' has no value at t = {missing[0]:g}. Index it by the time or the points of the "
                "phase."
            )
        return lambda b, t: given[t]
    if callable(given) and not isinstance(given, Trajectory):
        if not takes_arguments(given, 1) and takes_arguments(given, 2):
            return given
        return lambda b, t: given(b.time_at(t))
    data = given if isinstance(given, Trajectory) else _joined_by_lines(name, given, label)
    if name not in data.names:
        raise ModelError(f"{label}: trajectory '{data.name}' has no '{name}'.")
    first, last = (float(time) for time in data.time[[0, -1]])
    asked = Function(lambda at: data(at[:, 0])[name], _no_derivatives, check_derivatives=False, name=name)
    if block.has_normalised_time:
        raise ModelError(
            f"{label}: data need times that are numbers, but something of the horizon is to be found. Give a function "
            "of time made of Pyomo's functions."
        )
    slack = 1e-9 * (last - first)
    start, end = block.record.grid.times[0], block.record.grid.times[-1]
    if first > start + slack or last < end - slack:
        raise ModelError(
            f"{label} runs from {first:g} to {last:g}, the phase from {start:g} to {end:g}. Give it for all of it."
        )
    return lambda b, t: asked(b.time_at(t))


def _no_derivatives(points: Any) -> NoReturn:
    raise NotImplementedError  # times are numbers


def _joined_by_lines(name: str, reference: Any, label: str) -> Trajectory:
    if not isinstance(reference, (tuple, list, np.ndarray)) or len(reference) != 2:
        raise ModelError(f"{label} is no number, expression, function, trajectory or pair (times, values) of numbers.")
    times = increasing_numbers(reference[0], f"{label}: its times", ModelError)
    values = finite_numbers(reference[1], f"{label}: its values", ModelError)
    if times.shape != values.shape:
        raise ModelError(f"{label}: times of shape {times.shape} and values of shape {values.shape} do not fit.")
    return Trajectory(name, Grid(lobatto(2), Mesh(tuple(times.tolist()))), {name: values}, {}, {}, {})
