"""Where a phase starts when those before it end elsewhere than planned: by all rows that tie its start to them.

A link is one way to state such rows; a plain constraint ``c.x[0] == a.x[2]``, several links into one phase, and
variables of the model in between are others, and they say the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.row_violations import constraint_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_in, variables_in_any
from pyrobocop_pyomo.modeling.variable_values import values_restored
from pyrobocop_pyomo.numerics.mixed_complementarity import solve_mixed_complementarity
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.phases.coupled_phases import other_phases, put_on_model
from pyrobocop_pyomo.phases.declarations import Parameter
from pyrobocop_pyomo.phases.step_equations import problem_of_rows
from pyrobocop_pyomo.trajectories import Trajectory

Motions = Sequence[tuple[Any, Trajectory]]


@dataclass(frozen=True, eq=False)
class LinkedInitialState:
    """The rows that tie the start of a phase to the motions of others.

    Attributes
    ----------
    phase : PhaseBlock
    before : tuple of PhaseBlock
        Those whose motion these rows read.
    beside : tuple of PhaseBlock
        Those whose motion the equations of the phase read.
    rows : tuple of ConstraintData
        Equations, also of variables in between.
    conditions : tuple of ConstraintData
        Other rows between the start, or the parameters, and the motions of others.
    unknowns : tuple of VarData
        What the equations give: of the start, and in between.
    """

    phase: Any
    before: tuple[Any, ...] = ()
    beside: tuple[Any, ...] = ()
    rows: tuple[Any, ...] = ()
    conditions: tuple[Any, ...] = ()
    unknowns: tuple[Any, ...] = ()

    def start_after(self, motions: Motions) -> dict[str, float]:
        """Where the phase starts after motions of those before it; nothing where that is its start in the plan.

        Parameters
        ----------
        motions : sequence of (PhaseBlock, Trajectory)

        Raises
        ------
        ModelError
            When the rows do not say where.
        """
        rows = (*self.rows, *self.conditions)
        planned = {id(row): constraint_violation(row) for row in rows}

        def broken(rows: Iterable[Any]) -> list[str]:
            return [row.name for row in rows if not constraint_violation(row) <= planned[id(row)] + NEGLIGIBLE]

        with put_on_model(motions):
            if not broken(rows):
                return {}
        label = f"phase '{self.phase.name}'"
        start = solve_start(label, self.phase, self.rows, self.unknowns, motions)
        with values_restored(self.unknowns), put_on_model(motions):
            for variable, number in zip(self.unknowns, start, strict=True):
                variable.set_value(number, skip_validation=True)
            if first := broken(self.conditions):
                raise ModelError(f"{label}: '{first[0]}' does not hold after the motion of the phases before it.")
        names = {id(variable): name for name, variable in _starts(self.phase).items()}
        numbers = zip(self.unknowns, start, strict=True)
        return {names[id(variable)]: number for variable, number in numbers if id(variable) in names}


def linked_initial_state(phase: Any) -> LinkedInitialState:
    """All rows that tie the start of a phase to the motions of others.

    A row that reads later states of the phase as well, as a budget of all phases does, says nothing about its start
    alone; nor does one that reads the starts of others only.
    """
    others = other_phases(phase)
    if not others:
        return LinkedInitialState(phase)
    starts = {id(variable): variable for variable in _starts(phase).values()}
    entries = {*starts, *(id(phase.component(name)) for name in phase.record.names(Parameter))}
    homes = {id(other) for other in (phase, *others)}

    def between(variables: Iterable[Any]) -> dict[int, Any]:
        return {id(v): v for v in variables if id(v.parent_block()) not in homes and not v.fixed}

    read = [
        (row, of)
        for row in phase.model().component_data_objects(Constraint, active=True)
        if (of := list(variables_in(row.body))) and (_later_states(of, others) or between(of))
        if all(id(v) in starts for v in _states(of, [phase]))
    ]
    unknowns, rows, grows = dict(starts), dict[int, tuple[Any, list[Any]]](), True
    while grows:  # by the equations that variables in between stand in as well
        more = {id(row): (row, of) for row, of in read if row.equality and any(id(v) in unknowns for v in of)}
        grows, rows = len(more) > len(rows), more
        unknowns |= between(v for _, of in rows.values() for v in of)
    conditions = [
        (row, of)
        for row, of in read
        if id(row) not in rows and any(id(v) in entries for v in of) and _later_states(of, others)
    ]
    in_rows = {id(v): v for _, of in rows.values() for v in of}
    if not _later_states(in_rows.values(), others):
        rows, in_rows = {}, {}
    equations = variables_in_any(rate for name in phase.record.rates for rate in phase.record.rates[name].values())
    of_start = [*in_rows.values(), *(v for _, of in conditions for v in of)]
    return LinkedInitialState(
        phase,
        tuple(other for other in others if _later_states(of_start, [other])),
        tuple(other for other in others if _later_states(equations.values(), [other])),
        tuple(row for row, _ in rows.values()),
        tuple(row for row, _ in conditions),
        tuple(variable for key, variable in unknowns.items() if key in in_rows),
    )


def solve_start(label: str, phase: Any, rows: Collection[Any], unknowns: Collection[Any], past: Motions) -> list[float]:
    """Values of the unknowns at the start of a phase by equations, after given motions of the phases that these read.

    Raises
    ------
    ModelError
        When the equations do not determine them.
    """
    stated, variables = list(rows), list(unknowns)
    if len(stated) != len(variables):
        names = ", ".join(variable.name for variable in variables) or "none"
        raise ModelError(
            f"{label}: {len(stated)} equations for the start of {len(variables)} states ({names}). Give the start of "
            f"'{phase.name}' yourself."
        )
    expressions = [row.body - row.upper for row in stated]
    with put_on_model(past):
        guess = np.array([0.0 if variable.value is None else variable.value for variable in variables])
        solution = solve_mixed_complementarity(problem_of_rows(expressions, variables), guess)
    if not solution.solved:
        raise ModelError(
            f"{label}: its relations have no solution for the start of '{phase.name}' (residual "
            f"{solution.residual:.1e} in '{stated[solution.worst].name}')."
        )
    found: list[float] = solution.point.tolist()
    return found


def _starts(phase: Any) -> dict[str, Any]:
    """The states of a phase at its start, by name."""
    return {name: phase.component(name)[phase.initial_time] for name in phase.record.names_of_states}


def _states(variables: Iterable[Any], phases: Sequence[Any]) -> list[Any]:
    """The variables that are states of phases."""
    homes = {id(phase): phase.record.names_of_states for phase in phases}
    return [v for v in variables if v.parent_component().local_name in homes.get(id(v.parent_block()), ())]


def _later_states(variables: Iterable[Any], phases: Sequence[Any]) -> bool:
    """Whether there is a state of a phase that its equations lead to: any but that at its start."""
    return any(v.index() != v.parent_block().initial_time for v in _states(variables, phases))
