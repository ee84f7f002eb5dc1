"""What stands an element later in a model in time: by it, plans are moved ahead; the last values stand."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.phases import phases_of


def later_times(model: Any) -> dict[float, float]:
    """Each time of a model's phases, and the one that takes its place an element later.

    Parameters
    ----------
    model : Block
        All of its phases have the same times, with fixed start, fixed duration, equal elements and one point in each.

    Returns
    -------
    dict of float to float
        Without the last time.

    Raises
    ------
    TeamError
        When there are no phases, or not such ones.
    """
    grids = {phase.name: list(phase.time) for phase in phases_of(model) if not phase.has_normalised_time}
    if len(grids) < len(phases_of(model)) or not grids:
        raise TeamError(f"'{model.name}': to move a plan ahead its phases need a fixed start and a fixed duration.")
    (first, times), *others = grids.items()
    for name, grid in others:
        if grid != times:
            raise TeamError(f"'{model.name}': phases '{first}' and '{name}' have different times. Give them one mesh.")
    steps = np.diff(times)
    if np.ptp(steps) > NEGLIGIBLE * (times[-1] - times[0]):
        raise TeamError(
            f"'{model.name}': the times of phase '{first}' are {steps.min():g} to {steps.max():g} apart. A plan is "
            "moved ahead by elements of equal length with one point each, such as those of 'implicit_euler'."
        )
    return dict(pairwise(times))


def _later_index(index: Hashable, later: Mapping[float, float]) -> Hashable | None:
    """The index an element later; None where it holds no time, or the last one."""
    entries = index if isinstance(index, tuple) else (index,)
    moved = tuple(later.get(entry, entry) if isinstance(entry, float) else entry for entry in entries)
    if moved == entries:
        return None
    return moved if isinstance(index, tuple) else moved[0]


def later_variables(model: Any, variables: Sequence[VarData]) -> list[VarData]:
    """What an element later is what each variable is now: its component there; the variable itself where nothing is.

    Parameters
    ----------
    model : Block
    variables : sequence of VarData
    """
    later, found = later_times(model), []
    for variable in variables:
        component, index = variable.parent_component(), _later_index(variable.index(), later)
        found.append(component[index] if index is not None and index in component else variable)
    return found
