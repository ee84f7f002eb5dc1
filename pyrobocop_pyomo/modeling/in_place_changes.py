"""Blocks that change in place, as a whole or not at all: their components stay, what these hold is replaced.

Whoever holds ``block.x``, or ``block.x[t]`` at an index that stays, goes on holding what the model has. On an error
everything is put back. When all is done, what refers to removed parts is told: suffixes let go of them.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Set
from pyomo.core.base.suffix import Suffix

from .activity import BLOCK_TYPES
from .blocks import snapshot_of
from .rows_by_rule import as_read, put_arguments

# What a component keeps when it is stated anew.
_PLACE = ("_parent", "_name", "_ctype", "doc")


class Content:
    """What a component held before it was changed.

    Parameters
    ----------
    component : Component

    Attributes
    ----------
    parts : dict of index to part
    """

    def __init__(self, component: Any) -> None:
        self.component, self._attributes = component, dict(component.__dict__)
        data = component.__dict__.get("_data")
        self.parts: dict[Any, Any] = dict(data) if type(data) is dict else {}
        named = self.parts if component.ctype is Expression else {}
        # All other parts are replaced by new ones.
        self._stated = {index: part.args for index, part in named.items()}
        self._members = list(component) if component.ctype is Set else None

    def put_back(self) -> None:
        """Let the component, and its parts, be what they were."""
        component = self.component
        component.__dict__.clear()
        component.__dict__.update(self._attributes)
        if self._members is not None:
            component.clear()
            component.update(self._members)
            return
        for index, part in self.parts.items() if component.is_indexed() else ():
            if component.ctype is Expression:
                put_arguments(part, self._stated[index])
            if hasattr(part, "_component") and not component.is_reference():
                part._component, part._index = weakref.ref(component), index
        if type(component.__dict__.get("_data")) is dict:
            component.__dict__["_data"] = self.parts

    def parts_now(self) -> dict[Any, Any]:
        """The parts that it has by now."""
        found: dict[Any, Any] = self.component.__dict__.get("_data") or {}
        return found


class InPlaceChanges:
    """A context in which blocks are changed; leaving it by an error takes every change back.

    Parameters
    ----------
    blocks : iterable of Block
        With what is in them now, but for the blocks that they contain.
    """

    def __init__(self, blocks: Iterable[Any]) -> None:
        self._blocks = [(block, set(block.component_map()), getattr(block, "_record", None)) for block in blocks]
        self._records = [(record, vars(snapshot_of(record))) for _, _, record in self._blocks if record is not None]
        self.contents = {
            id(component): Content(component)
            for block, _, _ in self._blocks
            for component in block.component_map().values()
            if component.ctype not in BLOCK_TYPES
        }

    def __enter__(self) -> InPlaceChanges:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self.take_back()

    def parts_before(self, component: Any) -> dict[Any, Any]:
        """The parts that a component held, by index; none of one that was added since."""
        return self.contents[id(component)].parts if id(component) in self.contents else {}

    def _lost(self) -> Iterator[tuple[Any, Any, Content]]:
        """Each part that no component has any more, with the index and the content that it had."""
        held = {id(part) for content in self.contents.values() for part in content.parts_now().values()}
        for content in self.contents.values():
            yield from ((part, index, content) for index, part in content.parts.items() if id(part) not in held)

    def lost_parts(self) -> dict[int, str]:
        """Names of the parts that no component has any more, by their identity."""
        return {id(part): f"{content.component.name}[{index}]" for part, index, content in self._lost()}

    def finish(self, model: Any) -> None:
        """Take leave of the parts that are gone: suffixes forget them, or have the value for what took their place."""
        parts = {id(part): (part, content.parts_now().get(index)) for part, index, content in self._lost()}
        for suffix in model.component_objects(Suffix, descend_into=Block):
            for part in [part for part in suffix if id(part) in parts]:
                number, (_, successor) = suffix.pop(part), parts[id(part)]
                if successor is not None:
                    suffix[successor] = number
        for part, _ in parts.values():
            part._component = None

    def take_back(self) -> None:
        """Let everything be what it was."""
        for block, names, _ in self._blocks:
            for name in [name for name in block.component_map() if name not in names]:
                block.del_component(name)
        for record, attributes in self._records:
            vars(record).update(attributes)
        for content in self.contents.values():
            content.put_back()


def state_anew(standing: Any, fresh: Any) -> Any:
    """Make a component what a new one of its kind, not yet on a model, is; its name and its place stay.

    Returns
    -------
    component
        The standing one, without parts but those that the construction of the new one makes.
    """
    standing.__dict__.update({name: held for name, held in fresh.__dict__.items() if name not in _PLACE})
    for anonymous in standing.__dict__.get("_anonymous_sets") or ():
        anonymous._parent = standing._parent
    standing.construct()
    return standing


def expressions_of(part: Any) -> list[Any]:
    """The expressions that a part of a component holds."""
    if hasattr(part, "args") and hasattr(part, "weight"):  # a pair of this package
        return list(part.args)
    part = as_read(part)
    return [] if getattr(part, "expr", None) is None else [part.expr]
