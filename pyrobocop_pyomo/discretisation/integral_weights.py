"""How the objective and the rows of a model depend on the integrals that its phases have handed out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.modeling.expression_nodes import LEAF, kind_of_node
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps, Leaf
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.phases.integrals import INTEGRALS

from .phase_multipliers import RowMultipliers
from .stated_at_points import rows_beside

# Of differences, relative to an integral.
_STEP = 1e-5


def integral_weights(model: Any, phases: Sequence[Any], found: RowMultipliers) -> dict[int, list[float]]:
    """Change of the Lagrangian per unit of each integral, by the identity of the phase.

    Parameters
    ----------
    model : Block
    phases : sequence of PhaseBlock
    found : RowMultipliers
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
    """Change of an expression per unit of each member, by the identity of the member; from differences."""
    every = [member for of_phase in members.values() for member in of_phase]
    own = set(map(id, every))
    steps = ExpressionSteps(
        [expression], lambda node: Leaf(node) if id(node) in own or kind_of_node(node.__class__) == LEAF else None
    )
    here = {id(member): float(value(member)) for member in every}

    def slope(member: int) -> float:
        step = _STEP * max(1.0, abs(here[member]))
        above, below = (
            float(steps.evaluate_at({**here, member: here[member] + change})[0]) for change in (step, -step)
        )
        return (above - below) / (2.0 * step)

    return {member: slope(member) for member in here}


def _rows_that_read(wanted: set[int], model: Any, phases: Sequence[Any], found: RowMultipliers) -> Iterator[Any]:
    """Rows that no phase has stated, and that restrain something, of constraints in which one of some nodes occurs."""
    for _, active in rows_beside(model, phases):
        rows = [row for row in active if found.of_row(row) != 0.0]
        if _reads(wanted, [row.body for row in rows]):
            yield from rows


def _reads(wanted: set[int], expressions: Sequence[Any]) -> bool:
    """Whether one of the expressions holds one of some nodes; what is in other integrals is not looked through."""
    return not wanted.isdisjoint(variables_in_any(expressions, leaves=wanted))
