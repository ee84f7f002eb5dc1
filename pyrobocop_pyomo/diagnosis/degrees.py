"""Counts: how many variables, rows, pairs, and what they leave to choose."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.phases import Control, phases_of

from .findings import DegreesOfFreedom


def degrees_of_freedom(block: Any) -> DegreesOfFreedom:
    """Count a block with all its active blocks."""
    # By identity: a control that is held is the same variable under two names.
    variables = {id(data): data for data in block.component_data_objects(Var, active=True, descend_into=Block)}
    rows = list(block.component_data_objects(Constraint, active=True, descend_into=Block))
    equalities = sum(row.equality for row in rows)
    # Relaxed pairs are deactivated, but still pairs; those on deactivated blocks are not counted.
    pairs = sum(
        len(component)
        for part in block.block_data_objects(active=True, descend_into=Block)
        for ctype in PAIR_TYPES
        for component in part.component_objects(ctype, descend_into=False)
    )
    return DegreesOfFreedom(
        name=block.name,
        variables=len(variables),
        fixed=sum(data.fixed for data in variables.values()),
        equalities=equalities,
        inequalities=len(rows) - equalities,
        pairs=pairs,
        controls=len(_controls(block)),
    )


def _controls(block: Any) -> set[int]:
    return {
        id(data)
        for phase in phases_of(block)
        for name in phase.record.names(Control)
        for data in phase.record.nodes(name).variables(phase)
        if not data.fixed
    }
