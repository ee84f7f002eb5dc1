"""How the objective and the rows of a model depend on the integrals that its phases have handed out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS, LEAF, kind_of_node
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps, Leaf
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.phases.integrals import INTEGRALS

from .row_multipliers import RowMultipliers
from .stated_at_points import rows_beside

# Of differences, relative to an integral: where something holds them that is not affine in them.
_STEP = 1e-5
_AFFINE = 1e-10
# Rows of the user's own beside the phases that are looked through.
_MOST_ROWS = 5000


def integral_weights(model: Any, phases: Sequence[Any], found: RowMultipliers) -> dict[int, list[float]]:
    """Change of the Lagrangian per unit of each integral, by the identity of the phase.

    Parameters
    ----------
    model : Block
    phases : sequence of PhaseBlock
    found : RowMultipliers

    Raises
    ------
    TrajectoryError
        When the objective or a row has no value, or there are too many rows to look through.
    """
    members = {
        id(phase): [phase.component(INTEGRALS)[k] for k in range(1, len(phase.record.integrals) + 1)]
        for phase in phases
    }
    wanted = {id(member) for of_phase in members.values() for member in of_phase}
    if not wanted:
        return {id(phase): [] for phase in phases}
    terms = [(1.0, data.expr) for data in model.component_data_objects(Objective, active=True)]
    terms += [(-found.of_row(row), row.body) for row in _rows_that_read(wanted, model, phases, found)]
    reading = [(weight, expression) for weight, expression in terms if _reads(wanted, [expression])]
    slopes = [(weight, _slopes(expression, members)) for weight, expression in reading]
    return {
        key: [sum(weight * of[id(member)] for weight, of in slopes) for member in of_phase]
        for key, of_phase in members.items()
    }


def _slopes(expression: Any, members: Mapping[int, Sequence[Any]]) -> dict[int, float]:
    """Change of an expression per unit of each member, by the identity of the member."""
    every = [member for of_phase in members.values() for member in of_phase]
    count = len(every)
    # Columns: all zero, each one alone, and two mixtures. What is affine, as nearly all is, needs no values of the
    # members, which are long sums.
    mixtures = [np.sin(1.0 + np.arange(count)), 3.0 * np.cos(2.0 + np.arange(count))]
    samples = np.column_stack([np.zeros(count), np.eye(count), *mixtures])

    own = set(map(id, every))
    steps = ExpressionSteps(
        [expression], lambda node: Leaf(node) if id(node) in own or kind_of_node(node.__class__) == LEAF else None
    )

    def values(samples: Any) -> Any:
        leaves = {id(member): row for member, row in zip(every, samples, strict=True)}
        try:
            return np.broadcast_to(steps.evaluate_at(leaves, ARRAY_FUNCTIONS)[0], samples.shape[1])
        except (ArithmeticError, ValueError, TypeError):
            return np.full(samples.shape[1], np.nan)

    with np.errstate(all="ignore"):
        # Beside large other terms a change by one would be lost.
        scale = np.fmax(1.0, np.abs(values(samples[:, :1]))[0])
        found = values(scale * samples)
        slopes = found[1 : count + 1] - found[0]
        left = found[count + 1 :] - found[0] - slopes @ samples[:, count + 1 :]
        slopes = slopes / scale
        size = _AFFINE * (np.abs(found).max() + 1e-300)
    if np.isfinite(found).all() and np.abs(left).max() <= size:
        return {id(member): float(slope) for member, slope in zip(every, slopes, strict=True)}
    return {id(member): _slope(steps, member) for member in every}


def _rows_that_read(wanted: set[int], model: Any, phases: Sequence[Any], found: RowMultipliers) -> Iterator[Any]:
    """Rows that no phase has stated, and that restrain something, of constraints in which one of some nodes occurs."""
    count = 0
    for _, active in rows_beside(model, phases):
        rows = [row for row in active if found.of_row(row) != 0.0]
        count += len(rows)
        if count > _MOST_ROWS:
            raise TrajectoryError("too many rows beside the phases to look for integrals in.")
        if _reads(wanted, [row.body for row in rows]):
            yield from rows


def _reads(wanted: set[int], expressions: Sequence[Any]) -> bool:
    """Whether one of the expressions holds one of some nodes; what is in other integrals is not looked through."""
    return not wanted.isdisjoint(variables_in_any(expressions, leaves=wanted))


def _slope(steps: ExpressionSteps, member: Any) -> float:
    here = float(value(member))
    step = _STEP * max(1.0, abs(here))
    above, below = (float(steps.evaluate_at({id(member): here + change})[0]) for change in (step, -step))
    return (above - below) / (2.0 * step)
