"""`TimeShift`: values of a model in time, moved ahead by one element; the last ones stand."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array
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


class TimeShift:
    """What takes the place of each variable when time moves on by one element: its component an element later.

    Parameters
    ----------
    model : Block
    variables : sequence of VarData
        Of a program, in its order.
    """

    def __init__(self, model: Any, variables: Sequence[VarData]) -> None:
        self._later = later_times(model)
        self._sources = [self.later(variable) for variable in variables]

    def values(self) -> Array:
        """What the variables' values are an element later, read from the model."""
        return np.array([source.value for source in self._sources], dtype=float)

    def later(self, variable: VarData) -> VarData:
        """What an element later is what this variable is now; itself where nothing is."""
        component = variable.parent_component()
        index = _later_index(variable.index(), self._later)
        return component[index] if index is not None and index in component else variable
