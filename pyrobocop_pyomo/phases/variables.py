"""From declarations to Pyomo variables."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.transcription import continuity_rows, initial_number, initial_stage_values, initial_state_values

from .building import add_generated, add_indexed, within
from .controls import add_control
from .declarations import Algebraic, Bounds, Control, Declaration, Parameter, State, check_bounds
from .record import PhaseRecord


def add_variables(block: Any, record: PhaseRecord, name: str, declaration: Declaration) -> None:
    """Add the variables of one declaration to a phase block.

    Raises
    ------
    DeclarationError, InitialGuessError
        When bounds, boundary values or the initial guess do not fit.
    """
    what = f"phase '{block.name}': {type(declaration).__name__.lower()} '{name}'"
    if isinstance(declaration, State):
        _add_state(block, record, name, declaration, what)
    elif isinstance(declaration, Control):
        add_control(block, record, name, declaration, what)
    elif isinstance(declaration, Algebraic):
        add_indexed(
            block,
            name,
            declaration,
            block.points,
            initial_stage_values(declaration.initial_guess, record.grid, what),
            what,
        )
    elif isinstance(declaration, Parameter):
        bounds = declaration.bounds_at(record.grid.times[0], what)
        guess = initial_number(declaration.initial_guess, what)
        block.add_component(name, Var(bounds=bounds, initialize=within(guess, bounds), units=declaration.units))
    else:
        raise DeclarationError(f"{what}: a {type(declaration).__name__} cannot be declared on a phase.")


def _add_state(block: Any, record: PhaseRecord, name: str, state: State, what: str) -> None:
    grid = record.grid
    add_indexed(block, name, state, block.time, initial_state_values(state.initial_guess, grid, what), what)
    variable = block.component(name)
    for given, time, where in ((state.initial, grid.times[0], "initial"), (state.final, grid.times[-1], "final")):
        _impose_boundary_value(variable[time], given, f"{what} (declared at {state.declared_at})", where)
    rows = dict(continuity_rows(variable, grid))
    if rows:
        continuity = Constraint(list(rows))
        add_generated(block, f"{name}_continuity", continuity)
        record.generated_rows.add(f"{name}_continuity")
        for time, row in rows.items():
            continuity.add(time, row)


def _impose_boundary_value(variable: Any, given: float | Bounds | None, what: str, where: str) -> None:
    if given is None:
        return
    if isinstance(given, tuple):
        lower, upper = check_bounds(given, what, f"{where} bounds")
        tightest_lower = max((b for b in (lower, variable.lb) if b is not None), default=None)
        tightest_upper = min((b for b in (upper, variable.ub) if b is not None), default=None)
        if tightest_lower is not None and tightest_upper is not None and tightest_lower > tightest_upper:
            raise DeclarationError(
                f"{what}: its {where} bounds {given} leave nothing of its bounds ({variable.lb}, {variable.ub})."
            )
        variable.setlb(tightest_lower)
        variable.setub(tightest_upper)
        variable.set_value(within(variable.value, (tightest_lower, tightest_upper)))
        return
    if not isinstance(given, Real) or not math.isfinite(given):
        raise DeclarationError(
            f"{what}: its {where} value is {given!r}; expected a finite number, a tuple (lower, upper), or None."
        )
    value = float(given)
    outside = (variable.lb is not None and value < variable.lb) or (variable.ub is not None and value > variable.ub)
    if outside:
        raise DeclarationError(
            f"{what}: its {where} value {value:g} lies outside its bounds ({variable.lb}, {variable.ub}). "
            "Widen the bounds or change the value."
        )
    variable.fix(value)
