"""Small steps that several builders of a phase share."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import DeclarationError

from .declarations import Bounds, Declaration


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


def add_indexed(block: Any, name: str, declaration: Declaration, index: Any, guess: Any, what: str) -> None:
    """Add a variable over times, with its bounds and its initial guess moved onto them."""
    if callable(declaration.bounds):
        each_bounds = [declaration.bounds_at(time, what) for time in index]
        variable = Var(index, bounds=dict(zip(index, each_bounds, strict=True)), units=declaration.units)
    else:
        each_bounds = [declaration.bounds_at(0.0, what)] * len(index)
        variable = Var(index, bounds=each_bounds[0], units=declaration.units)
    block.add_component(name, variable)
    # Values given one by one: a dict passed to Var(initialize=...) takes six times as long.
    for data, value, bounds in zip(variable.values(), guess.tolist(), each_bounds, strict=True):
        data.set_value(within(value, bounds), skip_validation=True)


def rate_units(units: Any, time_units: Any) -> Any:
    """Units of a derivative, None where there are none at all."""
    if units is None:
        return None if time_units is None else 1 / time_units
    return units if time_units is None else units / time_units


def within(value: float, bounds: Bounds | None) -> float:
    """The value, moved onto the nearest bound if it lies outside."""
    lower, upper = bounds or (None, None)
    if lower is not None and value < lower:
        return lower
    return upper if upper is not None and value > upper else float(value)
