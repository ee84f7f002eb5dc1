"""Several variables under one name: vectors and matrices of states, controls and parameters.

A family is no component. Its members are, each under a name of its own, and everything that knows single variables
knows them. `VariableFamily` is how a rule reads them: ``b.x[t]`` is an array, ``b.x[i, t]`` a member at a time. Its
home may be a block or a proxy of one; so rules are evaluated between the points of a grid like any other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from pyrobocop_pyomo.errors import ModelError

from .expression_arrays import ExpressionArray, array

_ALL = slice(None)


@dataclass(frozen=True)
class FamilyNames:
    """What the members of a family are called.

    Attributes
    ----------
    name : str
    axes : tuple of tuple of labels
        One per dimension of the array. Labels of several dimensions that are no product are tuples on one axis.
    in_time : bool
        Whether members are indexed by time.
    """

    name: str
    axes: tuple[tuple[Any, ...], ...]
    in_time: bool = True

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the array that the members make."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def labels(self) -> list[Any]:
        """Label of each member, row by row."""
        if len(self.axes) == 1:
            return list(self.axes[0])
        return list(product(*self.axes))

    @property
    def members(self) -> list[str]:
        """Name of each member's component, row by row."""
        return [self.member(label) for label in self.labels]

    def member(self, label: Any) -> str:
        """Name of the component behind a label."""
        return "_".join([self.name, *map(str, label if isinstance(label, tuple) else (label,))])

    def split(self, given: Any) -> list[Any] | None:
        """A value for each member, row by row; None where the lengths do not fit.

        Parameters
        ----------
        given : mapping of label to value, or array-like
            Of the shape of the family, or with as many entries.
        """
        if isinstance(given, Mapping):
            if set(given) != set(self.labels):
                return None
            return [given[label] for label in self.labels]
        is_array = isinstance(given, np.ndarray)
        entries = list(given.ravel()) if is_array else _flat(given, len(self.shape))
        if len(entries) != len(self.labels) or (is_array and given.ndim > 1 and given.shape != self.shape):
            return None
        return entries


def _flat(given: Any, dimensions: int) -> list[Any]:
    entries = list(given)
    for _ in range(dimensions - 1):
        if not all(isinstance(entry, (list, tuple, np.ndarray)) for entry in entries):
            break
        entries = [inner for entry in entries for inner in entry]
    return entries


def _on_each_member(name: str, meaning: str) -> Any:
    """A method that calls that of each member."""

    def apply(self: VariableFamily, *arguments: Any, **options: Any) -> None:
        for member in self.members:
            getattr(member, name)(*arguments, **options)

    apply.__name__, apply.__doc__ = name, meaning
    return apply


