"""What a rule reads, named by components: data, which a copy or a pickle of the model has its own of."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from pyrobocop_pyomo.errors import PyRobocopError


class Place(NamedTuple):
    """Where on a model a rule is evaluated.

    Attributes
    ----------
    block : Block
    t : object
        As the rule would get it.
    more : tuple
        What else it would get.
    """

    block: Any
    t: Any
    more: tuple[Any, ...] = ()


@dataclass(frozen=True, eq=False)
class Slot:
    """One thing that a rule reads; equal for equal readings of one component.

    Attributes
    ----------
    component : component, block or None
    rest : tuple
        What else says which of its values is meant.
    """

    component: Any
    rest: tuple[Hashable, ...] = ()

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other.component is self.component and other.rest == self.rest

    def __hash__(self) -> int:
        return hash((type(self), id(self.component), self.rest))

    def on_model(self, place: Place) -> Any:
        """What stands there on the model itself."""
        raise NotImplementedError

    def at_all(self, block: Any, times: list[Any]) -> list[Any]:
        """What stands there at many times."""
        return [self.on_model(Place(block, time)) for time in times]


class Always(Slot):
    """A variable, a parameter or a named expression without ``t``."""

    def on_model(self, place: Place) -> Any:
        """Itself."""
        return self.component


class Time(Slot):
    """The time ``t`` in a formula; its component is None."""

    def on_model(self, place: Place) -> Any:
        """The time that the index stands for, where indices are no times."""
        return place.block.time_at(place.t) if is_on_indices(place.block) else place.t


class Item(Slot):
    """``component[..., t, ...]``; `rest` are the indices, None in the place of ``t``."""

    def on_model(self, place: Place) -> Any:
        """The item."""
        return self.component[self.key_at(place.t)]

    def at_all(self, block: Any, times: list[Any]) -> list[Any]:
        """The items, from one look at the component."""
        items = dict(self.component.items())
        return [items[key] for key in (times if len(self.rest) == 1 else map(self.key_at, times))]

    @property
    def name(self) -> str:
        """As the user writes it: ``push.x[t]``."""
        return f"{self.component.name}[{', '.join('t' if key is None else str(key) for key in self.rest)}]"

    def key_at(self, time: Any) -> Any:
        """The index of the component at a time."""
        return time if len(self.rest) == 1 else tuple([time if key is None else key for key in self.rest])


# Expressions of the items of components that were found to be what the rule says: they do not change.
_COMPARED: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class NamedItem(Item):
    """An item of an indexed Expression, which has a rule of its own.

    Attributes
    ----------
    rule : Template
    """

    rule: Any = None

    def formulas(self, error: type[PyRobocopError]) -> Any:
        """What its rule says for all times, after all items were compared with it: ask once where many are evaluated.

        Raises
        ------
        PyRobocopError
            Of that type, when the rule is no template, or an item was given another value since.
        """
        block = self.component.parent_block()
        formulas = self.rule.formulas(block)
        if formulas is None:
            raise error(
                f"the rule of '{self.component.name}' has to know the time as a number, and was asked at the points of "
                "the model: what it says between them is not known."
            )
        compared = _COMPARED.setdefault(self.component, {})
        for index, data in self.component.items():
            if compared.get(index, self) is data.expr:
                continue
            parts = index if isinstance(index, tuple) else (index,)
            if any(key not in (None, part) for key, part in zip(self.rest, parts, strict=True)):
                continue
            stated = formulas.on_model(Place(block, parts[self.rest.index(None)]))
            if not formulas.says(stated, data.expr):
                raise error(
                    f"'{data.name}' is '{data.expr}', but its rule said '{stated}': it was given another value since, "
                    "and nothing says what it is between the points. State it by a rule alone."
                )
            compared[index] = data.expr
        return formulas


class Derivative(Slot):
    """``phase.derivative(state)[t]``."""

    def on_model(self, place: Place) -> Any:
        """The right-hand side, or the variable that stands for the derivative."""
        return self.component.parent_block().derivative(self.component.local_name)[place.t]


class RateOf(Slot):
    """``phase.rate_of(control)[t]``; its component is the phase, `rest` the name of the control."""

    def on_model(self, place: Place) -> Any:
        """The difference of values on the grid."""
        return self.component.rate_of(self.rest[0])[place.t]


class Clock(Slot):
    """``phase.time_at(t)``; its component is the phase."""

    def on_model(self, place: Place) -> Any:
        """The time of the index."""
        return self.component.time_at(place.t)


def is_on_indices(block: Any) -> bool:
    """Whether ``t`` is an index on a block, because the time is to be found."""
    return getattr(getattr(block, "record", None), "normalised", False) is True
