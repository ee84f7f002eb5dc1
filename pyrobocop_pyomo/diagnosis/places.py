"""Words for the place of a row: what it states, and in a phase at which time and in which element."""

from __future__ import annotations

import math
from typing import Any

from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.phases import PhaseBlockData

_COLLOCATION = "_collocation"


def place_in_words(data: Any) -> str:
    """``"constraint 'arm.reach' at t = 0.5, element 3"``, and so on for other components.

    Parameters
    ----------
    data : component data
        A row, a variable or a pair.
    """
    time, component, separation = time_of(data), data.parent_component(), separation_of(data)
    if separation is not None:
        block, one, other = separation
        return f"clearance between '{one}' and '{other}' of '{block}' from t = {time:g} on ('{component.local_name}')"
    if time is None:
        return f"{_kind(component)} '{data.name}'"
    phase = data.parent_block()
    if is_equation_of_a_phase(data):
        state = component.local_name.removesuffix(_COLLOCATION)
        return f"equation of '{state}' of phase '{phase.name}'{at_time(phase, time)}"
    further = data.index()[1:] if isinstance(data.index(), tuple) else ()
    index = f"[{', '.join(map(str, further))}]" if further else ""
    return f"{_kind(component)} '{component.name}'{index}{at_time(phase, time)}"


def separation_of(data: Any) -> tuple[str, str, str] | None:
    """Name of the avoidance block, and of both shapes that a row keeps apart; None for other rows."""
    block, index = data.parent_block(), data.index()
    is_one = isinstance(block, ObstacleAvoidanceBlockData) and isinstance(index, tuple)
    return (block.name, str(index[0]), str(index[1])) if is_one and index[:3] in block.separations else None


def is_equation_of_a_phase(data: Any) -> bool:
    """Whether a row was made of the differential equation of a state."""
    phase, name = data.parent_block(), data.parent_component().local_name
    if not isinstance(phase, PhaseBlockData) or not name.endswith(_COLLOCATION):
        return False
    return name.removesuffix(_COLLOCATION) in phase.record.names_of_states


def at_time(phase: Any, time: float) -> str:
    """``" at t = 0.5, element 3"``."""
    element = phase.record.grid.element_of.get(time)
    return f" at t = {time:g}" + ("" if element is None else f", element {element}")


def _kind(component: Any) -> str:
    return "constraint" if component.ctype is Constraint else str(component.ctype.__name__).lower()


def time_of(data: Any) -> float | None:
    """The time of a component's data of a phase, or where the segment of motion of a separation starts; else None."""
    if separation_of(data) is not None:
        return float(data.index()[2])
    if not isinstance(data.parent_block(), PhaseBlockData):
        return None
    index = data.index()
    time = index[0] if isinstance(index, tuple) and index else index
    return time if isinstance(time, float) and math.isfinite(time) else None
