"""Controls and their parametrizations. Whatever a control looks like at a collocation point, no row ties it down.

A piecewise control has few variables, held or linear between its knots, and is *seen* at each collocation point: as
the very variable, or as an expression in the two of the knots around.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.reference import Reference
from pyomo.core.base.set import RangeSet
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import DeclarationError, TranscriptionError
from pyrobocop_pyomo.transcription import guess_at, stage_guess

from .building import add_generated, add_indexed, rate_units, within
from .declarations import Bounds, Control, check_bounds
from .horizon import real_time
from .record import PhaseRecord


def add_control(block: Any, record: PhaseRecord, name: str, control: Control, what: str) -> None:
    """Add the variables of a control, and rows for the bounds on its rate if it has any.

    Raises
    ------
    DeclarationError, GuessError
        When knots, bounds or the guess do not fit.
    """
    what = f"{what} (declared at {control.declared_at})"
    if control.parametrization == "collocated":
        add_indexed(block, name, control, block.points, stage_guess(control.guess, record.grid, what), what)
    elif control.parametrization == "piecewise_constant":
        _add_held(block, record, name, control, what)
    else:
        _add_linear(block, record, name, control, what)
    if control.rate_bounds is not None:
        _bound_rate(block, record, name, control, check_bounds(control.rate_bounds, what, "rate bounds"))


def refuse_weightless_controls(block: Any, record: PhaseRecord) -> None:
    """A control at a stage with quadrature weight zero moves the state at no cost: the optimum would be nonsense.

    Hager, Runge-Kutta methods in optimal control and the transformed adjoint system, sec. 4,
    doi:10.1007/s002110000178. A simulation may have such controls, hence this is asked before a solve only.

    Raises
    ------
    TranscriptionError
        Naming the control and the stage.
    """
    scheme = record.grid.scheme
    if not (abs(scheme.b) < 1e-14).any():
        return
    for name in record.names(Control):
        control = record.declarations[name]
        assert isinstance(control, Control)
        if control.parametrization == "collocated" and not all(data.fixed for data in block.component(name).values()):
            raise TranscriptionError(
                f"phase '{block.name}': control '{name}' (declared at {control.declared_at}): with the scheme "
                f"{scheme.name} the stage at c = {scheme.c[abs(scheme.b).argmin()]:g} has weight 0 in every integral, "
                "so a control of its own there would cost nothing. Choose 'piecewise_constant'."
            )


def variables_name(name: str, control: Control) -> str:
    """Name of the component that holds the variables of a control."""
    suffix = {"collocated": "", "piecewise_linear": "_at_knots"}.get(control.parametrization)
    if suffix is None:
        suffix = "_per_element" if control.knots is None else "_per_interval"
    return name + suffix


def knots_of(record: PhaseRecord, control: Control, what: str) -> tuple[float, ...]:
    """The knots of a piecewise control: element boundaries, all of them or those that the user chose.

    Raises
    ------
    DeclarationError
        When a knot is no element boundary, or the ends are missing.
    """
    boundaries = record.grid.mesh.boundaries
    if control.knots is None:
        return boundaries
    slack = 1e-9 * (boundaries[-1] - boundaries[0])
    found = []
    for knot in control.knots:
        nearest = min(boundaries, key=lambda boundary: abs(boundary - knot))
        if abs(nearest - knot) > slack:
            raise DeclarationError(
                f"{what}: knot {knot:g} is no element boundary; the nearest is {nearest:g}. The mesh is too coarse for "
                "it: give mesh= with this boundary, or move the knot."
            )
        found.append(nearest)
    if (found[:1], found[-1:]) != ([boundaries[0]], [boundaries[-1]]) or any(a >= b for a, b in pairwise(found)):
        raise DeclarationError(
            f"{what}: knots {control.knots} must increase from {boundaries[0]:g} to {boundaries[-1]:g}, both included."
        )
    if record.moving and tuple(found) != boundaries:
        raise DeclarationError(f"{what}: knots of its own do not go with moving elements. Leave 'knots' out.")
    return tuple(found)


def _add_held(block: Any, record: PhaseRecord, name: str, control: Control, what: str) -> None:
    grid = record.grid
    if grid.elements_share_points:
        raise DeclarationError(
            f"{what}: with the scheme {grid.scheme.name} neighbouring elements share a collocation point, where a "
            "piecewise constant control would have two values. Choose 'piecewise_linear' or 'collocated', or a radau "
            "or gauss scheme."
        )
    knots = knots_of(record, control, what)
    interval_of = {
        time: bisect_left(knots, grid.mesh.boundaries[element + 1]) - 1 for time, element in grid.element_of.items()
    }
    times_of: list[list[float]] = [[] for _ in knots[1:]]
    for time, interval in interval_of.items():
        times_of[interval].append(time)
    bounds = [_common_bounds(control, times, what) for times in times_of]
    middles = [(a + b) / 2 for a, b in pairwise(knots)]
    held = _add_values(
        block, name, control, middles, bounds, what, "elements" if control.knots is None else "intervals"
    )
    block.add_component(name, Reference({time: held[interval] for time, interval in interval_of.items()}))


def _add_linear(block: Any, record: PhaseRecord, name: str, control: Control, what: str) -> None:
    knots = knots_of(record, control, what)
    bounds = [control.bounds_at(knot, what) for knot in knots]
    values = _add_values(block, name, control, knots, bounds, what, "knots")
    seen = Expression(block.points)
    block.add_component(name, seen)
    for time in record.grid.points:
        i = max(bisect_left(knots, time) - 1, 0)
        share = (time - knots[i]) / (knots[i + 1] - knots[i])
        ends = [values[i], values[i + 1]]
        seen.add(time, ends[int(share)] if share in (0.0, 1.0) else LinearExpression(
            linear_vars=ends, linear_coefs=[1.0 - share, share]
        ))  # fmt: skip


def _add_values(block: Any, name: str, control: Control, times: Any, bounds: list[Bounds], what: str, kind: str) -> Any:
    guess = guess_at(control.guess, tuple(times), what, f"{len(bounds)} {kind}")
    values = {i: within(value, bounds[i]) for i, value in enumerate(guess.tolist())}
    variable = Var(RangeSet(0, len(bounds) - 1), bounds=dict(enumerate(bounds)), initialize=values, units=control.units)
    add_generated(block, variables_name(name, control), variable)
    return variable


def _common_bounds(control: Control, times: list[float], what: str) -> Bounds:
    """What the bounds at several times leave in common: one value has to respect them all."""
    if not callable(control.bounds):
        return control.bounds_at(times[0], what)
    lowers, uppers = zip(*(control.bounds_at(time, what) for time in times), strict=True)
    lower = max((each for each in lowers if each is not None), default=None)
    upper = min((each for each in uppers if each is not None), default=None)
    return check_bounds((lower, upper), what, f"bounds between {times[0]:g} and {times[-1]:g}")


def _steps(block: Any, record: PhaseRecord, name: str, control: Control) -> Iterator[tuple[Any, Any, Any]]:
    """(value before, value after, real time between them) of neighbouring variables."""
    if control.parametrization == "collocated":
        times: Any = record.grid.points
        variables = [block.component(name)[time] for time in times]
    else:
        knots = knots_of(record, control, f"'{block.name}.{name}'")
        held = control.parametrization == "piecewise_constant"
        times = [(a + b) / 2 for a, b in pairwise(knots)] if held else knots
        variables = list(block.component(variables_name(name, control)).values())
    clocks = [real_time(block, record, time) for time in times]
    for i in range(len(variables) - 1):
        yield variables[i], variables[i + 1], clocks[i + 1] - clocks[i]


def _bound_rate(block: Any, record: PhaseRecord, name: str, control: Control, bounds: Bounds) -> None:
    rows: dict[Any, Any] = {}
    unit = rate_units(control.units, record.time_units)
    if unit is not None:
        bounds = tuple(None if bound is None else bound * unit for bound in bounds)  # type: ignore[assignment]
    for i, (before, after, time) in enumerate(_steps(block, record, name, control)):
        change = after - before
        if time.__class__ in native_numeric_types:
            lower, upper = (None if bound is None else bound * time for bound in bounds)
            rows[i] = (lower, change, upper)
            continue
        if bounds[0] is not None:
            rows[i, "lower"] = (0, change - bounds[0] * time, None)
        if bounds[1] is not None:
            rows[i, "upper"] = (None, change - bounds[1] * time, 0)
    component = Constraint(list(rows))
    add_generated(block, f"{name}_rate", component)
    record.generated_rows.add(f"{name}_rate")
    for index, row in rows.items():
        component.add(index, row)


def control_rate(block: Any, record: PhaseRecord, name: str) -> Mapping[float, Any]:
    """Rate of change of a control, seen at each collocation point; see `PhaseBlock.rate_of`."""
    if name not in record.control_rates:
        control = record.declarations[name]
        assert isinstance(control, Control)
        slopes = [(after - before) / time for before, after, time in _steps(block, record, name, control)] or [0.0]
        record.control_rates[name] = {time: slopes[i] for time, i in _step_seen_at(record, control, len(slopes))}
    return record.control_rates[name]


def _step_seen_at(record: PhaseRecord, control: Control, steps: int) -> Iterator[tuple[float, int]]:
    """Which step is the rate at a point: of a linear control the one going on there, else the one that led there."""
    grid = record.grid
    if control.parametrization == "collocated":
        yield from ((time, min(max(i - 1, 0), steps - 1)) for i, time in enumerate(grid.points))
        return
    knots = knots_of(record, control, "control")
    led = 1 if control.parametrization == "piecewise_constant" else 0
    for time, element in grid.element_of.items():
        interval = bisect_left(knots, grid.mesh.boundaries[element + 1]) - 1
        yield time, min(max(interval - led, 0), steps - 1)
