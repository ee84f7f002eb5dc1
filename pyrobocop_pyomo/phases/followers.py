"""What else on a model follows when phases get other meshes: components with rules, and blocks that know how."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

from pyomo.core.base.expression import Expression
from pyomo.core.base.initializer import ConstantInitializer
from pyomo.core.base.param import Param
from pyomo.core.base.reference import Reference
from pyomo.core.base.set import Set
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.expr.compare import compare_expressions
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import RemeshingError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.in_place_changes import InPlaceChanges, expressions_in
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any

from .nodes import StageNodes, StateNodes
from .restatement import Restatement

_REMEDY = (
    "Give it a rule, state it on the phase (phase.constraint, phase.integral), or read what stays: states at the start "
    "and the end."
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
        self._followed: set[int] = set()

    # ---------------------------------------------------------------- the steps

    def follow(self) -> None:
        """State phases and what is over their times, in the order in which they were declared.

        Raises
        ------
        RemeshingError
            Naming a component over the times that has no rule.
        """
        own = {id(component): component for component in self._components() if self._is_over_times(component)}
        for component in own.values():
            if (reason := _reason_against(component)) is not None:
                raise RemeshingError(reason)
        on_phases = {id(c) for c in own.values() if id(c.parent_block()) in self._restated and c.ctype is not Param}
        later = [c for key, c in own.items() if key not in on_phases and not self._follows_early(c)]
        for restatement in self._restated.values():
            for name, component in list(restatement.block.component_map().items()):
                if restatement.owns(name):
                    restatement.state_until(name)
                elif id(component) in own and id(component) not in self._followed:
                    self._follow(component)
            restatement.state_all()
        for component in later:
            if id(component) not in self._followed:
                self._follow(component)
        for block in self._following_blocks():
            if block.stands_on(self._times):
                self._follow_block(block)

    def check(self) -> None:
        """Let what reads variables that are gone follow by its rule; refuse what has none.

        Raises
        ------
        RemeshingError
            Naming the component and the variable.
        """
        gone = self._changes.lost_parts()
        for component in list(self._components(of_blocks_that_follow=True)) if gone else ():
            found = None if id(component) in self._followed else first_read(component, gone, self._is_stated_anew)
            if found is None:
                continue
            block = _following(component.parent_block())
            if block is not None:
                self._follow_block(block)
            elif rule_of(component) is not None:
                self._follow(component)
            found = first_read(component, gone, self._is_stated_anew) if component.parent_block() is not None else None
            if found is not None:
                raise RemeshingError(f"{found}, which the new mesh has not. {_REMEDY}")

    def reason(self) -> str | None:
        """What cannot follow, as far as it can be told beforehand: element boundaries are taken to stay."""
        for component in self._components():
            if self._is_over_times(component) and (reason := _reason_against(component)) is not None:
                return reason
        inner = {
            id(variable): variable for each in self._restated.values() for variable in _inside_elements(each.block)
        }
        for component in self._components() if inner else ():
            if rule_of(component) is None and not self._is_over_times(component):
                found = first_read(component, inner, self._will_be_stated_anew)
                if found is not None:
                    return f"{found}, which another mesh may not have. {_REMEDY}"
        return None

    # ---------------------------------------------------------------- what there is

    def _components(self, of_blocks_that_follow: bool = False) -> Iterator[Any]:
        """Components that no phase among these owns; those of blocks that know how to follow on request."""
        for block in self._model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            restatement = self._restated.get(id(block))
            if not of_blocks_that_follow and _following(block) is not None:
                continue
            for component in list(block.component_map().values()):
                if component.ctype in (*BLOCK_TYPES, Set, Suffix) or not component.is_constructed():
                    continue
                if restatement is None or not restatement.owns(component.local_name):
                    yield component

    def _following_blocks(self) -> list[Any]:
        found = self._model.block_data_objects(active=None, descend_into=BLOCK_TYPES)
        return [block for block in found if _following(block) is block]

    def _is_over_times(self, component: Any) -> bool:
        if not component.is_indexed() or component.is_reference():
            return False
        return any(id(each) in self._times for each in component.index_set().subsets(expand_all_set_operators=True))

    def _is_stated_anew(self, expression: Any) -> bool:
        component = expression.parent_component()
        return component is not None and self._changes.has_changed(component)

    def _will_be_stated_anew(self, expression: Any) -> bool:
        component = expression.parent_component()
        if component is None:
            return False
        restatement = self._restated.get(id(component.parent_block()))
        return (restatement is not None and restatement.owns(component.local_name)) or rule_of(component) is not None

    # ---------------------------------------------------------------- following

    def _follows_early(self, component: Any) -> bool:
        """Statements of a phase may read it; or it may read what they have to state first."""
        try:
            self._follow(component)
        except (LookupError, ValueError):  # errors of this package among them
            return False
        return True

    def _follow(self, component: Any) -> None:
        """Ask the rule of a component at the indices that it has now."""
        changes, rule, home = self._changes, rule_of(component), component.parent_block()
        assert rule is not None
        changes.protect(component)
        before = changes.parts_before(component)
        if not component.is_indexed():
            held = component.expr
            changes.on_error(lambda: component.set_value(held))
            component.set_value(rule(home, None))
        else:
            component._data = {}
            for index in component.index_set():
                if component.ctype is Var:
                    self._follow_variable(component, index, before)
                else:
                    component._setitem_when_not_present(index, rule(home, index))
            _refuse_other_members(component, before)
            if component.ctype is Expression:
                changes.put_back_expressions(component)
        self._followed.add(id(component))

    def _follow_variable(self, component: Any, index: Any, before: dict[Any, Any]) -> None:
        if index in before:
            component._data[index] = before[index]
        else:
            component._getitem_when_not_present(index)

    def _follow_block(self, block: Any) -> None:
        if id(block) in self._followed:
            return
        for each in block.block_data_objects(active=None, descend_into=BLOCK_TYPES):
            self._changes.protect_block(each)
        self._changes.protect_record(block._record)
        block.follow_times()
        self._followed.add(id(block))


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


def rule_of(component: Any) -> Callable[[Any, Any], Any] | None:
    """What a component can be stated by anew: called with its block and an index. None where there is nothing."""
    if component.ctype is Var:
        return component._getitem_when_not_present if component.is_indexed() else None
    rule = getattr(component, "rule", None) or getattr(component, "_rule", None)
    if rule is None or not callable(rule) or rule.contains_indices():
        return None
    if isinstance(rule, ConstantInitializer):
        number = rule(None, None)
        return rule if component.is_indexed() and number.__class__ in native_numeric_types else None
    return rule


def _reason_against(component: Any) -> str | None:
    if rule_of(component) is not None:
        return None
    return (
        f"'{component.name}' is indexed by the times of a phase, and has no rule by which it could be made for others. "
        f"{_REMEDY}"
    )


def _following(block: Any) -> Any:
    """The block that knows how to follow, which this one is or is inside of; None where there is none."""
    while block is not None:
        if isinstance(block, BuiltBlockData) and block.is_built and block.can_follow_times:
            return block
        block = block.parent_block()
    return None


def _refuse_other_members(component: Any, before: dict[Any, Any]) -> None:
    """Refuse a component whose members were set otherwise than by its rule."""
    if component.ctype in (Param, Var):
        return
    staying = [index for index in before if index in component._data]
    for index in staying[:1] + staying[-1:]:
        old, new = (_content(part) for part in (before[index], component._data[index]))
        if not all(compare_expressions(*each) for each in zip(old, new, strict=True)):
            raise RemeshingError(
                f"'{component.name}[{index}]' is not what the rule of '{component.name}' gives: members that were set "
                "after it was built cannot be made for another mesh."
            )


def _content(part: Any) -> list[Any]:
    return list(part.args) if hasattr(part, "weight") else [part.expr]


def _inside_elements(phase: Any) -> Iterator[Any]:
    """Variables of a phase at times that are no element boundaries."""
    record = phase.record
    boundaries = set(record.grid.mesh.boundaries)
    kept = [f"{name}_derivative" for name in record.kept_derivatives]
    for name in (*record.names_of_states, *record.names_of_signals, *kept):
        nodes = record.nodes(name)
        if isinstance(nodes, (StateNodes, StageNodes)):
            for time, variable in zip(nodes.times, nodes.variables(phase), strict=True):
                if time not in boundaries:
                    yield variable
