"""Values at other times than a rule's own: ``b.x.delayed(t, tau)``, and ``b.x.at(time)``.

On a grid both are values of the collocation polynomial of the element that the time lies in, hence linear expressions
in its variables. Which element that is, is found when the rule is evaluated, anew on another mesh. Between the points
of a grid, where a rule gets numbers, the values come from a trajectory or from the motion so far.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import numpy as np
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.modeling.rule_slips import number_at
from pyrobocop_pyomo.modeling.time_index import point_of
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.templates.slots import Place, Slot
from pyrobocop_pyomo.templates.template import Reading, TimeTemplate, is_asked_for_all_times
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Duration
from .horizon import real_time
from .nodes import IntervalNodes, Nodes, StateNodes
from .record import PhaseRecord, hand_out

VALUES_AT_TIMES = "values_at_times"

# Relative to the horizon: times that are nearer to each other than rounding are the same.
SAME_TIME = 1e-10
# Values of a name at earlier times.
Past = Callable[[str, Array], Array]


def delay_as_number(delay: Any, label: str) -> float:
    """A delay as the number that it is now.

    Raises
    ------
    ModelError
        When it is none, or looks ahead.
    """
    delay = plain_entry(delay)
    if getattr(delay, "is_potentially_variable", bool)():
        raise ModelError(
            f"{label} is delayed by '{delay}', which is to be found: the element of t minus the delay is then not "
            "known when the rows are made. Give a number or a Param, and compare several of them."
        )
    try:
        number = float(value(delay))
    except (TypeError, ValueError):
        raise ModelError(f"{label} is delayed by {delay!r}; expected a number or a Param.") from None
    if not math.isfinite(number) or number < 0.0:
        raise ModelError(f"{label} is delayed by {number:g}; a delay is a finite number, 0 or more.")
    return number


class Delayed(Slot):
    """``component.delayed(t, delay)``; `rest` is the delay."""

    def on_model(self, place: Place) -> Any:
        """What the grid has there."""
        return self.component.delayed(place.t, self.rest[0])


class ValueAt(Slot):
    """``component.at(time)``; `rest` is the time index."""

    def on_model(self, place: Place) -> Any:
        """The value on the grid that the phase has now."""
        block = self.component.parent_block()
        return _value_at_time(block, self.component.local_name, self.rest[0])  # type: ignore[arg-type]


class ValueAtEachTime(Slot):
    """``component.at(t)`` at the time of the rule, as a history that another phase goes on from has it."""

    def on_model(self, place: Place) -> Any:
        """The value on the grid that the phase has now."""
        return self.component.at(place.t)


def delayed_value(block: Any, name: str, t: Any, delay: Any) -> Any:
    """The value of a declared name at a time index minus a delay in real time; see `SignalVar.delayed`."""
    record: PhaseRecord = block.record
    if isinstance(t, TimeTemplate):
        return Reading(Delayed(block.component(name), (plain_entry(delay),)))
    what = f"phase '{block.name}': '{name}'"
    t, number = point_of(t), delay_as_number(delay, what)
    if number > 0.0:
        record.delayed_names.add(name)
    if number == 0.0:
        return block.component(name)[t]
    grid = record.grid
    start, end = grid.mesh.boundaries[0], grid.mesh.boundaries[-1]
    index = _snapped(grid.times, t - number / _time_per_index(record, what), SAME_TIME * (end - start))
    nodes = record.nodes(name)
    after = nodes.starts_elements
    # At the very start a stage at the end of its element means what was before; it may be something else.
    before = index == start and not after and getattr(record.declarations[name], "history", None) is not None
    if index < start or before:
        time = real_time(block, index) if record.normalised else index
        return history_value(record, name, time, what, number, t)
    return value_at(block, nodes, index, after=after)


def _time_per_index(record: PhaseRecord, label: str) -> float:
    if not record.normalised:
        return 1.0
    if isinstance(record.duration, Duration) or record.free_widths:
        found = "its duration is" if isinstance(record.duration, Duration) else "the boundaries of its elements are"
        raise ModelError(
            f"{label} is delayed, but {found} to be found, so that the element of t minus the delay is not known "
            "when the rows are made. Give the phase a duration in numbers (a sweep compares several), and elements "
            "that stay."
        )
    return float(record.duration)


def history_value(record: PhaseRecord, name: str, time: Any, label: str, delay: float, t: Any = None) -> Any:
    """The value before the phase starts, as it was declared.

    Raises
    ------
    ModelError
        When there is no history.
        When it is no number.
    """
    declaration = record.declarations[name]
    history = getattr(declaration, "history", None)
    kind = type(declaration).__name__
    if history is None:
        asked = f" at t = {t:g}" if isinstance(t, (int, float)) else ""
        raise ModelError(
            f"{label} is delayed by {delay:g}{asked}, which asks for it before the phase starts. Say what it was then: "
            f"{kind}(history=...), a number or a function of time (declared at {declaration.declared_at})."
        )
    if callable(history):
        history = number_at(history, time, f"{label}: its history", ModelError)
    found = plain_entry(history)
    wrong = not _is_number(found)
    if wrong or (found.__class__ in native_numeric_types and not math.isfinite(found)):
        raise ModelError(
            f"{label}: its history (declared at {declaration.declared_at}) is {found!r} at time {time}; expected a "
            "finite number or an expression."
        )
    return found


def _is_number(found: Any) -> bool:
    return found.__class__ in native_numeric_types or bool(getattr(found, "is_numeric_type", bool)())


def value_at(block: Any, nodes: Nodes, index: float, *, after: bool) -> Any:
    """The polynomial's value at a time index: a variable, where one is there, or a linear expression."""
    if isinstance(nodes, StateNodes):
        times = nodes.times
        if (position := bisect_left(times, index)) < len(times) and times[position] == index:
            return nodes.variable(block, position)  # at an element end it is no node of the polynomial
    weights = nodes.weights_at(index, after=after)
    weights = [(position, weight) for position, weight in weights if abs(weight) > ROUNDING] or weights[:1]
    variables = [nodes.variable(block, position) for position, _ in weights]
    if len(weights) == 1 and abs(weights[0][1] - 1.0) < ROUNDING:
        return variables[0]
    return LinearExpression(linear_vars=variables, linear_coefs=[weight for _, weight in weights])


