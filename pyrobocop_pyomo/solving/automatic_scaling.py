"""Scales of a compiled model from its bounds, initial values and derivatives, and from what the user says of them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.suffixes import ProblemScaling, scaling_factors
from pyrobocop_pyomo.modeling.component_groups import ComponentGroups
from pyrobocop_pyomo.numerics import BoolArray
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
from pyrobocop_pyomo.programs.stationarity import beside

_ROUNDS = 5
# Relative to an objective: below, its change by all variables is rounding.
_CONSTANT = 1e-4
# Of the change of an objective by all variables. Ipopt's first barrier parameter is 0.1: beside an objective of size
# one it leads far away, and a finer mesh takes ever more iterations back. Beside a larger one, starts are left as they
# are, and poor ones end at poorer optima. Measured on a hundred problems.
_SHARE = 0.2
# The barrier is a sum over all bounds, and grows with their number on ever finer meshes, where the objective does not.
# From so many on, the objective is made larger in proportion: iterations do not depend on the mesh then.
_MANY_BOUNDS = 500
# Where runs start at other points their scales differ a little. Scales that stay keep the way to the answer.
_ALIKE = 10.0
# Objectives of models with pairs are left as they are above: another weight leads to other local optima.
_SMALL_SLOPE = 1e-5


@dataclass(frozen=True)
class _Smallness:
    """Beside the largest size, and beside what the rows say: what is smaller may be, and is, rounding."""

    doubtful: float
    rounding: float


_AT_A_GUESS = _Smallness(1e-10, 1e-6)
# At an answer, effort that need not be made is zero up to the tolerances of the solve, which are wider than rounding.
_AT_AN_ANSWER = _Smallness(1e-4, 1e-5)


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

    def is_like(self, other: AutomaticScaling) -> bool:
        """Whether no scale differs from the other one's by more than a factor of 10."""
        pairs = [(getattr(self.scales, name), getattr(other.scales, name)) for name in ("x", "g", "objective")]
        return all(np.abs(np.log(np.divide(ours, theirs))).max(initial=0.0) <= np.log(_ALIKE) for ours, theirs in pairs)

    def above_one(self) -> Iterator[tuple[Any, float]]:
        """Each variable and each constraint whose scale is above 1, with its scale."""
        for components, sizes in self.parts:
            for place in np.flatnonzero(sizes > 1.0).tolist():
                yield components[place], float(sizes[place])


def automatic_scaling(
    compiled: CompiledModel, stated: ProblemScaling | None = None, *, like: AutomaticScaling | None = None
) -> AutomaticScaling:
    """Scales at the values that are on the model.

    Parameters
    ----------
    compiled : CompiledModel
    stated : ProblemScaling, optional
        Factors that the user has stated, NaN where there are none; by default those of the model's suffixes.
    like : AutomaticScaling, optional
        Of the same program: returned where no scale is another one by more than a factor of 10.

    Returns
    -------
    AutomaticScaling
    """
    nlp, x = compiled.nlp, compiled.current_point()
    variables, constraints = compiled.groups
    known = _known_scales(variables, _widths(variables, nlp))
    stated = scaling_factors(compiled, missing=np.nan) if stated is None else stated
    x_stated = np.full(nlp.n, np.nan) if stated.x is None else _inverse(stated.x)
    _set(known, variables.numbers, x_stated)
    free = np.isnan(_by_group(known, variables.numbers, x_stated))
    scales = _without_rounding(nlp, x, variables, constraints, known, free, _AT_A_GUESS)
    jacobian = _jacobian(nlp, x)
    scales = np.where(np.isnan(scales), 1.0, scales)
    x_beside = beside(nlp, x, scales[variables.numbers])
    entries = _entries(nlp, [jacobian, _jacobian(nlp, x_beside)], variables, constraints)
    x_scales = scales[variables.numbers]
    bounds = np.abs(np.array([nlp.g_lower, nlp.g_upper]))
    rows = row_scales(scales, entries, np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0))
    g_scales = rows[constraints.numbers]
    changed = objective_scale(np.array([_gradient(nlp, x), _gradient(nlp, x_beside)]), x_scales)
    objective = max(_SHARE * changed, _CONSTANT * _size_of_objective(nlp, x))
    objective *= min(1.0, _MANY_BOUNDS / max(_terms_of_barrier(nlp), 1))
    x_scales = np.where(np.isnan(x_stated), x_scales, x_stated)
    if stated.g is not None:
        g_scales = np.where(np.isnan(stated.g), g_scales, _inverse(stated.g))
    if np.isfinite(stated.objective):
        objective = 1.0 / abs(stated.objective)
    parts = [(compiled.variables, x_scales), (compiled.constraints, g_scales)]
    record = ScalingRecord(_by_name(variables, x_scales), _by_name(constraints, g_scales), objective)
    found = AutomaticScaling(Scales(x_scales, g_scales, objective), record, parts)
    return like if like is not None and found.is_like(like) else found


