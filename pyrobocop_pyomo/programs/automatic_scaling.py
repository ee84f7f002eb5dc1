"""Scales of a compiled model from its bounds, initial values and derivatives, and from what the user says of them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.numerics.characteristic_scales import (
    GroupedEntries,
    objective_scale,
    row_scales,
    sizes_of_groups,
    variable_scales,
)
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.compiled_model import ComponentGroups

from .compiled_model import CompiledModel
from .nonlinear_program import FloatArray, ProblemScaling, Scales, beside

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
    ends = sorted(scales, key=scales.__getitem__)
    return " to ".join(f"{scales[name]:.1e} ('{name}')" for name in dict.fromkeys([*ends[:1], *ends[-1:]])) or "nothing"


@dataclass(frozen=True, eq=False)
class AutomaticScaling:
    """The scales of a program, by its own numbers and by names.

    Attributes
    ----------
    scales : Scales
    record : ScalingRecord
    """

    scales: Scales
    record: ScalingRecord

    def is_like(self, other: AutomaticScaling) -> bool:
        """Whether no scale differs from the other one's by more than a factor of 10."""
        pairs = [(getattr(self.scales, name), getattr(other.scales, name)) for name in ("x", "g", "objective")]
        return all(np.abs(np.log(np.divide(ours, theirs))).max(initial=0.0) <= np.log(_ALIKE) for ours, theirs in pairs)


def automatic_scaling(
    compiled: CompiledModel, stated: ProblemScaling, *, like: AutomaticScaling | None = None
) -> AutomaticScaling:
    """Scales at the values that are on the model.

    Parameters
    ----------
    compiled : CompiledModel
    stated : ProblemScaling
        Factors that the user has stated, NaN where there are none.
    like : AutomaticScaling, optional
        Of the same program: returned where no scale is another one by more than a factor of 10.
    """
    sizing = _Sizing(compiled)
    nlp, x, variables, constraints = sizing.nlp, sizing.x, sizing.variables, sizing.constraints
    # A factor of zero says nothing.
    x_stated, g_stated = (1.0 / np.where(factors == 0.0, np.nan, np.abs(factors)) for factors in (stated.x, stated.g))
    of_groups = np.full(len(variables.members), np.nan)
    of_groups[variables.numbers[~np.isnan(x_stated)]] = x_stated[~np.isnan(x_stated)]
    free = np.isnan(of_groups)
    known = np.where(free, _known_scales(variables, sizing.widths), of_groups)
    scales = sizing.without_rounding(known, free, _AT_A_GUESS)
    # Their products are to be numbers, also at a random start beyond all sizes.
    scales = np.minimum(np.where(np.isnan(scales), 1.0, scales), np.finfo(float).max ** 0.25)
    x_scales = scales[variables.numbers]
    x_beside = beside(nlp, x, x_scales)
    bounds = np.abs(np.array([nlp.g_lower, nlp.g_upper]))
    rows = row_scales(scales, sizing.entries(x, x_beside), np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0))
    changed = objective_scale(sizing.gradients(x, x_beside), x_scales)
    objective = max(_SHARE * changed, _CONSTANT * sizing.size_of_objective())
    # Variables and rows that have bounds to stay between.
    bounded = np.isfinite(nlp.x_lower) | np.isfinite(nlp.x_upper)
    terms = int(np.count_nonzero(bounded) + np.count_nonzero(nlp.g_lower != nlp.g_upper))
    objective *= min(1.0, _MANY_BOUNDS / max(terms, 1))
    x_scales = np.where(np.isnan(x_stated), x_scales, x_stated)
    g_scales = np.where(np.isnan(g_stated), rows[constraints.numbers], g_stated)
    if np.isfinite(stated.objective):
        objective = 1.0 / abs(stated.objective)
    record = ScalingRecord(_by_name(variables, x_scales), _by_name(constraints, g_scales), objective)
    found = AutomaticScaling(Scales(x_scales, g_scales, objective), record)
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
    sizing = _Sizing(compiled)
    widths = sizing.widths
    known = _known_scales(sizing.variables, np.zeros(widths.shape))
    scales = sizing.without_rounding(known, np.full(known.shape, True), _AT_AN_ANSWER)
    widths = np.where((widths > 0.0) & np.isfinite(widths), widths, 1.0)
    return np.where(np.isnan(scales), widths, scales)[sizing.variables.numbers]


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
    sizing = _Sizing(compiled)
    gradients = sizing.gradients(sizing.x, beside(sizing.nlp, sizing.x, variable_sizes(compiled)))
    slope = float(np.abs(gradients[np.isfinite(gradients)]).max(initial=0.0))
    slope = max(slope, _CONSTANT * sizing.size_of_objective())
    return slope if 0.0 < slope < below else 1.0


