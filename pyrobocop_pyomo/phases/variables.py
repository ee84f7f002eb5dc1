"""From declarations to Pyomo variables."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.reference import Reference
from pyomo.core.base.set import RangeSet
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import DeclarationError, GuessError
from pyrobocop_pyomo.transcription import continuity_rows, element_guess, number_guess, stage_guess, state_guess

from .declarations import Algebraic, Bounds, Control, Declaration, Duration, Parameter, State, check_bounds, is_held
from .record import PhaseRecord


def add_variables(block: Any, record: PhaseRecord, name: str, declaration: Declaration) -> None:
    """Add the variables of one declaration to a phase block.

    Raises
    ------
    DeclarationError, GuessError
        When bounds, boundary values or the guess do not fit.
    """
    what = f"phase '{block.name}': {type(declaration).__name__.lower()} '{name}'"
    if isinstance(declaration, State):
        _add_state(block, record, name, declaration, what)
    elif isinstance(declaration, Control) and is_held(declaration):
        _add_held_control(block, record, name, declaration, what)
    elif isinstance(declaration, (Algebraic, Control)):
        _add_indexed(block, name, declaration, block.points, stage_guess(declaration.guess, record.grid, what), what)
    elif isinstance(declaration, Parameter):
        bounds = declaration.bounds_at(record.grid.times[0], what)
        guess = number_guess(declaration.guess, what)
        block.add_component(name, Var(bounds=bounds, initialize=_within(guess, bounds)))
    else:
        raise DeclarationError(f"{what}: a {type(declaration).__name__} cannot be declared on a phase.")


def add_duration(block: Any, record: PhaseRecord) -> None:
    """The duration: a number, or a variable within its bounds."""
    duration = record.duration
    if not isinstance(duration, Duration):
        block.duration = float(duration)
        return
    what = f"phase '{block.name}': duration"
    lower, upper = check_bounds(duration.bounds, what, "bounds")
    if duration.guess is None:
        assert lower is not None  # the caller has refused a duration without positive lower bound
        guess = lower if upper is None else (lower * upper) ** 0.5  # durations spread over magnitudes
    else:
        guess = number_guess(duration.guess, what)
        if guess <= 0:
            raise GuessError(f"{what}: the guess is {guess:g}; it must be positive.")
    block.duration = Var(bounds=(lower, upper), initialize=_within(guess, (lower, upper)))


def add_generated(block: Any, name: str, component: Any) -> None:
    """Add what is named after a declaration, not by the user.

    Raises
    ------
    DeclarationError
        When the name is taken.
    """
    if hasattr(block, name):
        raise DeclarationError(
            f"phase '{block.name}': the name '{name}' is needed for what is generated, but it is taken. "
            "Choose another name for yours."
        )
    block.add_component(name, component)


def _add_state(block: Any, record: PhaseRecord, name: str, state: State, what: str) -> None:
    grid = record.grid
    _add_indexed(block, name, state, block.time, state_guess(state.guess, grid, what), what)
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


def _add_indexed(block: Any, name: str, declaration: Declaration, index: Any, guess: Any, what: str) -> None:
    if callable(declaration.bounds):
        each_bounds = [declaration.bounds_at(time, what) for time in index]
        variable = Var(index, bounds=dict(zip(index, each_bounds, strict=True)))
    else:
        each_bounds = [declaration.bounds_at(0.0, what)] * len(index)
        variable = Var(index, bounds=each_bounds[0])
    block.add_component(name, variable)
    # Values given one by one: a dict passed to Var(initialize=...) takes six times as long.
    for data, value, bounds in zip(variable.values(), guess.tolist(), each_bounds, strict=True):
        data.set_value(_within(value, bounds), skip_validation=True)


def _add_held_control(block: Any, record: PhaseRecord, name: str, control: Control, what: str) -> None:
    """One variable per element, seen at each collocation point of it: no extra rows are needed."""
    grid = record.grid
    if grid.elements_share_points:
        raise DeclarationError(
            f"{what} (declared at {control.declared_at}): with the scheme {grid.scheme.name} neighbouring elements "
            "share a collocation point, where a piecewise constant control would have two values. Choose another "
            "parametrization, or a radau or gauss scheme."
        )
    bounds = [_common_bounds(control, times, what) for times in grid.stage_times]
    guess = element_guess(control.guess, grid, what).tolist()
    values = {i: _within(value, bounds[i]) for i, value in enumerate(guess)}
    held = Var(RangeSet(0, grid.mesh.elements - 1), bounds=dict(enumerate(bounds)), initialize=values)
    add_generated(block, f"{name}_per_element", held)
    block.add_component(name, Reference({time: held[element] for time, element in grid.element_of.items()}))


def _common_bounds(control: Control, times: tuple[float, ...], what: str) -> Bounds:
    """What the bounds at several times leave in common: one value has to respect them all."""
    if not callable(control.bounds):
        return control.bounds_at(times[0], what)
    lowers, uppers = zip(*(control.bounds_at(time, what) for time in times), strict=True)
    lower = max((each for each in lowers if each is not None), default=None)
    upper = min((each for each in uppers if each is not None), default=None)
    return check_bounds(
        (lower, upper), f"{what} (declared at {control.declared_at})", f"bounds between {times[0]:g} and {times[-1]:g}"
    )


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
        variable.set_value(_within(variable.value, (tightest_lower, tightest_upper)))
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


def _within(value: float, bounds: Bounds | None) -> float:
    """The value, moved onto the nearest bound if it lies outside."""
    lower, upper = bounds or (None, None)
    if lower is not None and value < lower:
        return lower
    return upper if upper is not None and value > upper else float(value)