def variable_sizes(compiled: CompiledModel) -> FloatArray:
    """Sizes of the variables by the values that are on the model, whatever their bounds and suffixes say.

    Where all values of a group are zero the rows tell, and where they do not, the bounds.

    Parameters
    ----------
    compiled : CompiledModel

    Returns
    -------
    float array, shape (n,)
    """
    nlp, x = compiled.nlp, compiled.current_point()
    variables, constraints = compiled.groups
    widths = _widths(variables, nlp)
    known = _known_scales(variables, np.zeros(widths.shape))
    scales = _without_rounding(nlp, x, variables, constraints, known, np.full(known.shape, True), _AT_AN_ANSWER)
    widths = np.where((widths > 0.0) & np.isfinite(widths), widths, 1.0)
    return np.where(np.isnan(scales), widths, scales)[variables.numbers]


def objective_slope(compiled: CompiledModel, below: float = _SMALL_SLOPE) -> float:
    """What the objective of a model with pairs is divided by: its largest derivative, where that is far below 1.

    Larger ones Ipopt divides by itself. Smaller ones are zero to its tolerances, and to those of linear programs.

    Parameters
    ----------
    compiled : CompiledModel
    below : float
        Larger ones are left as they are. Where a branch is solved, which has one optimum nearby, 1 is right: beside an
        objective of 1e-5 the last barrier parameter leaves a thousandth of it.
    """
    nlp, x = compiled.nlp, compiled.current_point()
    gradients = np.array([_gradient(nlp, x), _gradient(nlp, beside(nlp, x, variable_sizes(compiled)))])
    slope = float(np.abs(gradients[np.isfinite(gradients)]).max(initial=0.0))
    slope = max(slope, _CONSTANT * _size_of_objective(nlp, x))
    return slope if 0.0 < slope < below else 1.0


def _without_rounding(
    nlp: NonlinearProgram,
    x: FloatArray,
    variables: ComponentGroups,
    constraints: ComponentGroups,
    known: FloatArray,
    doubted: BoolArray,
    small: _Smallness,
) -> FloatArray:
    """As `_completed`; where a size that may be doubted is only what rounding left of zero, the rows tell."""
    scales = _completed(nlp, x, variables, constraints, known)
    doubtful = _doubtful(known, small) & doubted
    if not doubtful.any():
        return scales
    told = _completed_without(doubtful, nlp, x, variables, constraints, known)
    # What is told of by nothing is doubted beside its like only, as the flows of a trace of something.
    while (untold := doubtful & np.isnan(told)).any():
        doubtful = (doubtful & ~untold) | _doubtful(np.where(untold, known, np.nan), small)
        told = _completed_without(doubtful, nlp, x, variables, constraints, known)
    rounding = doubtful & (known < small.rounding * told)
    if not rounding.any():
        return scales
    return _completed_without(rounding, nlp, x, variables, constraints, known)


def _completed_without(
    left_out: BoolArray,
    nlp: NonlinearProgram,
    x: FloatArray,
    variables: ComponentGroups,
    constraints: ComponentGroups,
    known: FloatArray,
) -> FloatArray:
    """As `_completed`, where some values are taken for zero: a derivative that is made of them tells nothing."""
    without = np.where(left_out[variables.numbers], 0.0, x)
    # A logarithm or a quotient has no derivative there.
    x = without if np.isfinite(_jacobian(nlp, without)).all() else x
    return _completed(nlp, x, variables, constraints, np.where(left_out, np.nan, known))


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
        moved = _jacobian(nlp, beside(nlp, x, np.nan_to_num(scales)[variables.numbers]))
        found = variable_scales(scales, _entries(nlp, [jacobian, moved], variables, constraints))
        if np.array_equal(np.isnan(found), np.isnan(scales)):
            break
        scales = found
    return scales


def _doubtful(known: FloatArray, small: _Smallness) -> BoolArray:
    """Where a size may be what rounding left of zero, as the sine of pi."""
    there = known[~np.isnan(known)]
    return known < small.doubtful * there.max(initial=0.0) if there.size else np.zeros(known.shape, dtype=bool)


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


def _known_scales(groups: ComponentGroups, widths: FloatArray) -> FloatArray:
    """By the values of all parts, the fixed ones too, and by the distances of bounds."""
    values = [_largest_value(members) for members in groups.members]
    return np.array([size_of_group(value, width) for value, width in zip(values, widths.tolist(), strict=True)])


def _widths(groups: ComponentGroups, nlp: NonlinearProgram) -> FloatArray:
    """The largest distance of the bounds of what may move, by groups."""
    widths = np.zeros(len(groups.members))
    np.maximum.at(widths, groups.numbers, nlp.x_upper - nlp.x_lower)
    return widths


def _largest_value(members: list[Any]) -> float:
    return max((abs(data.value) for data in members if data.value is not None), default=0.0)


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
    block = rows.parent_block()  # none where the rows of a relaxation were taken back meanwhile
    state = None if block is None else block.component(rows.local_name.removesuffix("_collocation"))
    if state is None or state.ctype is not Var or not rows.local_name.endswith("_collocation"):
        return -1
    groups = variables.groups_of(state)
    return groups[0] if len(groups) == 1 else -1
