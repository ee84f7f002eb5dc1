"""From declarations to Pyomo variables. Whatever a control looks like at a collocation point, no row ties it down.

A piecewise control has few variables, constant or linear between its knots, and is *seen* at each collocation point:
as the very variable, or as an expression in the two of the knots around.

Variables over the time of a phase, which can be asked for their values at other times than those of the grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import IndexedExpression
from pyomo.core.base.reference import Reference
from pyomo.core.base.var import IndexedVar, Var
from pyomo.core.expr.numvalue import NumericValue, native_numeric_types, value

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.pyomo_internals import new_row
from pyrobocop_pyomo.modeling.time_index import point_of
from pyrobocop_pyomo.modeling.variable_values import within, within_bounds
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.presentation import one_line
from pyrobocop_pyomo.templates.slots import Item
from pyrobocop_pyomo.templates.template import Reading, TimeTemplate
from pyrobocop_pyomo.transcription import continuity_row

from .declarations import Bounds, Control, Declaration, Parameter, State, check_bounds
from .delays import delayed_value, value_at, value_at_time
from .horizon import real_time
from .nodes import IntervalNodes, KnotNodes, Nodes, initial_number
from .record import PhaseRecord, add_generated, place
from .stated_numbers import add_row_of_end, rate_units

# -------------------------------------------------------------------------------------------------- variables over time


class NoSuchTime(KeyError):
    """A variable over time was asked for its value at an index that it has not."""

    def __str__(self) -> str:
        return str(self.args[0])  # and not its repr, as of other keys


class _OverTime:
    """What states, algebraics and controls have beside what Pyomo gives them."""

    def _validate_index(self: Any, idx: Any) -> Any:
        try:
            return super()._validate_index(idx)  # type: ignore[misc]
        except KeyError:
            index = point_of(idx)
            for time in self if isinstance(index, (int, float)) else ():
                # Eight elements of a tenth may end beside 0.8.
                if isinstance(time, float) and math.isclose(time, index, rel_tol=ROUNDING):
                    return time
            raise NoSuchTime(_no_such_time(self, index)) from None

    def __getitem__(self: Any, index: Any) -> Any:
        if index.__class__ is TimeTemplate:
            return Reading(Item(self, (None,)))
        return super().__getitem__(index)  # type: ignore[misc]

    # An array leaves `array * variable` to the operators below.
    __array_ufunc__ = None

    def __getattr__(self: Any, name: str) -> Any:
        if name in _OTHER_WORDS:
            short = self.local_name
            instead = _OTHER_WORDS[name].format(name=f"b.{short}", short=short)
            raise AttributeError(f"'{self.name}', a variable over time, has no '{name}'. Write {instead}.")
        return super().__getattribute__(name)

    def __repr__(self: Any) -> str:
        values = [number for part in self.values() if (number := value(part, exception=False)) is not None]
        found = f"{min(values):.6g} .. {max(values):.6g}" if values else "no values yet"
        return one_line(type(self).__name__, f"'{self.name}' at {len(self)} times, {found}")

    def __setattr__(self: Any, name: str, value: Any) -> None:
        if name in _REFUSED:
            raise AttributeError(
                f"'{self.name}', a variable over time, has no '{name}' to set. Say it where it is declared, as in "
                f"rcp.State(initial=..., final=..., bounds=..., initial_guess=...); at one time, "
                f"b.{self.local_name}[t].set_value(...), .fix(...) or .setlb(...)."
            )
        super().__setattr__(name, value)

    def delayed(self: Any, t: float, delay: Any) -> Any:
        """Its value a while ago: that of the collocation polynomial at ``t - delay``.

        Parameters
        ----------
        t : float
            The time index that a rule is evaluated at.
        delay : number or Param
            In real time, 0 or more; a Param counts with the value that it has when the rule is evaluated.

        Returns
        -------
        variable, expression or number
            Before the phase starts, what the declaration gives as ``history``.

        Raises
        ------
        ModelError
            When it reaches before the start and there is no history; when the duration or the element boundaries are to
            be found, so that the element of ``t - delay`` is not known.

        References
        ----------
        Bellen & Zennaro, Numerical Methods for Delay Differential Equations (2003), ch. 5,
        doi:10.1093/acprof:oso/9780198506546.001.0001
        """
        block = self.parent_block()
        return delayed_value(block, self.local_name, t, delay)

    def at(self: Any, time: float) -> Any:
        """Its value at a fixed time index: that of the collocation polynomial, for constraints and objectives.

        It follows the phase onto another mesh.

        Parameters
        ----------
        time : float
            A time index; at an element boundary the element that ends there answers, at the start the first.

        Raises
        ------
        ModelError
            When the phase does not reach so far.
        """
        block = self.parent_block()
        return value_at_time(block, self.local_name, time)

    @property
    def at_start(self: Any) -> Any:
        """Its value at the start of the phase; extrapolated, where the scheme has no point there."""
        return self.at(self.parent_block().initial_time)

    @property
    def at_end(self: Any) -> Any:
        """Its value at the end of the phase; extrapolated, where the scheme has no point there."""
        return self.at(self.parent_block().final_time)


# What other packages call a part of a variable over time -> what to write instead; "{name}" is the variable.
_OTHER_WORDS = {
    "value": "its values: phase.trajectory().{short} as an array, pyo.value({name}.at(time)) at one time",
    "dot": "its derivative: in an ode, return {{{name}: ...}}; elsewhere phase.derivative({name})[t]",
    "final": "{name}.at_end",
    "initial": "{name}.at_start",
    "lb": "bounds: rcp.State(bounds=(lower, upper)), or {name}[t].setlb(lower) at one point",
    "bounds": "bounds: rcp.State(bounds=(lower, upper)), or {name}[t].setlb(lower) at one point",
    "plot": "a picture: phase.trajectory().plot(['{short}'])",
}
_OTHER_WORDS |= {"val": _OTHER_WORDS["value"], "sol": _OTHER_WORDS["value"], "ub": _OTHER_WORDS["lb"]}
_OTHER_WORDS |= dict.fromkeys(("derivative", "diff", "der", "ddt", "d"), _OTHER_WORDS["dot"])
_OTHER_WORDS |= dict.fromkeys(("end", "last", "tf", "xf"), _OTHER_WORDS["final"])
_OTHER_WORDS |= dict.fromkeys(("start", "first", "t0", "x0"), _OTHER_WORDS["initial"])

_REFUSED = frozenset({"value", "initial", "final", "lb", "ub"})

_OPERATORS = ("add", "sub", "mul", "truediv", "pow", "matmul")


def _refuse_as_number(self: Any, *_: Any) -> Any:
    """Raise for an operator that was given a variable over time as a whole."""
    name = f"b.{self.local_name}"
    raise TypeError(
        f"'{self.name}' is a variable at all times (SignalVar), and was used as one number. In a rule write {name}[t]; "
        f"for a sum over time b.integral(lambda b, t: {name}[t] ** 2); for one time {name}.at(time), {name}.at_start "
        f"or {name}.at_end."
    )


for _operator in _OPERATORS:
    for _name in (f"__{_operator}__", f"__r{_operator}__"):
        setattr(_OverTime, _name, _refuse_as_number)
for _name in ("neg", "abs", "lt", "le", "gt", "ge", "float"):
    setattr(_OverTime, f"__{_name}__", _refuse_as_number)


def _no_such_time(signal: Any, index: Any) -> str:
    """What to do where a variable is read at a time at which it has none of its own."""
    times, name, asked = list(signal), f"b.{signal.local_name}", index
    if isinstance(index, (int, float)):
        asked = f"{index:g}"
        times.sort(key=lambda time: abs(time - index))
    near = ", ".join(f"{time:g}" for time in sorted(times[:2]))
    return (
        f"'{signal.name}' has no value of its own at {index!r}: it lives at {len(times)} times, the nearest are {near}."
        f" Write {name}.at({asked}) for its value there, {name}.delayed(t, delay) for that of a while ago, "
        f"{name}.at_start and {name}.at_end at the ends, and b.integral(lambda b, t: ...) for a sum over time."
    )


class SignalVar(_OverTime, IndexedVar):
    """A state, algebraic or control over time."""


class SignalExpression(_OverTime, IndexedExpression):
    """A control that is linear between knots, as seen at the collocation points."""


def signal_reference(variables: dict[float, Any]) -> Any:
    """A control that has fewer values than there are collocation points, as seen at these."""
    plain = Reference(variables)
    found = SignalVar(plain.index_set())
    found._constructed, found._data, found.referent = True, plain._data, plain.referent
    return found


# ------------------------------------------------------------------------------------------------------------ variables


def add_variables(block: Any, name: str, declaration: Declaration) -> None:
    """Add the variables of one declaration to a phase block.

    Raises
    ------
    ModelError, InitialGuessError
        When bounds, boundary values, knots or the initial guess do not fit.
    """
    record: PhaseRecord = block.record
    label = f"phase '{block.name}': {type(declaration).__name__.lower()} '{name}'"
    if isinstance(declaration, Parameter):
        if record.restating is None:  # it has nothing to do with the mesh
            bounds = declaration.bounds_at(record.grid.times[0], label)
            guess = initial_number(declaration.initial_guess, label)
            block.add_component(name, Var(bounds=bounds, initialize=within(guess, bounds), units=declaration.units))
        return
    label = f"{label} (declared at {declaration.declared_at})"
    nodes = declaration.nodes(name, record.grid, label)
    values = add_values(block, name, declaration, nodes, label)
    if isinstance(nodes, (IntervalNodes, KnotNodes)):
        _show_at_points(block, name, nodes, values, label)
    if isinstance(declaration, State):
        _add_ends(block, name, declaration, values, label)
    if isinstance(declaration, Control) and declaration.rate_bounds is not None:
        _bound_rate(block, name, declaration, nodes, check_bounds(declaration.rate_bounds, label, "rate bounds"))


def add_values(block: Any, name: str, declaration: Declaration, nodes: Nodes, label: str) -> Any:
    """Add the variables behind a name, with their bounds, and with their initial guess moved onto these."""
    guess = nodes.from_guess(declaration.initial_guess, label)
    bounds = declaration.bounds_at(0.0, label)
    kind = SignalVar if nodes.component == name else Var
    variable = add_generated(block, nodes.component, kind(nodes.index_set(block), units=declaration.units))
    # Given one by one: a dict passed to Var(...) takes six times as long.
    for data, number in zip(variable.values(), guess.tolist(), strict=True):
        data.setlb(bounds[0])
        data.setub(bounds[1])
        data.set_value(within(number, bounds), skip_validation=True)
    if block.record.restating is not None:
        block.record.restating.keep(name, nodes, bounds)
    return variable


def _show_at_points(block: Any, name: str, nodes: IntervalNodes | KnotNodes, values: Any, label: str) -> None:
    """Let a piecewise control be seen at each collocation point: as the very variable, or between two knots."""
    grid: Grid = block.record.grid
    if isinstance(nodes, IntervalNodes) and grid.elements_share_points:
        raise ModelError(
            f"{label}: with the scheme {grid.scheme.name} neighbouring elements share a collocation point, where a "
            "piecewise constant control would have two values. Choose 'piecewise_linear' or 'collocated', or a radau "
            "or gauss scheme."
        )
    if block.record.free_widths and nodes.knots != grid.mesh.boundaries:
        raise ModelError(f"{label}: knots of its own do not go with free element widths. Leave 'knots' out.")
    if isinstance(nodes, IntervalNodes):
        seen = [values[i] for i in nodes.of_points.tolist()]
        place(block, name, signal_reference(dict(zip(grid.points, seen, strict=True))))
        return
    between = {time: value_at(block, nodes, time, after=False) for time in grid.points}
    place(block, name, SignalExpression(block.points, initialize=between))


def _add_ends(block: Any, name: str, state: State, variable: Any, label: str) -> None:
    """Let a state have its values at the ends, and go on from element to element."""
    grid = block.record.grid
    if block.record.restating is None:  # otherwise both ends stand as they are
        for given, time, where in ((state.initial, grid.times[0], "initial"), (state.final, grid.times[-1], "final")):
            if isinstance(given, NumericValue):
                add_row_of_end(block, name, variable[time], given, where)
            else:
                _impose_boundary_value(variable[time], given, label, where)
        if state.initial_guess is None:
            _stay_at_stated_end(variable, state, grid.times)
    if not grid.scheme.end_is_a_node:
        rows = {end: continuity_row(variable, grid, i) for i, end in enumerate(grid.mesh.boundaries[1:])}
        add_generated_rows(block, f"{name}_continuity", list(rows), rows.items())


def add_generated_rows(block: Any, name: str, indices: Any, rows: Iterable[tuple[Any, Any]] = ()) -> Any:
    """Add rows that follow from what is declared or given for a state or a control: no equations of the user's."""
    block.record.generated_rows.add(name)
    component = add_generated(block, name, Constraint(indices))
    for index, row in rows:
        new_row(component, index, row)
    return component


def _stay_at_stated_end(variable: Any, state: State, times: Sequence[float]) -> None:
    """Give a state the value that it starts with at all times, or the one that it ends with; nothing without either."""
    ends = {times[0]: state.initial, times[-1]: state.final}
    stated = [time for time, end in ends.items() if variable[time].fixed or isinstance(end, NumericValue)]
    for time, data in variable.items() if stated else ():
        if time not in stated:
            data.set_value(within_bounds(variable[stated[0]].value, data), skip_validation=True)


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
    add_generated_rows(block, f"{name}_rate", list(rows), rows.items())


def control_rate(block: Any, name: str) -> Mapping[float, Any]:
    """Rate of change of a control, seen at each collocation point; see `PhaseBlock.rate_of`."""
    record: PhaseRecord = block.record
    if name not in record.control_rates:
        nodes = record.nodes(name)
        slopes = [(after - before) / time for before, after, time in _steps(block, nodes)] or [0.0]
        seen = np.clip(nodes.steps_at_points, 0, len(slopes) - 1).tolist()
        record.control_rates[name] = {time: slopes[i] for time, i in zip(record.grid.points, seen, strict=True)}
    return record.control_rates[name]
