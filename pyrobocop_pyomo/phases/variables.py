"""From declarations to Pyomo variables. Whatever a control looks like at a collocation point, no row ties it down.

A piecewise control has few variables, constant or linear between its knots, and is *seen* at each collocation point:
as the very variable, or as an expression in the two of the knots around.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.set import RangeSet
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import NumericValue, native_numeric_types

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.transcription import continuity_rows, initial_number, initial_stage_values, initial_state_values

from .declarations import Algebraic, Bounds, Control, Declaration, Parameter, State, check_bounds, within
from .horizon import real_time
from .nodes import IntervalNodes, KnotNodes, Nodes
from .record import PhaseRecord, add_generated, place
from .signal_vars import SignalExpression, SignalVar, signal_reference
from .stated_numbers import add_row_of_end


def add_variables(block: Any, name: str, declaration: Declaration) -> None:
    """Add the variables of one declaration to a phase block.

    Raises
    ------
    ModelError, InitialGuessError
        When bounds, boundary values or the initial guess do not fit.
    """
    what = f"phase '{block.name}': {type(declaration).__name__.lower()} '{name}'"
    if isinstance(declaration, State):
        _add_state(block, name, declaration, what)
    elif isinstance(declaration, Control):
        add_control(block, name, declaration, what)
    elif isinstance(declaration, Algebraic):
        add_indexed(
            block,
            name,
            declaration,
            block.points,
            initial_stage_values(declaration.initial_guess, block.record.grid, what),
            what,
        )
    elif isinstance(declaration, Parameter):
        if block.record.restating is not None:
            return  # it has nothing to do with the mesh
        bounds = declaration.bounds_at(block.record.grid.times[0], what)
        guess = initial_number(declaration.initial_guess, what)
        block.add_component(name, Var(bounds=bounds, initialize=within(guess, bounds), units=declaration.units))
    else:
        raise ModelError(f"{what}: a {type(declaration).__name__} cannot be declared on a phase.")


def _add_state(block: Any, name: str, state: State, label: str) -> None:
    grid = block.record.grid
    add_indexed(block, name, state, block.time, initial_state_values(state.initial_guess, grid, label), label)
    variable = block.component(name)
    ends = ((state.initial, grid.times[0], "initial"), (state.final, grid.times[-1], "final"))
    for given, time, where in () if block.record.restating is not None else ends:  # both ends stand as they are
        if isinstance(given, NumericValue):
            add_row_of_end(block, name, variable[time], given, where)
        else:
            _impose_boundary_value(variable[time], given, f"{label} (declared at {state.declared_at})", where)
    if state.initial_guess is None and block.record.restating is None:
        _stay_at_stated_end(variable, state, grid.times)
    rows = dict(continuity_rows(variable, grid))
    if rows:
        continuity = add_generated(block, f"{name}_continuity", Constraint(list(rows)))
        block.record.generated_rows.add(f"{name}_continuity")
        for time, row in rows.items():
            continuity.add(time, row)


def _stay_at_stated_end(variable: Any, state: State, times: Sequence[float]) -> None:
    """Give a state the value that it starts with at all times, or the one that it ends with; nothing without either."""
    ends = {times[0]: state.initial, times[-1]: state.final}
    stated = [time for time, end in ends.items() if variable[time].fixed or isinstance(end, NumericValue)]
    for time, data in variable.items() if stated else ():
        if time not in stated:
            data.set_value(within(variable[stated[0]].value, data.bounds), skip_validation=True)


def _impose_boundary_value(variable: Any, given: float | Bounds | None, label: str, where: str) -> None:
    if given is None:
        return
    if isinstance(given, tuple):
        lower, upper = check_bounds(given, label, f"{where} bounds")
        tightest_lower = max((b for b in (lower, variable.lb) if b is not None), default=None)
        tightest_upper = min((b for b in (upper, variable.ub) if b is not None), default=None)
        if tightest_lower is not None and tightest_upper is not None and tightest_lower > tightest_upper:
            raise ModelError(
                f"{label}: its {where} bounds {given} leave nothing of its bounds ({variable.lb}, {variable.ub})."
            )
        variable.setlb(tightest_lower)
        variable.setub(tightest_upper)
        variable.set_value(within(variable.value, (tightest_lower, tightest_upper)))
        return
    if not isinstance(given, Real) or not math.isfinite(given):
        raise ModelError(
            f"{label}: its {where} value is {given!r}; expected a finite number, a Param or an expression, a tuple "
            "(lower, upper), or None."
        )
    value = float(given)
    outside = (variable.lb is not None and value < variable.lb) or (variable.ub is not None and value > variable.ub)
    if outside:
        raise ModelError(
            f"{label}: its {where} value {value:g} lies outside its bounds ({variable.lb}, {variable.ub}). "
            "Widen the bounds or change the value."
        )
    variable.fix(value)


def add_indexed(block: Any, name: str, declaration: Declaration, index: Any, guess: Any, label: str) -> None:
    """Add a variable over times, with its bounds and its initial guess moved onto them."""
    if callable(declaration.bounds):
        each_bounds = [declaration.bounds_at(time, label) for time in index]
        variable = SignalVar(index, bounds=dict(zip(index, each_bounds, strict=True)), units=declaration.units)
    else:
        each_bounds = [declaration.bounds_at(0.0, label)] * len(index)
        variable = SignalVar(index, bounds=each_bounds[0], units=declaration.units)
    variable = place(block, name, variable)
    # Values given one by one: a dict passed to Var(initialize=...) takes six times as long.
    for data, value, bounds in zip(variable.values(), guess.tolist(), each_bounds, strict=True):
        data.set_value(within(value, bounds), skip_validation=True)
    if block.record.restating is not None:
        block.record.restating.keep(name)


def rate_units(units: Any, time_units: Any) -> Any:
    """Units of a derivative, None where there are none at all."""
    if units is None:
        return None if time_units is None else 1 / time_units
    return units if time_units is None else units / time_units


def add_control(block: Any, name: str, control: Control, label: str) -> None:
    """Add the variables of a control, and rows for the bounds on its rate if it has any.

    Raises
    ------
    ModelError, InitialGuessError
        When knots, bounds or the initial guess do not fit.
    """
    label = f"{label} (declared at {control.declared_at})"
    nodes = control.nodes(name, block.record.grid, label)
    if isinstance(nodes, IntervalNodes):
        _add_piecewise_constant(block, name, control, nodes, label)
    elif isinstance(nodes, KnotNodes):
        _add_piecewise_linear(block, name, control, nodes, label)
    else:
        guess = initial_stage_values(control.initial_guess, block.record.grid, label)
        add_indexed(block, name, control, block.points, guess, label)
    if control.rate_bounds is not None:
        _bound_rate(block, name, control, nodes, check_bounds(control.rate_bounds, label, "rate bounds"))


def refuse_weightless_controls(block: Any) -> None:
    """A control at a stage with quadrature weight zero moves the state at no cost: the optimum would be nonsense.

    Hager, Runge-Kutta methods in optimal control and the transformed adjoint system, sec. 4,
    doi:10.1007/s002110000178. A simulation may have such controls, hence this is checked before a solve only.

    Raises
    ------
    ModelError
        Naming the control and the stage.
    """
    scheme = block.record.grid.scheme
    if not (abs(scheme.b) < 1e-14).any():
        return
    for name in block.record.names(Control):
        control = block.record.declarations[name]
        assert isinstance(control, Control)
        if control.parametrization == "collocated" and not all(data.fixed for data in block.component(name).values()):
            raise ModelError(
                f"phase '{block.name}': control '{name}' (declared at {control.declared_at}): with the scheme "
                f"{scheme.name} the stage at c = {scheme.c[abs(scheme.b).argmin()]:g} has weight 0 in every integral, "
                "so a control of its own there would cost nothing. Choose 'piecewise_constant'."
            )


def _add_piecewise_constant(block: Any, name: str, control: Control, nodes: IntervalNodes, label: str) -> None:
    grid = block.record.grid
    if grid.elements_share_points:
        raise ModelError(
            f"{label}: with the scheme {grid.scheme.name} neighbouring elements share a collocation point, where a "
            "piecewise constant control would have two values. Choose 'piecewise_linear' or 'collocated', or a radau "
            "or gauss scheme."
        )
    _refuse_knots_of_its_own(block.record, nodes, label)
    points = np.array(grid.points)
    bounds = [_common_bounds(control, points[nodes.of_points == i].tolist(), label) for i in range(len(nodes.times))]
    values = _add_values(block, name, control, nodes, bounds, label)
    seen = {time: values[i] for time, i in zip(grid.points, nodes.of_points.tolist(), strict=True)}
    place(block, name, signal_reference(seen))


def _add_piecewise_linear(block: Any, name: str, control: Control, nodes: KnotNodes, label: str) -> None:
    _refuse_knots_of_its_own(block.record, nodes, label)
    bounds = [control.bounds_at(knot, label) for knot in nodes.knots]
    values = _add_values(block, name, control, nodes, bounds, label)
    seen = place(block, name, SignalExpression(block.points))
    for time in block.record.grid.points:
        positions, weights = zip(*nodes.weights_at(time), strict=True)
        ends = [values[i] for i in positions]
        seen.add(time, ends[0] if len(ends) == 1 else LinearExpression(linear_vars=ends, linear_coefs=list(weights)))
    if block.record.restating is not None:
        block.record.restating.keep_expressions(name)


def _refuse_knots_of_its_own(record: PhaseRecord, nodes: IntervalNodes | KnotNodes, label: str) -> None:
    if record.free_widths and nodes.knots != record.grid.mesh.boundaries:
        raise ModelError(f"{label}: knots of its own do not go with free element widths. Leave 'knots' out.")


def _add_values(block: Any, name: str, control: Control, nodes: Nodes, bounds: list[Bounds], label: str) -> Any:
    guess = nodes.from_guess(control.initial_guess, label)
    values = {i: within(value, bounds[i]) for i, value in enumerate(guess.tolist())}
    variable = Var(RangeSet(0, len(bounds) - 1), bounds=dict(enumerate(bounds)), initialize=values, units=control.units)
    variable = add_generated(block, nodes.component, variable)
    if block.record.restating is not None:
        block.record.restating.keep(name)
    return variable


def _common_bounds(control: Control, times: list[float], label: str) -> Bounds:
    """What the bounds at several times leave in common: one value has to respect them all."""
    if not callable(control.bounds):
        return control.bounds_at(times[0], label)
    lowers, uppers = zip(*(control.bounds_at(time, label) for time in times), strict=True)
    lower = max((bound for bound in lowers if bound is not None), default=None)
    upper = min((bound for bound in uppers if bound is not None), default=None)
    return check_bounds((lower, upper), label, f"bounds between {times[0]:g} and {times[-1]:g}")


def _steps(block: Any, nodes: Nodes) -> Iterator[tuple[Any, Any, Any]]:
    """(value before, value after, real time between them) of neighbouring variables."""
    variables, times = nodes.variables(block), [real_time(block, time) for time in nodes.times]
    for i in range(len(variables) - 1):
        yield variables[i], variables[i + 1], times[i + 1] - times[i]


def _bound_rate(block: Any, name: str, control: Control, nodes: Nodes, bounds: Bounds) -> None:
    rows: dict[Any, Any] = {}
    unit = rate_units(control.units, block.record.time_units)
    if unit is not None:
        bounds = tuple(None if bound is None else bound * unit for bound in bounds)  # type: ignore[assignment]
    for i, (before, after, time) in enumerate(_steps(block, nodes)):
        change = after - before
        if time.__class__ in native_numeric_types:
            lower, upper = (None if bound is None else bound * time for bound in bounds)
            rows[i] = (lower, change, upper)
            continue
        if bounds[0] is not None:
            rows[i, "lower"] = (0, change - bounds[0] * time, None)
        if bounds[1] is not None:
            rows[i, "upper"] = (None, change - bounds[1] * time, 0)
    component = add_generated(block, f"{name}_rate", Constraint(list(rows)))
    block.record.generated_rows.add(f"{name}_rate")
    for index, row in rows.items():
        component.add(index, row)


def control_rate(block: Any, name: str) -> Mapping[float, Any]:
    """Rate of change of a control, seen at each collocation point; see `PhaseBlock.rate_of`."""
    record: PhaseRecord = block.record
    if name not in record.control_rates:
        nodes = record.nodes(name)
        slopes = [(after - before) / time for before, after, time in _steps(block, nodes)] or [0.0]
        seen = np.clip(nodes.steps_at_points, 0, len(slopes) - 1).tolist()
        record.control_rates[name] = {time: slopes[i] for time, i in zip(record.grid.points, seen, strict=True)}
    return record.control_rates[name]
