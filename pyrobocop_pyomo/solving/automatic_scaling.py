"""Scales of a compiled model from its bounds, initial values and derivatives, and from what the user says of them."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
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
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram
from pyrobocop_pyomo.programs.scaled_program import Scales

# Derivatives at a guess may be zero by chance: they are taken a tenth of each scale beside it as well.
_STEP = 0.1
_ROUNDS = 5
_GOLDEN = 0.6180339887498949
# Where the sizes of variables are at least so far apart, a program is scaled at once: nearer ones do Ipopt little harm,
# and its own units are more exact where sizes are overestimated. Where that fails, sizes are tried next.
SPREAD_SIZES = 1e4
# Relative to an objective: below, its change by all variables is rounding.
_CONSTANT = 1e-8


@dataclass(frozen=True)
class ScalingRecord:
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
    by_component : ComponentMap
        From each variable and each constraint of the program to its scale.
    stated : bool
        Whether the user says any of them.
    """

    scales: Scales
    record: ScalingRecord
    by_component: ComponentMap
    stated: bool


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
    stated = scaling_factors(compiled, missing=np.nan)
    known = _known_scales(variables)
    x_stated = np.full(nlp.n, np.nan) if stated.x is None else _inverse(stated.x)
    _set(known, variables.numbers, x_stated)
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
    scales = np.where(np.isnan(scales), 1.0, scales)
    beside = _beside(nlp, x, scales[variables.numbers])
    entries = _entries(nlp, [jacobian, _jacobian(nlp, beside)], variables, constraints)
    x_scales = scales[variables.numbers]
    bounds = np.abs(np.array([nlp.g_lower, nlp.g_upper]))
    rows = row_scales(scales, entries, np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0))
    g_scales = rows[constraints.numbers]
    changed = objective_scale(np.array([_gradient(nlp, x), _gradient(nlp, beside)]), x_scales)
    objective = max(changed, _CONSTANT * _size_of_objective(nlp, x))
    x_scales = np.where(np.isnan(x_stated), x_scales, x_stated)
    if stated.g is not None:
        g_scales = np.where(np.isnan(stated.g), g_scales, _inverse(stated.g))
    if np.isfinite(stated.objective):
        objective = 1.0 / abs(stated.objective)
    by_component = ComponentMap(zip(compiled.variables, x_scales.tolist(), strict=True))
    by_component.update(zip(compiled.constraints, g_scales.tolist(), strict=True))
    record = ScalingRecord(_by_name(variables, x_scales), _by_name(constraints, g_scales), objective)
    says = [values for values in (stated.x, stated.g, stated.objective) if values is not None]
    any_stated = any(bool(np.isfinite(values).any()) for values in says)
    return AutomaticScaling(Scales(x_scales, g_scales, objective), record, by_component, any_stated)


def sizes_to_scale_by(compiled: CompiledModel, least_spread: float | None) -> AutomaticScaling | None:
    """The scales of a program, where sizes of its variables differ by this factor or the user says some; else None."""
    if least_spread is None:
        return None
    found = automatic_scaling(compiled)
    sizes = found.scales.x
    far_apart = sizes.max(initial=1.0) >= least_spread * sizes.min(initial=np.inf)
    return found if found.stated or far_apart else None


def _size_of_objective(nlp: NonlinearProgram, x: FloatArray) -> float:
    try:
        value = abs(nlp.objective(x))
    except EvaluationError:
        return 0.0
    return float(value) if np.isfinite(value) else 0.0


def _inverse(factors: FloatArray) -> FloatArray:
    """Scales of factors; a factor of zero says nothing."""
    return 1.0 / np.where(factors == 0.0, np.nan, np.abs(factors))


def _set(known: FloatArray, groups: Any, stated: FloatArray) -> None:
    there = ~np.isnan(stated)
    known[groups[there]] = stated[there]


def _by_name(groups: ComponentGroups, scales: FloatArray) -> dict[str, float]:
    return {groups.names[group]: scale for group, scale in zip(groups.numbers, scales.tolist(), strict=True)}


def _known_scales(groups: ComponentGroups) -> FloatArray:
    return np.array([size_of_group(_largest_value(members), _width(members)) for members in groups.members])


def _largest_value(members: list[Any]) -> float:
    return max((abs(data.value) for data in members if data.value is not None), default=0.0)


def _width(members: list[Any]) -> float:
    """The largest distance of the bounds of what may move; infinite where a bound is missing."""
    widths = []
    for data in members:
        if not data.fixed:
            lower, upper = data.bounds
            widths.append(float("inf") if lower is None or upper is None else upper - lower)
    return max(widths, default=0.0)


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
    groups = {variables.group_of(data) for data in state.values()} - {None}
    return next(iter(groups)) if len(groups) == 1 else -1  # type: ignore[return-value]