def _snapped(times: tuple[float, ...], index: float, slack: float) -> float:
    i = bisect_left(times, index)
    near = [time for time in times[max(i - 1, 0) : i + 1] if abs(time - index) <= slack]
    return near[0] if near else index


# -------------------------------------------------------------------- values at fixed times


def value_at_time(block: Any, name: str, time: Any) -> Any:
    """See `SignalVar.at`: a variable, or a member of the named expression that follows the mesh."""
    if isinstance(time, TimeTemplate):
        return Reading(ValueAtEachTime(block.component(name)))
    record: PhaseRecord = block.record
    what = f"phase '{block.name}': '{name}'"
    boundaries = record.grid.mesh.boundaries
    start, end = boundaries[0], boundaries[-1]
    number = float(value(point_of(time)))
    if not start - SAME_TIME * (end - start) <= number <= end + SAME_TIME * (end - start):
        raise ModelError(f"{what} is read at {number:g}; its time indices run from {start:g} to {end:g}.")
    known = tuple(sorted({*record.grid.times, *record.named_times}))
    record.named_times.add(_snapped(known, number, SAME_TIME * (end - start)))
    if is_asked_for_all_times():
        return Reading(ValueAt(block.component(name), (number,)))
    found = _value_at_time(block, name, number)
    nodes = record.nodes(name)
    # The first interval of a control is another one on another mesh, and so is the first point inside an element.
    is_of_end = number == end if isinstance(nodes, IntervalNodes) else number in nodes.times
    stays = number in (start, end) and is_of_end and found.is_variable_type()
    if record.asking or record.restating is not None or stays:
        return found
    return hand_out(block, VALUES_AT_TIMES, record.values_at_times, (name, number), found)


def restate_values_at_times(block: Any) -> None:
    """Give every value that was handed out its expression on the grid that the phase has now."""
    for position, (name, time) in enumerate(block.record.values_at_times, start=1):
        block.component(VALUES_AT_TIMES)[position].set_value(_value_at_time(block, name, time))


def _value_at_time(block: Any, name: str, number: float) -> Any:
    boundaries = block.record.grid.mesh.boundaries
    index = _snapped(block.record.grid.times, number, SAME_TIME * (boundaries[-1] - boundaries[0]))
    return value_at(block, block.record.nodes(name), index, after=index == boundaries[0])


# -------------------------------------------------------------------- the past, as numbers


class MotionSoFar:
    """States at earlier times, as far as an integration has come; other names by a function.

    Parameters
    ----------
    names : list of str
        The states, in their order.
    others : callable
        ``others(name, times)``, for algebraics and controls.
    start : float
    state : array, shape (n,)
        Where the motion starts.
    """

    def __init__(self, names: list[str], others: Past, start: float, state: Array) -> None:
        self._position = {name: i for i, name in enumerate(names)}
        self._others = others
        self._ends = [start]
        self._states: list[Callable[[float], Array]] = [lambda time: state]

    def append(self, end: float, states: Callable[[float], Array]) -> None:
        """Go on to a time, with states at the times until then."""
        self._ends.append(end)
        self._states.append(states)

    def state(self, time: float) -> Array:
        """All states at a time that the motion has come to."""
        return self._states[min(bisect_left(self._ends, time), len(self._ends) - 1)](time)

    def __call__(self, name: str, times: Array) -> Array:
        """Values at times that the motion has come to."""
        if name not in self._position:
            return self._others(name, times)
        return np.array([self.state(time)[self._position[name]] for time in times.tolist()])


def past_of(trajectory: Trajectory) -> Past:
    """Values of a trajectory at earlier times."""
    first, last = trajectory.grid.mesh.boundaries[0], trajectory.grid.mesh.boundaries[-1]
    return lambda name, times: np.asarray(trajectory(np.clip(times, first, last))[name], dtype=float)
