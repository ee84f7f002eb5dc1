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
        seen: set[int] = set()
        numbers = []
        for part in parts:
            component = part.parent_component()
            if id(component) not in seen:
                seen.add(id(component))
                self._add(component)
            numbers.append(self._group_of[id(part)])
        self.numbers: NDArray[np.intp] = np.array(numbers, dtype=np.intp)

    def group_of(self, part: Any) -> int | None:
        """The group of a part; None where its component was not given."""
        return self._group_of.get(id(part))

    def _add(self, component: Any) -> None:
        keys = {key: key if isinstance(key, tuple) else (key,) for key in component}
        times = {place for key in keys.values() for place, entry in enumerate(key) if isinstance(entry, float)}
        group_of_key: dict[tuple[Any, ...], int] = {}
        for key, entries in keys.items():
            kept = tuple(entry for place, entry in enumerate(entries) if place not in times and entry is not None)
            if kept not in group_of_key:
                group_of_key[kept] = len(self.names)
                self.names.append(component.name + (f"[{', '.join(map(str, kept))}]" if kept else ""))
                self.members.append([])
                self.components.append(component)
            data = component[key]
            self._group_of[id(data)] = group_of_key[kept]
            self.members[group_of_key[kept]].append(data)
