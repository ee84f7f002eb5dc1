"""Components that change in place, as a whole or not at all: the objects stay, what they hold is replaced.

Whoever holds ``block.x``, or ``block.x[t]`` at an index that stays, goes on holding what the model has. On an error
everything is taken back. When all is done, what refers to removed parts is told: suffixes let go of them.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.set import Set
from pyomo.core.base.suffix import Suffix

from .activity import BLOCK_TYPES
from .blocks import snapshot_of
from .rows_on_read import as_read, is_unread

# What a component keeps when it is stated anew.
_PLACE = ("_parent", "_name", "_ctype", "doc")


@dataclass
class _State:
    """What a component held before it was changed."""

    component: Any
    attributes: dict[str, Any]
    parts: dict[Any, Any]
    members: list[Any] | None
    contents: list[tuple[Any, Any]]


class InPlaceChanges:
    """A context in which components are changed; leaving it by an error takes every change back."""

    def __init__(self) -> None:
        self._states: dict[int, _State] = {}
        self._undone_by: list[Callable[[], None]] = []

    def __enter__(self) -> InPlaceChanges:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self.take_back()

    # ---------------------------------------------------------------- what may change

    def on_error(self, undo: Callable[[], None]) -> None:
        """Call a function when everything is taken back; the last one first."""
        self._undone_by.append(undo)

    def protect(self, component: Any) -> None:
        """Remember what a component holds now, before it is changed."""
        if id(component) in self._states:
            return
        data = component.__dict__.get("_data")
        parts = dict(data) if type(data) is dict else {}
        contents: list[tuple[Any, Any]] = []
        if component.ctype is Expression:
            contents = [(part, part._args_) for part in parts.values() if not is_unread(part)]
        elif component.ctype is Param and component.mutable:
            contents = [(part, part._value) for part in parts.values()]
        members = list(component) if component.ctype is Set else None
        self._states[id(component)] = _State(component, dict(component.__dict__), parts, members, contents)

    def protect_block(self, block: Any) -> None:
        """Remember everything that a block holds; components that are added later leave it again on an error."""
        names = set(block.component_map())
        for component in block.component_map().values():
            if component.ctype not in BLOCK_TYPES:
                self.protect(component)

        def remove_additions() -> None:
            for name in [name for name in block.component_map() if name not in names]:
                block.del_component(name)

        self.on_error(remove_additions)

    def protect_record(self, record: Any) -> None:
        """Remember the attributes of an object, with the contents of its dicts, lists and sets."""
        before = vars(snapshot_of(record))

        def put_back() -> None:
            for name, held in before.items():
                setattr(record, name, held)

        self.on_error(put_back)

    def restate(self, standing: Any, fresh: Any) -> Any:
        """Make a component what a new one of its kind, not yet on a model, is; its name and its place stay.

        Returns
        -------
        component
            The standing one, without parts but those that the construction of the new one makes.
        """
        self.protect(standing)
        standing.__dict__.update({name: held for name, held in fresh.__dict__.items() if name not in _PLACE})
        for anonymous in standing.__dict__.get("_anonymous_sets") or ():
            anonymous._parent = standing._parent
        standing.construct()
        return standing

    def set_members(self, members_of: Any, members: list[Any]) -> None:
        """Give a set other members."""
        self.protect(members_of)
        members_of.clear()
        members_of.update(members)

    def put_back(self, component: Any, index: Any, part: Any) -> None:
        """Let a component have a part that it had before, perhaps under another index."""
        component._data[index] = part
        if part._index != index:
            before = part._index
            self.on_error(lambda: setattr(part, "_index", before))
            part._index = index

    def put_back_expressions(self, component: Any) -> None:
        """Let an expression keep the members that it had before, at the indices that stay, with their new contents."""
        before = self._states[id(component)].parts
        for index, member in list(component._data.items()):
            if index in before:
                before[index].set_value(member.expr)
                component._data[index] = before[index]

    def parts_before(self, component: Any) -> dict[Any, Any]:
        """The parts of a component before it was changed, by index."""
        return self._states[id(component)].parts

    def has_changed(self, component: Any) -> bool:
        """True for a component that was protected, hence stated anew."""
        return id(component) in self._states

    # ---------------------------------------------------------------- what has changed

    def rewritten(self) -> Iterator[tuple[Any, Any, list[Any], list[Any]]]:
        """Component and index of what holds expressions, with these before it was stated anew and now.

        Components that were empty before are left out: what they had was taken off for a while.
        """
        for state in self._states.values():
            component = state.component
            if component.ctype is Expression:
                yield from ((component, part._index, list(held), list(part._args_)) for part, held in state.contents)
                continue
            before = {index: held for index, part in state.parts.items() if (held := _expressions_of(part))}
            now = {part._index: held for part, held in expressions_in(component, unread=True)}
            is_as_stated = {index for index, part in state.parts.items() if is_unread(part)}
            for index in (before | now) if state.parts else ():
                if index not in is_as_stated:
                    yield component, index, before.get(index, []), now.get(index, [])

    def lost_parts(self) -> dict[int, Any]:
        """Parts that no component has any more, by their identity."""
        held = {id(part) for state in self._states.values() for part in state.component._data.values()}
        return {
            id(part): part for state in self._states.values() for part in state.parts.values() if id(part) not in held
        }

    def finish(self, model: Any) -> None:
        """Take leave of the parts that are gone: suffixes forget them, or have the value for what took their place."""
        successors: dict[int, Any] = {}
        lost = self.lost_parts()
        for state in self._states.values():
            for index, part in state.parts.items():
                if id(part) in lost:
                    successors[id(part)] = state.component._data.get(index)
        for suffix in model.component_objects(Suffix, descend_into=Block):
            for part in [part for part in suffix if id(part) in lost]:
                number, successor = suffix.pop(part), successors.get(id(part))
                if successor is not None:
                    suffix[successor] = number
        for part in lost.values():
            part._component = None
        self._states.clear()
        self._undone_by.clear()

    def take_back(self) -> None:
        """Let everything be what it was."""
        for undo in reversed(self._undone_by):
            undo()
        for state in self._states.values():
            component = state.component
            component.__dict__.clear()
            component.__dict__.update(state.attributes)
            if state.members is not None:
                component.clear()
                component.update(state.members)
                continue
            if type(state.attributes.get("_data")) is dict:
                component._data = state.parts
            for part in state.parts.values():
                if part is not component:
                    part._component = weakref.ref(component)
            for part, held in state.contents:
                setattr(part, "_value" if component.ctype is Param else "_args_", held)


def expressions_in(component: Any, unread: bool = False) -> Iterator[tuple[Any, list[Any]]]:
    """Parts of a component that hold expressions, each with these; `unread`: rows that nobody has read as well."""
    for part in component.values():
        if held := _expressions_of(as_read(part) if unread else part):
            yield part, held


def _expressions_of(part: Any) -> list[Any]:
    if hasattr(part, "args") and hasattr(part, "weight"):  # a pair of this package
        return list(part.args)
    if is_unread(part):
        return []
    return [] if getattr(part, "expr", None) is None else [part.expr]
