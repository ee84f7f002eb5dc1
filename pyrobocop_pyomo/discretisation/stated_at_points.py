"""What a model states beside its phases: at the points of a mesh, where on another mesh it restrains another motion,
and in the integrals that phases have handed out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from pyomo.core.expr.numvalue import value
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.continuous.record import open_sets
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement, variables_in_any
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.phases import Control
from pyrobocop_pyomo.phases.equations import INTEGRALS

from .estimates import ZERO_OBJECTIVE
from .phase_multipliers import RowMultipliers


def stated_at_points(model: Any, phases: Sequence[Any], found: RowMultipliers, objective: float) -> str:
    """Why costates do not tell the error of the objective; empty where they do.

    They know the rows of phases. Planes between shapes, a user's own rows, bounds of rates and costs that are sums over
    points restrain the motion where the mesh looks, and nowhere else. What is stated at the ends of phases, or at a few
    element boundaries, is the same on any mesh, and so are costs of data at boundaries that were chosen for them.

    Parameters
    ----------
    model : Block
    phases : sequence of PhaseBlock
    found : RowMultipliers
    objective : float
        Of the answer.
    """
    inside, at_boundaries = _variables_at_points(phases)
    most = max(2, min(phase.grid.mesh.elements for phase in phases) - 1)
    # Per unit of a row: smaller multipliers are what a barrier leaves of rows that restrain nothing.
    least = MET * max(abs(objective), ZERO_OBJECTIVE)
    chosen = frozenset[float]().union(*(phase.record.chosen_times for phase in phases))
    for goal in model.component_data_objects(Objective, active=True):
        read = _read([goal.expr], phases)
        if read & inside or len({at_boundaries[key] for key in read & at_boundaries.keys()} - chosen) >= most:
            return f"'{goal.name}' reads points of the mesh, which are others on a finer one: state it as an integral."
    for component, rows in rows_beside(model, phases):
        read = _read([row.body for row in rows if abs(found.of_row(row)) > least], phases)
        if read & inside or (read & at_boundaries.keys() and len(component) >= most):
            home = component.parent_block()
            name = (home if isinstance(home, ObstacleAvoidanceBlockData) else component).name
            return f"'{name}' restrains the motion at points of the mesh only: compare with more elements."
    for phase in phases:
        for name in sorted(phase.record.kept_derivatives):
            keys = [id(rate) for rate in phase.component(f"{name}_derivative").values()]
            if any(abs(side.get(key, 0.0)) > least for side in (found.lower, found.upper) for key in keys):
                return (
                    f"bounds of the derivative of '{name}' hold at points of the mesh only: compare with more elements."
                )
    return ""


def rows_beside(model: Any, phases: Sequence[Any]) -> Iterator[tuple[Any, list[Any]]]:
    """Constraints that costates do not account for, each with its active rows."""
    accounted = {id(phase.component(name)) for phase in phases for name in _known_to_costates(phase.record)}
    for component in model.component_objects(Constraint, active=True):
        if id(component) not in accounted:
            yield component, [row for row in component.values() if row.active]


def motion_beside_phases(model: Any, phases: Sequence[Any]) -> Iterator[str]:
    """What moves in a model without a phase that states how, and what to do; a sentence for each."""
    sets = list(model.component_objects(ContinuousSet, active=True))
    undiscretised = open_sets(sets)
    for domain in sets:
        if id(domain) not in undiscretised:
            yield (
                f"what moves along '{domain.name}' has no estimate. Compare with a discretisation of twice as many "
                "elements, or state the motion in an rcp.PhaseBlock."
            )
    if not (phases or sets):
        for block in blocks_of_kind(model, ObstacleAvoidanceBlockData):
            yield f"'{block.name}' stands on points, and no equation says what moves between them."


def _known_to_costates(record: Any) -> Iterator[str]:
    """Names of the rows that make states follow their equations, of what was stated at all times, and over knots."""
    kinds = ("equation", "collocation", "continuity", "step")
    yield from (f"{name}_{kind}" for name in record.names_of_states for kind in kinds)
    yield from (statement.name for statement in record.statements)
    # Knots that the user has placed are the same on any mesh.
    yield from (f"{name}_rate" for name in record.names(Control) if record.declarations[name].knots is not None)


def _variables_at_points(phases: Sequence[Any]) -> tuple[set[int], dict[int, float]]:
    """Ids of the variables of phases inside elements, and of those at boundaries between elements with the time."""
    inside: set[int] = set()
    at_boundaries: dict[int, float] = {}
    for phase in phases:
        record = phase.record
        first, *others, last = record.grid.mesh.boundaries
        between = set(others)
        for name in (*record.names_of_states, *record.names_of_signals):
            nodes = record.nodes(name)
            for time, variable in zip(nodes.times, nodes.variables(phase), strict=True):
                if time in between:
                    at_boundaries[id(variable)] = time
                elif time not in (first, last) and getattr(record.declarations[name], "knots", None) is None:
                    inside.add(id(variable))
    return inside, at_boundaries


def _read(expressions: Sequence[Any], phases: Sequence[Any]) -> set[int]:
    """Ids of the variables that expressions hold, but for those of integrals."""
    integrals = {id(member) for phase in phases for member in (phase.component(INTEGRALS) or {}).values()}
    return set(variables_in_any(expressions, leaves=integrals))


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
    rows = (row for _, active in rows_beside(model, phases) for row in active if found.of_row(row) != 0.0)
    terms += [(-found.of_row(row), row.body) for row in rows]
    # What is in integrals is not looked through.
    reading = [term for term in terms if not wanted.isdisjoint(variables_in_any([term[1]], leaves=wanted))]
    every = [member for of_phase in members.values() for member in of_phase]
    scratch = ConcreteModel()
    scratch.gained = Var(range(len(every)), initialize=[float(value(member)) for member in every])
    gained = list(scratch.gained.values())
    in_their_place = NodeReplacement(dict(zip(map(id, every), gained, strict=True)))
    total = np.zeros(len(every))
    for weight, expression in reading:
        slopes = differentiate(in_their_place.of(expression), wrt_list=gained, mode=Modes.reverse_numeric)
        total += weight * np.array(slopes)
    by_member = dict(zip(map(id, every), total.tolist(), strict=True))
    return {key: [by_member[id(member)] for member in of_phase] for key, of_phase in members.items()}