class VariableFamily(NDArrayOperatorsMixin):
    """Members of a family as a rule reads them.

    Parameters
    ----------
    home : block or proxy of one
        Where the members are.
    names : FamilyNames
    read : callable, optional
        What is meant of each member, such as its derivative; the member itself by default.

    Raises
    ------
    ModelError
        When it is read at an index that it does not have, or used without ``[t]``.
    """

    def __init__(self, home: Any, names: FamilyNames, read: Callable[[Any], Any] | None = None) -> None:
        self._home, self.names, self._read = home, names, read

    @property
    def name(self) -> str:
        """With the name of the home."""
        return f"{getattr(self._home, 'name', '')}.{self.names.name}"

    @property
    def local_name(self) -> str:
        """As it was declared."""
        return self.names.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Of ``b.x[t]``."""
        return self.names.shape

    @property
    def members(self) -> list[Any]:
        """The components, row by row."""
        found = [getattr(self._home, name) for name in self.names.members]
        return found if self._read is None else [self._read(member) for member in found]

    def parent_block(self) -> Any:
        """The home."""
        return self._home

    def of_each(self, read: Callable[[Any], Any]) -> VariableFamily:
        """Something of each member, such as its derivative."""
        return VariableFamily(self._home, self.names, read)

    def array_of(self, read: Callable[[Any], Any]) -> ExpressionArray:
        """What is required of each member, as an array."""
        return self._array(self._places(()), read)

    # ---------------------------------------------------------------- reading

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        labels, time = (keys[:-1], keys[-1]) if self.names.in_time else (keys, None)
        places = self._places(labels)
        read = (lambda member: member[time]) if self.names.in_time else (lambda member: member)
        try:
            return self._array(places, read) if np.ndim(places) else read(self.members[places])
        except KeyError:
            if not self.names.in_time or key not in self.names.labels:
                raise
        place = self._places(keys)
        if not np.ndim(place) and not any(isinstance(label, (int, float)) for label in keys):
            return self.members[place]  # names are no times: b.x["left"] is the component, b.x["left"][t] its value
        member = self.names.member(key)
        raise ModelError(
            f"'{self.name}' is read at [{key}], which is no time of the phase but a label. A component has a name of "
            f"its own: '{member}', as in b.{member}.at_end; at a time it is b.{self.names.name}[{key}, t]."
        )

    def _places(self, labels: tuple[Any, ...]) -> Any:
        """The place of one member, row by row, or an array of places."""
        axes = self.names.axes
        if len(axes) == 1 and len(labels) > 1:
            labels = (labels,)  # labels of several dimensions that are no product
        if len(labels) > len(axes):
            raise ModelError(self._wrong_index(labels))
        positions: list[Any] = []
        for label, axis in zip(labels, axes, strict=False):
            if isinstance(label, slice):
                positions.append(label)
            elif label in axis:
                positions.append(axis.index(label))
            else:
                raise ModelError(self._wrong_index(labels))
        return np.arange(len(self.names.labels)).reshape(self.shape)[tuple(positions)]

    def _wrong_index(self, labels: tuple[Any, ...]) -> str:
        asked = ", ".join(":" if label == _ALL else str(label) for label in labels)
        axes = " and ".join(_listed(axis) for axis in self.names.axes)
        after = ", t" if self.names.in_time else ""
        return (
            f"'{self.name}' is read at [{asked}{after}]; its labels are {axes}. "
            f"{self.names.name}[t] is all of it at a time."
            if self.names.in_time
            else f"'{self.name}' is read at [{asked}]; its labels are {axes}."
        )

    def _array(self, places: Any, read: Callable[[Any], Any]) -> ExpressionArray:
        held, members = np.empty(places.shape, dtype=object), self.members
        for position, place in np.ndenumerate(places):
            held[position] = read(members[place])
        return array(held)

    def delayed(self, t: Any, delay: Any) -> ExpressionArray:
        """Every member at an earlier time; see `SignalVar.delayed`."""
        return self.array_of(lambda member: member.delayed(t, delay))

    def at(self, time: float) -> ExpressionArray:
        """Every member at a fixed time; see `SignalVar.at`."""
        return self.array_of(lambda member: member.at(time))

    @property
    def at_start(self) -> ExpressionArray:
        """Every member at the start of the phase."""
        return self.array_of(lambda member: member.at_start)

    @property
    def at_end(self) -> ExpressionArray:
        """Every member at the end of the phase."""
        return self.array_of(lambda member: member.at_end)

    # ---------------------------------------------------------------- all variables alike

    fix = _on_each_member("fix", "Fix every variable, at its own value or at one for all.")
    unfix = _on_each_member("unfix", "Let every variable move again.")
    setlb = _on_each_member("setlb", "Set the lower bound of every variable.")
    setub = _on_each_member("setub", "Set the upper bound of every variable.")
    pprint = _on_each_member("pprint", "Show every component, as Pyomo does.")
    display = _on_each_member("display", "Show the values of every component, as Pyomo does.")

    # ---------------------------------------------------------------- as a collection, and as an array

    def keys(self) -> list[Any]:
        """Indices of all variables: labels and time, or labels."""
        if not self.names.in_time:
            return self.names.labels
        pairs = zip(self.names.labels, self.members, strict=True)
        return [
            (*(label if isinstance(label, tuple) else (label,)), time) for label, member in pairs for time in member
        ]

    def values(self) -> list[Any]:
        """All variables."""
        if not self.names.in_time:
            return self.members
        return [variable for member in self.members for variable in member.values()]

    def items(self) -> list[tuple[Any, Any]]:
        """Indices and variables."""
        return list(zip(self.keys(), self.values(), strict=True))

    def __iter__(self) -> Iterator[Any]:
        return iter(self.keys() if self.names.in_time else self.members)

    def __len__(self) -> int:
        return len(self.keys())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, VariableFamily) and self._home is other._home and self.names == other.names

    def __hash__(self) -> int:  # rules use what they read as keys: ``{b.x: A @ b.x[t]}``
        return hash((id(self._home), self.names.name))

    def __str__(self) -> str:
        return self.name

    __repr__ = __str__

    def as_expression_array(self) -> ExpressionArray:
        """A family without time as an array.

        Raises
        ------
        ModelError
            When its members change in time.
        """
        if self.names.in_time:
            raise ModelError(
                f"'{self.name}' is computed with as it is, but it changes in time. Is an index [t] missing?"
            )
        return self.array_of(lambda member: member)

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.asarray(self.as_expression_array())

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = [each.as_expression_array() if isinstance(each, VariableFamily) else each for each in inputs]
        return getattr(ufunc, method)(*arrays, **options)


def _listed(axis: tuple[Any, ...], shown: int = 6) -> str:
    labels = [str(label) for label in axis]
    return ", ".join(labels if len(labels) <= shown else [*labels[: shown - 1], "...", labels[-1]])