class _Sizing:
    """What a program's values and derivatives say of sizes, at the values that are on its model."""

    def __init__(self, compiled: CompiledModel) -> None:
        self.nlp, self.x = compiled.nlp, compiled.current_point()
        self.variables, self.constraints = compiled.groups
        # The largest distance of the bounds of what may move, by groups.
        self.widths = np.zeros(len(self.variables.members))
        np.maximum.at(self.widths, self.variables.numbers, self.nlp.x_upper - self.nlp.x_lower)
        self._places = [places.astype(np.intp) for places in self.nlp.jacobian_structure]
        own = [_group_of_state(component, self.variables) for component in self.constraints.components]
        self._own = np.array(own, dtype=np.intp)

    def without_rounding(self, known: FloatArray, doubted: BoolArray, small: _Smallness) -> FloatArray:
        """Scales of all groups of variables; where a size that may be doubted is only rounding, the rows tell."""
        scales = self._completed(known, self.x)
        doubtful = _doubtful(known, small) & doubted
        if not doubtful.any():
            return scales
        told = self._completed_without(doubtful, known)
        # What is told of by nothing is doubted beside its like only, as the flows of a trace of something.
        while (untold := doubtful & np.isnan(told)).any():
            doubtful = (doubtful & ~untold) | _doubtful(np.where(untold, known, np.nan), small)
            told = self._completed_without(doubtful, known)
        rounding = doubtful & (known < small.rounding * told)
        return self._completed_without(rounding, known) if rounding.any() else scales

    def _completed_without(self, left_out: BoolArray, known: FloatArray) -> FloatArray:
        """As `_completed`, where some values are taken for zero: a derivative that is made of them tells nothing."""
        without = np.where(left_out[self.variables.numbers], 0.0, self.x)
        # A logarithm or a quotient has no derivative there.
        x = without if np.isfinite(self._jacobian(without)).all() else self.x
        return self._completed(np.where(left_out, np.nan, known), x)

    def _completed(self, known: FloatArray, x: FloatArray) -> FloatArray:
        """Scales of all groups of variables; NaN where nothing tells any."""
        scales = variable_scales(known, self.entries(x))
        while np.isnan(scales).any():
            # Products of what is zero at the guess tell more where what is known already has moved.
            moved = beside(self.nlp, x, np.nan_to_num(scales)[self.variables.numbers])
            found = variable_scales(scales, self.entries(x, moved))
            if np.array_equal(np.isnan(found), np.isnan(scales)):
                break
            scales = found
        return scales

    def entries(self, *points: FloatArray) -> GroupedEntries:
        """Derivatives of the rows at some points."""
        values = np.array(list(map(self._jacobian, points)))
        rows, columns = self._places
        return GroupedEntries(rows, columns, values, self.constraints.numbers, self.variables.numbers, self._own)

    def gradients(self, *points: FloatArray) -> FloatArray:
        """Of the objective at some points; NaN where it has none."""
        unknown = np.full(self.nlp.n, np.nan)
        return np.array([_evaluated(self.nlp.gradient, x, unknown) for x in points])

    def size_of_objective(self) -> float:
        """Its value without sign; 0 where it has none."""
        return float(np.nan_to_num(abs(_evaluated(self.nlp.objective, self.x, 0.0)), posinf=0.0))

    def _jacobian(self, x: FloatArray) -> FloatArray:
        unknown = np.full(self.nlp.jacobian_structure[0].size, np.nan)
        return np.asarray(_evaluated(self.nlp.jacobian, x, unknown))


def _evaluated(function: Callable[[FloatArray], Any], x: FloatArray, unknown: Any) -> Any:
    with contextlib.suppress(EvaluationError):
        return function(x)
    return unknown


def _doubtful(known: FloatArray, small: _Smallness) -> BoolArray:
    """Where a size may be what rounding left of zero, as the sine of pi."""
    there = known[~np.isnan(known)]
    return known < small.doubtful * there.max(initial=0.0) if there.size else np.zeros(known.shape, dtype=bool)


def _by_name(groups: ComponentGroups, scales: FloatArray) -> dict[str, float]:
    return {groups.names[group]: scale for group, scale in zip(groups.numbers, scales.tolist(), strict=True)}


def _known_scales(groups: ComponentGroups, widths: FloatArray) -> FloatArray:
    """By the values of all parts, the fixed ones too, and by the distances of bounds."""
    values = [max((abs(data.value) for data in of if data.value is not None), default=0.0) for of in groups.members]
    return sizes_of_groups(np.array(values), widths)


def _group_of_state(rows: Any, variables: ComponentGroups) -> int:
    """The group of the state that collocation rows are about; -1 for other rows."""
    block = rows.parent_block()  # none where the rows of a relaxation were taken back meanwhile
    state = None if block is None else block.component(rows.local_name.removesuffix("_collocation"))
    if state is None or state.ctype is not Var or not rows.local_name.endswith("_collocation"):
        return -1
    groups = variables.groups_of(state)
    return groups[0] if len(groups) == 1 else -1
