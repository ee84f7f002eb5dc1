"""Controls and their parametrizations. Whatever a control looks like at a collocation point, no row ties it down.

A piecewise control has few variables, constant or linear between its knots, and is *seen* at each collocation point:
as the very variable, or as an expression in the two of the knots around.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.reference import Reference
from pyomo.core.base.set import RangeSet
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import DeclarationError, TranscriptionError
from pyrobocop_pyomo.transcription import initial_stage_values

from .building import add_generated, add_indexed, rate_units, within
from .declarations import Bounds, Control, check_bounds
from .horizon import real_time
from .nodes import IntervalNodes, KnotNodes, Nodes
from .record import PhaseRecord


def add_control(block: Any, record: PhaseRecord, name: str, control: Control, what: str) -> None:
    """Add the variables of a control, and rows for the bounds on its rate if it has any.

    Raises
    ------
    DeclarationError, InitialGuessError
        When knots, bounds or the initial guess do not fit.
    """
    what = f"{what} (declared at {control.declared_at})"
    nodes = control.nodes(name, record.grid, what)
    if isinstance(nodes, IntervalNodes):
        _add_piecewise_constant(block, record, name, control, nodes, what)
    elif isinstance(nodes, KnotNodes):
        _add_piecewise_linear(block, record, name, control, nodes, what)
    else:
        add_indexed(
            block, name, control, block.points, initial_stage_values(control.initial_guess, record.grid, what), what
        )
    if control.rate_bounds is not None:
        _bound_rate(block, record, name, control, nodes, check_bounds(control.rate_bounds, what, "rate bounds"))


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


def _add_piecewise_constant(
    block: Any, record: PhaseRecord, name: str, control: Control, nodes: IntervalNodes, what: str
) -> None:
    grid = record.grid
    if grid.elements_share_points:
        raise DeclarationError(
            f"{what}: with the scheme {grid.scheme.name} neighbouring elements share a collocation point, where a "
            "piecewise constant control would have two values. Choose 'piecewise_linear' or 'collocated', or a radau "
            "or gauss scheme."
        )
    _refuse_knots_of_its_own(record, nodes, what)
    points = np.array(grid.points)
    bounds = [_common_bounds(control, points[nodes.of_points == i].tolist(), what) for i in range(len(nodes.times))]
    values = _add_values(block, control, nodes, bounds, what)
    seen = {time: values[i] for time, i in zip(grid.points, nodes.of_points.tolist(), strict=True)}
    block.add_component(name, Reference(seen))


def _add_piecewise_linear(
    block: Any, record: PhaseRecord, name: str, control: Control, nodes: KnotNodes, what: str
) -> None:
    _refuse_knots_of_its_own(record, nodes, what)
    values = _add_values(block, control, nodes, [control.bounds_at(knot, what) for knot in nodes.knots], what)
    seen = Expression(block.points)
    block.add_component(name, seen)
    for time in record.grid.points:
        positions, weights = zip(*nodes.weights_at(time), strict=True)
        ends = [values[i] for i in positions]
        seen.add(time, ends[0] if len(ends) == 1 else LinearExpression(linear_vars=ends, linear_coefs=list(weights)))


def _refuse_knots_of_its_own(record: PhaseRecord, nodes: IntervalNodes | KnotNodes, what: str) -> None:
    if record.free_widths and nodes.knots != record.grid.mesh.boundaries:
        raise DeclarationError(f"{what}: knots of its own do not go with free element widths. Leave 'knots' out.")


def _add_values(block: Any, control: Control, nodes: Nodes, bounds: list[Bounds], what: str) -> Any:
    guess = nodes.from_guess(control.initial_guess, what)
    values = {i: within(value, bounds[i]) for i, value in enumerate(guess.tolist())}
    variable = Var(RangeSet(0, len(bounds) - 1), bounds=dict(enumerate(bounds)), initialize=values, units=control.units)
    add_generated(block, nodes.component, variable)
    return variable


def _common_bounds(control: Control, times: list[float], what: str) -> Bounds:
    """What the bounds at several times leave in common: one value has to respect them all."""
    if not callable(control.bounds):
        return control.bounds_at(times[0], what)
    lowers, uppers = zip(*(control.bounds_at(time, what) for time in times), strict=True)
    lower = max((each for each in lowers if each is not None), default=None)
    upper = min((each for each in uppers if each is not None), default=None)
    return check_bounds((lower, upper), what, f"bounds between {times[0]:g} and {times[-1]:g}")


def _steps(block: Any, record: PhaseRecord, nodes: Nodes) -> Iterator[tuple[Any, Any, Any]]:
    """(value before, value after, real time between them) of neighbouring variables."""
    variables, times = nodes.variables(block), [real_time(block, record, time) for time in nodes.times]
    for i in range(len(variables) - 1):
        yield variables[i], variables[i + 1], times[i + 1] - times[i]


def _bound_rate(block: Any, record: PhaseRecord, name: str, control: Control, nodes: Nodes, bounds: Bounds) -> None:
    rows: dict[Any, Any] = {}
    unit = rate_units(control.units, record.time_units)
    if unit is not None:
        bounds = tuple(None if bound is None else bound * unit for bound in bounds)  # type: ignore[assignment]
    for i, (before, after, time) in enumerate(_steps(block, record, nodes)):
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
        nodes = record.nodes(name)
        slopes = [(after - before) / time for before, after, time in _steps(block, record, nodes)] or [0.0]
        seen = np.clip(nodes.steps_at_points, 0, len(slopes) - 1).tolist()
        record.control_rates[name] = {time: slopes[i] for time, i in zip(record.grid.points, seen, strict=True)}
    return record.control_rates[name]
