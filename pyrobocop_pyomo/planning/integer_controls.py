"""Controls that take some values only: solved relaxed, rounded by what their integrals say, and solved again.

On the way the controls are ordinary ones between their smallest and their largest value. Then each is rounded, over the
intervals in which it is constant, and held there while everything else is solved anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ContradictionError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.integer_approximation import (
    IntegralApproximation,
    integral_gap,
    limited_approximation,
    sum_up_rounding,
)
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.nodes import IntervalNodes
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all


@dataclass(frozen=True)
class RoundedControl:
    """One control, or one choice between the components of a vector, after rounding.

    Attributes
    ----------
    name : str
        With that of its phase.
    gap : float
        Largest difference of the accumulated weights of the values from those of the relaxed control, in time.
    bound : float or None
        What sum-up rounding guarantees for the gap; None where switches are limited.
    switches : int
    """

    name: str
    gap: float
    bound: float | None
    switches: int

    def __str__(self) -> str:
        bound = "" if self.bound is None else f" (at most {self.bound:.3g} by sum-up rounding)"
        return f"{self.name}: {self.switches} switches, integral gap {self.gap:.3g}{bound}"


@dataclass(frozen=True)
class IntegerRounding:
    """What became of the integer controls of a model.

    Attributes
    ----------
    relaxed_objective : float
        With controls between their values: for a convex relaxation what no rounding can beat.
    objective : float
        With the rounded controls, everything else solved anew.
    controls : tuple of RoundedControl
    """

    relaxed_objective: float
    objective: float
    controls: tuple[RoundedControl, ...]

    def __str__(self) -> str:
        first = f"integer controls: objective {self.objective:.8g}, relaxed {self.relaxed_objective:.8g}"
        return "; ".join([first, *map(str, self.controls)])


@dataclass(frozen=True, eq=False)
class _Choice:
    """Variables over intervals, one list per component, and the values among which is chosen."""

    name: str
    variables: list[list[Any]]
    declaration: Control
    widths: Array

    @property
    def one_of(self) -> bool:
        return len(self.variables) > 1

    @property
    def open_variables(self) -> list[Any]:
        return [variable for of in self.variables for variable in of if not variable.fixed]

    def weights(self) -> Array:
        """Relaxed weights of the alternatives in each interval, shape ``(n, N)``."""
        values = np.array([[float(variable.value) for variable in of] for of in self.variables])
        if self.one_of:
            values = np.clip(values, 0.0, 1.0)
            total = values.sum(axis=0)
            return np.where(total > 0.0, values / np.where(total > 0.0, total, 1.0), 1.0 / len(values))
        levels = np.array(self.declaration.levels)
        return np.array([np.interp(values[0], levels, of_one) for of_one in np.eye(len(levels))])

    def rounded(self) -> IntegralApproximation:
        weights = self.weights()
        if len(weights) == 1:
            return IntegralApproximation(np.zeros(len(self.widths), dtype=int), 0.0, 0.0)
        most, least = self.declaration.max_switches, self.declaration.min_dwell or 0.0
        if most is None and not least:
            return sum_up_rounding(weights, self.widths)
        found = limited_approximation(weights, self.widths, max_switches=most, min_dwell=least)
        if found is not None:
            return found
        constant = np.full(len(self.widths), int((weights @ self.widths).argmax()))
        return IntegralApproximation(constant, integral_gap(weights, constant, self.widths), None)

    def hold(self, choice: Array) -> None:
        """Fix every variable at what was chosen."""
        values = np.array(self.declaration.levels).tolist()
        for i, of in enumerate(self.variables):
            for variable, chosen in zip(of, choice.tolist(), strict=True):
                if not variable.fixed:
                    variable.fix(float(chosen == i) if self.one_of else values[chosen], skip_validation=True)


_ROOM = "give more elements or more switches, ends that are intervals, or room at bounds that the relaxed plan touches"


def open_choices(model: Any) -> list[_Choice]:
    """The integer controls of all active phases that are not held fixed."""
    found = []
    for phase in phases_of(model):
        record = phase.record
        taken: set[str] = set()
        for name in record.names(Control):
            declaration = record.declarations[name]
            nodes = record.nodes(name)
            if name in taken or not isinstance(declaration, Control) or declaration.levels is None:
                continue
            assert isinstance(nodes, IntervalNodes)
            family = next((of for of in record.families.values() if declaration.one_of and name in of.members), None)
            members = [name] if family is None else family.members
            taken.update(members)
            times = np.interp(nodes.knots, record.grid.mesh.boundaries, real_grid(phase).mesh.boundaries)
            choice = _Choice(
                f"{phase.name}.{name if family is None else family.name}",
                [record.nodes(member).variables(phase) for member in members],
                declaration,
                np.diff(times),
            )
            if choice.open_variables:
                found.append(choice)
    return found


@contextmanager
def _held(choices: list[_Choice], approximations: list[IntegralApproximation]) -> Iterator[None]:
    opened = [variable for choice in choices for variable in choice.open_variables]
    try:
        for choice, approximation in zip(choices, approximations, strict=True):
            choice.hold(approximation.choice)
        yield
    finally:
        for variable in opened:
            variable.unfix()


def solve_with_integer_controls(model: Any, solve: Callable[[], SolveResult], deadline: Deadline) -> SolveResult:
    """Solve relaxed, round, and solve again with the controls held; they are free again afterwards.

    Parameters
    ----------
    model : Block
    solve : callable
        Solves the model as it stands.
    deadline : Deadline
    """
    relaxed = solve()
    why_not = "the time was over" if deadline.has_passed else ""
    if not relaxed.standing.feasible or not math.isfinite(relaxed.objective):
        why_not = "not even the relaxed problem was solved"
    if why_not:
        return replace(relaxed, remarks=(*relaxed.remarks, f"integer controls: not rounded, since {why_not}"))
    choices = open_choices(model)  # the durations that the relaxed plan has found are those of the intervals
    approximations = [choice.rounded() for choice in choices]
    plan = VariableValues.of_all(model)
    try:
        with _held(choices, approximations):
            result = solve()
    except ContradictionError as error:  # of a row that holds nothing but such controls
        plan.restore()
        return replace(
            relaxed,
            quality=Quality.INFEASIBLE,
            stop_reason=StopReason.INFEASIBLE,
            standing=replace(relaxed.standing, excess=math.inf, optimal=False, certified=False),
            remarks=(
                *relaxed.remarks,
                f"integer controls: the plan is the relaxed one; with rounded ones the {error.__cause__}: {_ROOM}",
            ),
        )
    rounding = IntegerRounding(
        relaxed.objective,
        result.objective,
        tuple(
            RoundedControl(choice.name, found.gap, found.bound, found.switches)
            for choice, found in zip(choices, approximations, strict=True)
        ),
    )
    remarks = [str(rounding)]
    if not result.standing.feasible:
        remarks.append(f"with the rounded controls the constraints cannot be met: {_ROOM}")
    return replace(
        with_steps_of_all(result, [relaxed, result]),
        remarks=(*result.remarks, *remarks),
        rounding=rounding,
    )
