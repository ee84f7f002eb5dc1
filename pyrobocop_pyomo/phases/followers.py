"""What else of a model stands on the times of phases: blocks of this package follow, what is the user's keeps the mesh.

Nothing of the user's is called again: a rule of a component over the times may say something else by now.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

from pyomo.core.base.reference import Reference
from pyomo.core.base.set import Set
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.in_place_changes import InPlaceChanges, expressions_in
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any

from .nodes import StageNodes, StateNodes
from .restatement import Restatement

_REMEDY = (
    "State it on the phase (phase.constraint, phase.integral), give data over time as an rcp.Table, and read what "
    "follows the mesh: x.at(time), x.at_start, x.at_end."
)


class Followers:
    """Everything on a model that is over the times of phases, or reads their variables, beside the phases themselves.

    Parameters
    ----------
    model : ConcreteModel
    restated : list of Restatement
    changes : InPlaceChanges
    """

    def __init__(self, model: Any, restated: list[Restatement], changes: InPlaceChanges) -> None:
        self._model, self._changes = model, changes
        self._restated = {id(each.block): each for each in restated}
        self._times = {id(each) for of in restated for each in (of.block.time, of.block.points)}

    def reason(self) -> str | None:
        """What is the user's and stands on the times, or reads variables that another mesh may not have."""
        inner = inner_variables([each.block for each in self._restated.values()])
        for block in self._model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            stands = isinstance(block, BuiltBlockData) and block.is_built and block.stands_on(self._times)
            if stands and not block.can_follow_times:
                return (
                    f"'{block.name}' stands on the times of a phase, and the rule of a pose or clearance of it has to "
                    "know the time as a number. Write pyo.Expr_if for a branch, rcp.Table for data over time."
                )
        for component in self._components():
            if self._is_over_times(component):
                return (
                    f"'{component.name}' is indexed by the times of a phase, and nothing of it would be known at "
                    f"others. {_REMEDY}"
                )
            if (found := self._first_read(component, inner)) is not None:
                return f"{found}, which another mesh may not have. {_REMEDY}"
        return None

    def follow(self) -> None:
        """State the blocks of this package anew that are over the times.

        Raises
        ------
        ModelError
            Naming what reads a variable that is gone.
        """
        for block in self._model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            if _following(block) is block and block.stands_on(self._times):
                for each in block.block_data_objects(active=None, descend_into=BLOCK_TYPES):
                    self._changes.protect_block(each)
                self._changes.protect_record(block._record)
                block.follow_times()
        gone = self._changes.lost_parts()
        for component in self._components() if gone else ():
            if (found := self._first_read(component, gone)) is not None:
                raise ModelError(f"{found}, which the new mesh has not. {_REMEDY}")

    def _components(self) -> Iterator[Any]:
        """Components that neither a phase among these owns nor a block that follows."""
        for block in self._model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            restatement = self._restated.get(id(block))
            if _following(block) is not None:
                continue
            for component in list(block.component_map().values()):
                if component.ctype in (*BLOCK_TYPES, Set, Suffix) or not component.is_constructed():
                    continue
                if restatement is None or not restatement.owns(component.local_name):
                    yield component

    def _is_over_times(self, component: Any) -> bool:
        if not component.is_indexed() or component.is_reference():
            return False
        return any(id(each) in self._times for each in component.index_set().subsets(expand_all_set_operators=True))

    def _first_read(self, component: Any, wanted: dict[int, Any]) -> str | None:
        return first_read(component, wanted, self._is_stated_anew) if wanted else None

    def _is_stated_anew(self, expression: Any) -> bool:
        component = expression.parent_component()
        restatement = None if component is None else self._restated.get(id(component.parent_block()))
        return restatement is not None and restatement.owns(component.local_name)


def first_read(component: Any, wanted: dict[int, Any], stops_at: Callable[[Any], bool]) -> str | None:
    """The first part of a component that reads a wanted variable, in words; None where there is none.

    Parameters
    ----------
    component : Component
    wanted : dict of identity to variable
    stops_at : callable
        Says of a named expression that what is in it does not count.
    """
    if component.ctype is Reference or component.is_reference():
        return None
    parts = list(expressions_in(component))
    if not variables_in_any(chain.from_iterable(expressions for _, expressions in parts)).keys() & wanted.keys():
        return None
    for part, expressions in parts:
        pending = list(expressions)
        while pending:
            node = pending.pop()
            if node.__class__ in native_numeric_types or node is None:
                continue
            if id(node) in wanted:
                home = node.parent_component()
                return f"'{part.name}' reads '{home.name if home is not None else 'a variable'}[{node._index}]'"
            if node.is_expression_type() and not (node.is_named_expression_type() and stops_at(node)):
                pending.extend(node.args)
    return None


def inner_variables(phases: list[Any]) -> dict[int, Any]:
    """Variables of phases that another mesh may not have, by their identity.

    States at element boundaries stay, and algebraics and controls at both ends: a row that names such a time means it.
    """
    found = {}
    for phase in phases:
        record = phase.record
        boundaries = record.grid.mesh.boundaries
        kept = [f"{name}_derivative" for name in record.kept_derivatives]
        for name in (*record.names_of_states, *record.names_of_signals, *kept):
            nodes = record.nodes(name)
            if isinstance(nodes, (StateNodes, StageNodes)):
                stay = boundaries if isinstance(nodes, StateNodes) else (boundaries[0], boundaries[-1])
                pairs = zip(nodes.times, nodes.variables(phase), strict=True)
                found.update({id(variable): variable for time, variable in pairs if time not in stay})
    return found


def _following(block: Any) -> Any:
    """The block that knows how to follow, which this one is or is inside of; None where there is none."""
    while block is not None:
        if isinstance(block, BuiltBlockData) and block.is_built and block.can_follow_times:
            return block
        block = block.parent_block()
    return None
