"""Scales of a compiled model from its bounds, initial values and derivatives, and from what the user says of them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.suffixes import scaling_factors
from pyrobocop_pyomo.modeling.component_groups import ComponentGroups
from pyrobocop_pyomo.numerics.characteristic_scales import (
    GroupedEntries,
    objective_scale,
    row_scales,
    size_of_group,
    variable_scales,
)
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram
from pyrobocop_pyomo.programs.scales import Scales

# Derivatives at a guess may be zero by chance: they are taken a tenth of each scale beside it as well.
_STEP = 0.1
_ROUNDS = 5
_GOLDEN = 0.6180339887498949
# Relative to an objective: below, its change by all variables is rounding.
_CONSTANT = 1e-4
# Of the change of an objective by all variables. Ipopt's first barrier parameter is 0.1: beside an objective of size
# one it leads far away, and a finer mesh takes ever more iterations back. Beside a larger one, starts are left as they
# are, and poor ones end at poorer optima. Measured on a hundred problems.
_SHARE = 0.2
# The barrier is a sum over all bounds, and grows with their number on ever finer meshes, where the objective does not.
# From so many on, the objective is made larger in proportion: iterations do not depend on the mesh then.
_MANY_BOUNDS = 500
# Beside the largest size, and beside what the rows say: what is smaller may be, and is, rounding.
_ROUNDING, _ROUNDING_BESIDE = 1e-10, 1e-6


@dataclass(frozen=True)
class ScalingRecord(Presented):
    """What the variables, the rows and the objective of a model were divided by; components by name.

    Attributes
    ----------
    variables, rows : dict of str to float
        Scale by group: a component's name, with the part of the index that is no time.
    objective : float
    """

    variables: dict[str, float]
    rows: dict[str, float]
    objective: float

    def __str__(self) -> str:
        return (
            f"scaled: variables by {_range(self.variables)}, rows by {_range(self.rows)}, "
            f"the objective by {self.objective:.1e}"
        )


def _range(scales: dict[str, float]) -> str:
    if not scales:
        return "nothing"
    least, largest = min(scales, key=scales.__getitem__), max(scales, key=scales.__getitem__)
    if len(scales) == 1:
        return f"{scales[least]:.1e} ('{least}')"
    return f"{scales[least]:.1e} ('{least}') to {scales[largest]:.1e} ('{largest}')"


@dataclass(frozen=True, eq=False)
class AutomaticScaling:
    """The scales of a program, by its own numbers and by components.

    Attributes
    ----------
    scales : Scales
    record : ScalingRecord
    parts : list of (list of component data, array)
        The variables of the program, and its constraints, with the scale of each.
    """

    scales: Scales
    record: ScalingRecord
    parts: Sequence[tuple[Sequence[Any], FloatArray]]

    def above_one(self) -> Iterator[tuple[Any, float]]:
        """Each variable and each constraint whose scale is above 1, with its scale."""
        for components, sizes in self.parts:
            for place in np.flatnonzero(sizes > 1.0).tolist():
                yield components[place], float(sizes[place])


def automatic_scaling(compiled: CompiledModel) -> AutomaticScaling:
    """Scales at the values that are on the model.

    Parameters
    ----------
    compiled : CompiledModel

    Returns
    -------
    AutomaticScaling
    """
    nlp, x = compiled.nlp, compiled.current_point()
    variables, constraints = ComponentGroups(compiled.variables), ComponentGroups(compiled.constraints)
    stated, known = scaling_factors(compiled, missing=np.nan), _known_scales(variables, nlp)
    x_stated = np.full(nlp.n, np.nan) if stated.x is None else _inverse(stated.x)
    _set(known, variables.numbers, x_stated)
    scales = _completed(nlp, x, variables, constraints, known)
    doubtful = _doubtful(known) & np.isnan(_by_group(known, variables.numbers, x_stated))
    if doubtful.any():
        told = _completed(nlp, x, variables, constraints, np.where(doubtful, np.nan, known))
        rounding = doubtful & (known < _ROUNDING_BESIDE * told)
        if rounding.any():
            scales = _completed(nlp, x, variables, constraints, np.where(rounding, np.nan, known))
    jacobian = _jacobian(nlp, x)
    scales = np.where(np.isnan(scales), 1.0, scales)
    beside = _beside(nlp, x, scales[variables.numbers])
    entries = _entries(nlp, [jacobian, _jacobian(nlp, beside)], variables, constraints)
    x_scales = scales[variables.numbers]
    bounds = np.abs(np.array([nlp.g_lower, nlp.g_upper]))
    rows = row_scales(scales, entries, np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0))
    g_scales = rows[constraints.numbers]
    changed = objective_scale(np.array([_gradient(nlp, x), _gradient(nlp, beside)]), x_scales)
    objective = max(_SHARE * changed, _CONSTANT * _size_of_objective(nlp, x))
    objective *= min(1.0, _MANY_BOUNDS / max(_terms_of_barrier(nlp), 1))
    x_scales = np.where(np.isnan(x_stated), x_scales, x_stated)
    if stated.g is not None:
        g_scales = np.where(np.isnan(stated.g), g_scales, _inverse(stated.g))
    if np.isfinite(stated.objective):
        objective = 1.0 / abs(stated.objective)
    parts = [(compiled.variables, x_scales), (compiled.constraints, g_scales)]
    record = ScalingRecord(_by_name(variables, x_scales), _by_name(constraints, g_scales), objective)
    return AutomaticScaling(Scales(x_scales, g_scales, objective), record, parts)


def objective_size(nlp: NonlinearProgram, x: FloatArray) -> float:
    """By how much an objective changes where all variables change by their sizes, or by 1 where these are smaller.

    Parameters
    ----------
    nlp : NonlinearProgram
    x : float array, shape (n,)
        Where gradients are taken, there and beside it.
    """
    scales = np.maximum(1.0, np.abs(x))
    return objective_scale(np.array([_gradient(nlp, x), _gradient(nlp, _beside(nlp, x, scales))]), scales)


def _completed(
    nlp: NonlinearProgram, x: FloatArray, variables: ComponentGroups, constraints: ComponentGroups, known: FloatArray
) -> FloatArray:
    """Scales of all groups of variables; NaN where nothing tells any."""
    jacobian = _jacobian(nlp, x)
    scales = variable_scales(known, _entries(nlp, [jacobian], variables, constraints))
    for _ in range(_ROUNDS):
        if not np.isnan(scales).any():
            break
        # Products of what is zero at the guess tell more where what is known already has moved.
        moved = _jacobian(nlp, _beside(nlp, x, np.nan_to_num(scales)[variables.numbers]))
        found = variable_scales(scales, _entries(nlp, [jacobian, moved], variables, constraints))
        if np.array_equal(np.isnan(found), np.isnan(scales)):
            break
        scales = found
    return scales


def _doubtful(known: FloatArray) -> Any:
    """Where a size may be what rounding left of zero, as the sine of pi."""
    there = known[~np.isnan(known)]
    return known < _ROUNDING * there.max(initial=0.0) if there.size else np.zeros(known.shape, dtype=bool)


def _by_group(known: FloatArray, groups: Any, stated: FloatArray) -> FloatArray:
    found = np.full(known.shape, np.nan)
    _set(found, groups, stated)
    return found


def _size_of_objective(nlp: NonlinearProgram, x: FloatArray) -> float:
    try:
        value = abs(nlp.objective(x))
    except EvaluationError:
        return 0.0
    return float(value) if np.isfinite(value) else 0.0


def _terms_of_barrier(nlp: NonlinearProgram) -> int:
    """Variables and rows that have bounds to stay between."""
    of_variables = np.isfinite(nlp.x_lower) | np.isfinite(nlp.x_upper)
    return int(np.count_nonzero(of_variables) + np.count_nonzero(nlp.g_lower != nlp.g_upper))


def _inverse(factors: FloatArray) -> FloatArray:
    """Scales of factors; a factor of zero says nothing."""
    return 1.0 / np.where(factors == 0.0, np.nan, np.abs(factors))


def _set(known: FloatArray, groups: Any, stated: FloatArray) -> None:
    there = ~np.isnan(stated)
    known[groups[there]] = stated[there]


def _by_name(groups: ComponentGroups, scales: FloatArray) -> dict[str, float]:
    return {groups.names[group]: scale for group, scale in zip(groups.numbers, scales.tolist(), strict=True)}


def _known_scales(groups: ComponentGroups, nlp: NonlinearProgram) -> FloatArray:
    """By the values of all parts, the fixed ones too, and by the largest distance of the bounds of what may move."""
    widths = np.zeros(len(groups.members))
    np.maximum.at(widths, groups.numbers, nlp.x_upper - nlp.x_lower)
    values = [_largest_value(members) for members in groups.members]
    return np.array([size_of_group(value, width) for value, width in zip(values, widths.tolist(), strict=True)])


def _largest_value(members: list[Any]) -> float:
    return max((abs(data.value) for data in members if data.value is not None), default=0.0)


def _beside(nlp: NonlinearProgram, x: FloatArray, scales: FloatArray) -> FloatArray:
    """A point about a tenth of each scale away, within the bounds; every variable goes its own way."""
    steps = _STEP * scales * (0.5 + np.arange(1, nlp.n + 1) * _GOLDEN % 1.0)
    up = x + steps
    return np.clip(np.where(up <= nlp.x_upper, up, x - steps), nlp.x_lower, nlp.x_upper)


def _jacobian(nlp: NonlinearProgram, x: FloatArray) -> FloatArray:
    with contextlib.suppress(EvaluationError):
        return nlp.jacobian(x)
    return np.full(nlp.jacobian_structure[0].size, np.nan)


def _gradient(nlp: NonlinearProgram, x: FloatArray) -> FloatArray:
    with contextlib.suppress(EvaluationError):
        return nlp.gradient(x)
    return np.full(nlp.n, np.nan)


def _entries(
    nlp: NonlinearProgram, jacobians: list[FloatArray], variables: ComponentGroups, constraints: ComponentGroups
) -> GroupedEntries:
    rows, columns = nlp.jacobian_structure
    return GroupedEntries(
        rows.astype(np.intp),
        columns.astype(np.intp),
        np.array(jacobians),
        constraints.numbers,
        variables.numbers,
        np.array([_group_of_state(component, variables) for component in constraints.components], dtype=np.intp),
    )


def _group_of_state(rows: Any, variables: ComponentGroups) -> int:
    """The group of the state that collocation rows are about; -1 for other rows."""
    state = rows.parent_block().component(rows.local_name.removesuffix("_collocation"))
    if state is None or state.ctype is not Var or not rows.local_name.endswith("_collocation"):
        return -1
    groups = variables.groups_of(state)
    return groups[0] if len(groups) == 1 else -1
