"""Parts of components that belong together: all values over time of one quantity."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


class ComponentGroups:
    """Variables or constraints by what they are values of.

    Parts of an indexed component are one group where their indices differ only in times: in places at which the
    component has an index that is no whole number and no word.

    Parameters
    ----------
    parts : iterable of component data
        All parts of their components are looked at, also those that are not among them.

    Attributes
    ----------
    numbers : int array, shape (parts,)
        The group of each part.
    names : list of str
        A component's name, with what is left of the index: ``"arm.q[2]"``.
    members : list of list of component data
        All parts of each group.
    components : list of component
        The component of each group.
    """

    def __init__(self, parts: Iterable[Any]) -> None:
        self.names: list[str] = []
        self.members: list[list[Any]] = []
        self.components: list[Any] = []
        self._group_of: dict[int, int] = {}
        self._groups_of_component: dict[int, list[int]] = {}
        numbers = []
        for part in parts:
            if id(part) not in self._group_of:
                self._add(part.parent_component())
            numbers.append(self._group_of[id(part)])
        self.numbers: NDArray[np.intp] = np.array(numbers, dtype=np.intp)

    def groups_of(self, component: Any) -> list[int]:
        """The groups of a component's parts; none where none of them was given."""
        return self._groups_of_component.get(id(component), [])

    def _add(self, component: Any) -> None:
        first = len(self.names)
        keys = {key: key if isinstance(key, tuple) else (key,) for key in component}
        times = {place for key in keys.values() for place, entry in enumerate(key) if isinstance(entry, float)}
        group_of_key: dict[tuple[Any, ...], int] = {}
        for key, entries in keys.items():
            kept = tuple(entry for place, entry in enumerate(entries) if place not in times and entry is not None)
            if kept not in group_of_key:
                group_of_key[kept] = len(self.names)
                self._begin(component, kept)
            data = component[key]
            self._group_of[id(data)] = group_of_key[kept]
            self.members[group_of_key[kept]].append(data)
        self._groups_of_component[id(component)] = list(range(first, len(self.names)))

    def _begin(self, component: Any, kept: tuple[Any, ...]) -> None:
        self.names.append(component.name + (f"[{', '.join(map(str, kept))}]" if kept else ""))
        self.members.append([])
        self.components.append(component)
