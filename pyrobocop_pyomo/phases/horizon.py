"""When a phase happens: start, duration and element boundaries, each a number or a variable.

Time indices are real times as long as all three are numbers. As soon as one of them is to be found, the phase is
stated in normalised time: indices run from 0 to 1, and `PhaseBlock.time_at` gives the time that an index stands for.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import partial
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import RangeSet
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import InitialGuessError, ModelError
from pyrobocop_pyomo.modeling.time_index import TimeIndex, point_of
from pyrobocop_pyomo.modeling.variable_values import within
from pyrobocop_pyomo.numerics import Grid, Mesh

from .declarations import Duration, Start, check_bounds
from .nodes import initial_number
from .record import PhaseRecord, place


def add_horizon(block: Any, start: Any) -> None:
    """Add start, duration and, where elements may move, their boundaries to a phase block.

    Raises
    ------
    ModelError, InitialGuessError
        When bounds or guesses do not fit.
    """
    what = f"phase '{block.name}'"
    _add_duration(block, f"{what}: duration")
    if isinstance(start, Start):
        bounds = check_bounds(start.bounds, f"{what}: start", "bounds")
        guess = initial_number(start.initial_guess, f"{what}: start")
        block.start = Var(bounds=bounds, initialize=within(guess, bounds), units=block.record.time_units)
    elif isinstance(start, float):
        block.start = with_units(block.record, start)
    else:
        block.start = Expression(expr=start)
    if block.record.free_widths:
        add_boundaries(block, what)


def _add_duration(block: Any, label: str) -> None:
    duration = block.record.duration
    if not isinstance(duration, Duration):
        block.duration = with_units(block.record, float(duration))
        return
    lower, upper = check_bounds(duration.bounds, label, "bounds")
    if duration.initial_guess is None:
        assert lower is not None  # the caller has refused a duration without positive lower bound
        guess = lower if upper is None else math.sqrt(lower * upper)  # durations spread over magnitudes
    else:
        guess = initial_number(duration.initial_guess, label)
        if guess <= 0:
            raise InitialGuessError(f"{label}: the initial guess is {guess:g}; it must be positive.")
    block.duration = Var(bounds=(lower, upper), initialize=within(guess, (lower, upper)), units=block.record.time_units)


def add_boundaries(block: Any, label: str) -> None:
    """Add the element boundaries as variables, and rows for the widths between them.

    Raises
    ------
    ModelError
        When the factors are no range around 1.
    """
    mesh, factors = block.record.grid.mesh, block.record.width_factors
    lower, upper = check_bounds(factors, label, "free_element_widths")
    if lower is None or upper is None or not 0 < lower <= 1 <= upper:
        raise ModelError(
            f"{label}: free_element_widths = {factors!r}; expected (smallest, largest) factor of each element's "
            "width with 0 < smallest <= 1 <= largest, for example (0.2, 3)."
        )
    first, length = mesh.boundaries[0], mesh.boundaries[-1] - mesh.boundaries[0]
    boundaries = Var(
        RangeSet(0, mesh.elements), bounds=(0, 1),
        initialize={i: (time - first) / length for i, time in enumerate(mesh.boundaries)},
        doc="element boundaries in normalised time",
    )  # fmt: skip
    place(block, "boundary", boundaries)
    if block.record.restating is not None:
        block.record.restating.keep_boundaries()
    block.boundary[0].fix(0.0)
    block.boundary[mesh.elements].fix(1.0)
    widths = dict(enumerate((mesh.widths / length).tolist())) if mesh.elements > 1 else {}
    rows = place(block, "boundary_width", Constraint(list(widths)))
    for i, width in widths.items():
        rows.add(i, (lower * width, block.boundary[i + 1] - block.boundary[i], upper * width))


def with_units(record: PhaseRecord, time: float) -> Any:
    """A time in the units of the phase; the bare number where there are none, which keeps rows cheap."""
    return time if record.time_units is None else time * record.time_units


def element_widths(block: Any) -> list[Any]:
    """Width of each element in real time: numbers, or expressions where something is to be found."""
    boundary = block.boundary if block.record.free_widths else None
    return [element_width(block.record, i, block.duration, boundary) for i in range(block.record.grid.mesh.elements)]


def element_width(record: PhaseRecord, element: int, duration: Any, boundary: Any) -> Any:
    """Width of one element in real time, from the components of the phase that its horizon has."""
    if record.free_widths:
        return duration * (boundary[element + 1] - boundary[element])
    width = float(record.grid.mesh.widths[element])
    return duration * width if record.normalised else with_units(record, width)


def quadrature_weights(block: Any) -> tuple[Any, dict[float, Any]]:
    """A common factor, and the weight of each collocation point, of an integral over real time."""
    record: PhaseRecord = block.record
    grid = record.grid
    scale = block.duration if record.normalised else with_units(record, 1.0)
    if not record.free_widths:
        return scale, grid.quadrature_weights
    weights: dict[float, Any] = {}
    for i, times in enumerate(grid.stage_times):
        width = block.boundary[i + 1] - block.boundary[i]
        for time, factor in zip(times, grid.scheme.b.tolist(), strict=True):
            weights[time] = weights[time] + factor * width if time in weights else factor * width
    return scale, weights


def real_time(block: Any, index: float | TimeIndex) -> Any:
    """The time that an index stands for."""
    record: PhaseRecord = block.record
    t = point_of(index)
    if not record.normalised:
        return with_units(record, t)
    boundaries = record.grid.mesh.boundaries
    if t.__class__ in native_numeric_types and t == boundaries[0]:
        return block.start  # plus nothing: 0 * duration would be a term that some file formats lose
    if not record.free_widths:
        return block.start + block.duration * t
    i = max(bisect_right(boundaries, t) - 1, 0)
    if t == boundaries[i]:
        return block.start + block.duration * block.boundary[i]
    i = min(i, record.grid.mesh.elements - 1)
    local = (t - boundaries[i]) / (boundaries[i + 1] - boundaries[i])
    left, right = block.boundary[i], block.boundary[i + 1]
    return block.start + block.duration * (left + local * (right - left))


def real_grid(block: Any) -> Grid:
    """The grid in real time, at the current values.

    Raises
    ------
    ModelError
        When the duration has no positive value.
    """
    if not block.record.normalised:
        return block.record.grid
    refuse_no_duration(block)
    # What `real_time` gives at boundaries, without an expression for each.
    record: PhaseRecord = block.record
    boundaries = record.grid.mesh.boundaries
    if record.free_widths:
        boundaries = tuple(value(block.boundary[i]) for i in range(len(boundaries)))
    first, duration = float(value(block.start)), float(value(block.duration))
    return Grid(record.grid.scheme, Mesh((first, *(first + duration * tau for tau in boundaries[1:]))))


def refuse_no_duration(block: Any) -> None:
    """Refuse a duration that was given a value in which no motion takes place.

    Raises
    ------
    ModelError
        Naming the phase and the value.
    """
    duration = value(block.duration, exception=False)
    if duration is None or not duration > 0:
        raise ModelError(
            f"phase '{block.name}': its duration has the value {duration}; it must be positive. Give it one by "
            f"{block.name}.duration.set_value(1.0), or fix(1.0)."
        )


def horizon_fraction(phase: Any) -> Callable[[float], float]:
    """A function from time indices to 0 (start) ... 1 (end), also where start, duration or elements may move.

    Raises
    ------
    InitialGuessError
        When it is no `PhaseBlock`.
    ModelError
        When its duration has no positive value.
    """
    if not hasattr(phase, "time_at") or not hasattr(phase, "time"):
        raise InitialGuessError(
            f"'{getattr(phase, 'name', phase)}' is no PhaseBlock; an initial guess along a path needs one."
        )
    real = np.array(real_grid(phase).mesh.boundaries)
    return partial(np.interp, xp=phase.grid.mesh.boundaries, fp=(real - real[0]) / (real[-1] - real[0]))


# Of a duration that follows a Param or an expression: these may have any positive value later.
_LEAST_DURATION = 1e-6


def checked_duration(label: str, start: Any, duration: Any) -> float | Duration:
    """The duration as a number or a declaration; of a variable, a Param or an expression that of what equals it.

    Raises
    ------
    ModelError
        Naming the phase and the value.
    """
    if (
        isinstance(start, bool)
        or (isinstance(start, Real) and not math.isfinite(start))
        or not (isinstance(start, (Real, Start)) or getattr(start, "is_numeric_type", bool)())
    ):
        raise ModelError(
            f"{label}: start = {start!r}; expected a finite number, Start(...), an expression, or the phase before."
        )
    if isinstance(duration, Duration):
        lower, _ = check_bounds(duration.bounds, label, "duration bounds")
        if lower is None or lower <= 0:
            raise ModelError(
                f"{label}: the lower bound of the duration is {lower}; it must be positive. "
                "Give Duration(bounds=(0.1, 10), initial_guess=1)."
            )
    elif getattr(duration, "is_numeric_type", bool)():
        number, lower = value(duration, exception=False), getattr(duration, "lb", 0.0)
        if duration.is_indexed() or (number is not None and not number > 0) or (lower is None or lower < 0):
            raise ModelError(
                f"{label}: the duration '{duration}' has the value {number} and the lower bound {lower}; it must be "
                "one positive number. Give it bounds=(0.1, 10) and initialize=1."
            )
        upper = duration.ub if duration.is_variable_type() else None
        return Duration(bounds=(max(lower or 0.0, _LEAST_DURATION), upper), initial_guess=number)
    elif isinstance(duration, bool) or not isinstance(duration, Real) or not 0 < float(duration) < math.inf:
        raise ModelError(f"{label}: duration = {duration!r}; expected a positive number or Duration(bounds=...).")
    return duration


def make_mesh(first: float, last: float, elements: int | None, mesh: Any) -> Mesh:
    """The mesh that the user's words mean: a number of elements, boundaries, or a mesh.

    Raises
    ------
    ModelError
        When they are no mesh, or not one of this horizon.
    """
    if mesh is None:
        return Mesh.uniform(first, last, 10 if elements is None else elements)
    try:
        made = mesh if isinstance(mesh, Mesh) else Mesh.given(mesh)
    except ModelError:
        raise
    except (TypeError, ValueError) as error:
        raise ModelError(f"mesh = {mesh!r} is no sequence of element boundaries ({error}).") from None
    if elements not in (None, made.elements):
        raise ModelError(f"elements = {elements}, but the given mesh has {made.elements}. Leave 'elements' out.")
    # Both ends may come out of sums: 0.1 + 0.2 is not 0.3. The mesh, as given, is what counts.
    close = 1e-12 * max(abs(first), abs(last))
    if abs(made.boundaries[0] - first) > close or abs(made.boundaries[-1] - last) > close:
        raise ModelError(
            f"the mesh runs from {made.boundaries[0]:g} to {made.boundaries[-1]:g}, the phase from {first:g} to "
            f"{last:g}. A phase with a free start or duration, or with free element widths, takes a mesh from 0 to 1."
        )
    return made
