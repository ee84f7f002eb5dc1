"""Vectors and matrices of a phase: one declaration that stands for several, and what is given for all of them.

Each component is a declaration of its own under a name of its own, ``x_0``, ``x_1``; rules, guesses and results speak
of ``x``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.set import SetData

from pyrobocop_pyomo.errors import InitialGuessError, ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.time_index import point_of
from pyrobocop_pyomo.modeling.variable_families import FamilyNames, VariableFamily

from .declarations import Declaration, Parameter
from .record import PhaseRecord


class _Component:
    """One component of a function of time that returns all. A class, because it must survive pickling.

    Parameters
    ----------
    function : callable
    split : callable
        From what it returns to one for each component.
    position : int
    """

    def __init__(self, function: Callable[[float], Any], split: Callable[[Any], list[Any]], position: int) -> None:
        self._function, self._split, self._position = function, split, position

    def __call__(self, time: float) -> Any:
        return self._split(self._function(time))[self._position]


def _components(names: FamilyNames, function: Any, split: Callable[..., list[Any]], label: str) -> list[Any]:
    """The components of a function of time."""
    each = partial(split, names, label=label)
    return [_Component(function, each, position) for position in range(len(names.labels))]


def family_names(name: str, declaration: Declaration, label: str) -> FamilyNames:
    """What the components of a declaration with an index are called.

    Raises
    ------
    ModelError
        When the index is none, empty, or has a label twice.
    """
    index = declaration.index
    where = f"{label} (declared at {declaration.declared_at})"
    try:
        axes = _axes(index)
    except TypeError:
        raise ModelError(
            f"{where}: index = {index!r}; expected a number of components, labels, a Set, or a list of several of "
            "these."
        ) from None
    for axis in axes:
        if not axis or len(set(axis)) != len(axis):
            raise ModelError(f"{where}: the labels {list(axis)} of its index are none, or not all different.")
    names = FamilyNames(name, axes, in_time=not isinstance(declaration, Parameter))
    if len(set(names.members)) != len(names.members):
        raise ModelError(
            f"{where}: two of its components would have the same name, as '_' joins labels. Choose other labels."
        )
    return names


def _axes(index: Any) -> tuple[tuple[Any, ...], ...]:
    if isinstance(index, (int, np.integer)) and not isinstance(index, bool):
        return (tuple(range(int(index))),)
    if isinstance(index, str):
        raise TypeError
    entries = list(index)
    if entries and all(isinstance(entry, (range, list, SetData, np.ndarray)) for entry in entries):
        return tuple(tuple(_plain(label) for label in entry) for entry in entries)
    return _axes_of_labels([_plain(entry) for entry in entries])


def _axes_of_labels(labels: list[Any]) -> tuple[tuple[Any, ...], ...]:
    """Labels of several dimensions are a matrix where they are all of a product, row by row."""
    if labels and all(isinstance(label, tuple) for label in labels) and len({len(label) for label in labels}) == 1:
        axes = tuple(tuple(dict.fromkeys(label[k] for label in labels)) for k in range(len(labels[0])))
        if FamilyNames("", axes).labels == labels:
            return axes
    return (tuple(labels),)


def _plain(label: Any) -> Any:
    return label.item() if isinstance(label, np.generic) else label


# -------------------------------------------------------------------- declarations


def component_declarations(names: FamilyNames, declaration: Declaration, what: str) -> list[tuple[str, Declaration]]:
    """Names and declarations of the components.

    Raises
    ------
    ModelError, InitialGuessError
        When what is given has another length than the index.
    """
    where = f"{what} (declared at {declaration.declared_at})"
    each = {
        name: split(names, getattr(declaration, name), f"{where}: its {name.replace('_', ' ')}")
        for name, split in _SPLIT_BY.items()
        if hasattr(declaration, name)
    }
    return [
        (member, replace(declaration, index=None, **{name: entries[i] for name, entries in each.items()}))
        for i, member in enumerate(names.members)
    ]


def _split(names: FamilyNames, given: Any, label: str, error: type[PyRobocopError] = ModelError) -> list[Any]:
    """One for each: as given in an array, a list or a mapping; the same for all otherwise."""
    if isinstance(given, IndexedComponent) and given.is_indexed():
        given = dict(given.items())
    if _is_listed(given):
        entries = names.split(given)
        if entries is None:
            raise _wrong_length(error, label, given, names)
        return list(map(_plain, entries))
    if callable(given) and not hasattr(given, "is_expression_type"):  # units can be called as well
        return _components(names, given, _split, label)
    return [given] * len(names.labels)


def _is_listed(given: Any) -> bool:
    return isinstance(given, (list, tuple, Mapping)) or (isinstance(given, np.ndarray) and given.ndim > 0)


def _split_ends(names: FamilyNames, given: Any, label: str) -> list[Any]:
    if isinstance(given, tuple) and len(given) == 2 and not any(isinstance(end, (tuple, list)) for end in given):
        if len(names.labels) == 2:
            raise ModelError(
                f"{label} value is {given}: an interval for both components, or one number for each? Write a list for "
                "one number each, or a list of two tuples for intervals."
            )
        return [given] * len(names.labels)
    return [tuple(end) if isinstance(end, list) else end for end in _split(names, given, f"{label} value")]


def _split_bounds(names: FamilyNames, given: Any, label: str) -> list[Any]:
    """A pair for all, a pair of arrays, or an array or a mapping of pairs."""
    if given is None:
        return [None] * len(names.labels)
    if callable(given):
        return _components(names, given, _split_bounds, label)
    is_of_sides = isinstance(given, tuple) and len(given) == 2
    if is_of_sides and not all(_is_pair(entry) and isinstance(entry, tuple) for entry in given):
        return list(zip(*(_split(names, side, label) for side in given), strict=True))
    listed = given.tolist() if isinstance(given, np.ndarray) else given
    found = names.split(listed) if _is_listed(listed) else None
    if found is None or not all(entry is None or _is_pair(entry) for entry in found):
        raise _wrong_length(ModelError, label, given, names, "pairs (lower, upper), or one for all")
    return [None if entry is None else tuple(entry) for entry in found]


def _is_pair(entry: Any) -> bool:
    return (
        isinstance(entry, (tuple, list, np.ndarray))
        and len(entry) == 2
        and not any(isinstance(side, (tuple, list, np.ndarray)) for side in entry)
    )


def _split_guess(names: FamilyNames, given: Any, label: str) -> list[Any]:
    """One number each, an array over time each (components first or last), or a function of time."""
    if not isinstance(given, (list, tuple, np.ndarray)):
        return _split(names, given, label, InitialGuessError)
    try:
        numbers = np.array(given, dtype=float)
    except (TypeError, ValueError):
        return _split(names, list(given), label, InitialGuessError)  # functions, or arrays of different lengths
    dimensions = len(names.shape)
    if numbers.shape[:dimensions] != names.shape:
        if numbers.ndim != dimensions + 1 or numbers.shape[1:] != names.shape:
            raise _wrong_length(InitialGuessError, label, given, names)
        numbers = np.moveaxis(numbers, 0, -1)
    each = numbers.reshape(len(names.labels), *numbers.shape[dimensions:])
    return each.tolist() if each.ndim == 1 else list(each)


_SPLIT_BY: dict[str, Callable[[FamilyNames, Any, str], list[Any]]] = {
    **dict.fromkeys(("bounds", "derivative_bounds", "rate_bounds"), _split_bounds),
    **dict.fromkeys(("initial", "final"), _split_ends),
    **dict.fromkeys(("units", "history"), _split),
    "initial_guess": _split_guess,
}


def _wrong_length(
    error: type[PyRobocopError], label: str, given: Any, names: FamilyNames, expected: str = "entries, or one for all"
) -> PyRobocopError:
    if isinstance(given, Mapping):
        has = f"the labels {', '.join(map(str, given))}"
    else:
        has = f"shape {np.array(given, dtype=object).shape}"
    return error(
        f"{label}: has {has}, but '{names.name}' has the labels {', '.join(map(str, names.labels))} (shape "
        f"{names.shape}). Give {len(names.labels)} {expected}."
    )


# -------------------------------------------------------------------- what rules and users give


def name_of(given: Any) -> str:
    """A name given as such, or by what has it."""
    return given if isinstance(given, str) else getattr(given, "local_name", None) or repr(given)


def family_in(record: PhaseRecord, key: Any) -> FamilyNames | None:
    """The family that a key means, by its name or itself."""
    if isinstance(key, VariableFamily):
        return key.names
    return record.families.get(key) if isinstance(key, str) else None


def _by_component(
    record: PhaseRecord, given: Mapping[Any, Any], split: Callable[[FamilyNames, Any], list[Any]]
) -> dict[Any, Any]:
    """What is given by name, with an entry for each component in the place of a family."""
    found: dict[Any, Any] = {}
    for key, of in given.items():
        names = family_in(record, key)
        found.update({key: of} if names is None else zip(names.members, split(names, of), strict=True))
    return found


def equations_by_component(record: PhaseRecord, result: Mapping[Any, Any], what: str) -> dict[Any, Any]:
    """What a rule gives for states, with an entry for each component where it gives an array for a family.

    Raises
    ------
    ModelError
        When the array has another length.
    """

    def entries_of(names: FamilyNames, given: Any) -> list[Any]:
        entries = names.split(given) if _is_listed(given) else None
        if entries is None:
            listed = given if _is_listed(given) else 0.0
            raise _wrong_length(ModelError, f"{what}: what it gives for '{names.name}'", listed, names, "entries")
        return entries

    return _by_component(record, result, entries_of)


def guesses_by_component(record: PhaseRecord, guesses: Mapping[Any, Any], what: str) -> dict[Any, Any]:
    """Guesses by name, with one for each component where one is given for a family.

    Raises
    ------
    InitialGuessError
        When it has another length.
    """

    def guesses_of(names: FamilyNames, given: Any) -> list[Any]:
        return _split_guess(names, given, f"{what}: what is given for '{names.name}'")

    return _by_component(record, guesses, guesses_of)


def names_by_component(record: PhaseRecord, given: Iterable[Any]) -> list[Any]:
    """Names and variables, with those of all components in the place of a family."""
    found: list[Any] = []
    for key in given:
        names = family_in(record, key)
        found.extend([key] if names is None else names.members)
    return found


@dataclass(frozen=True)
class OneOf:
    """Rule of a path constraint: the components of a vector of controls sum to 1, once in each element.

    Attributes
    ----------
    name : str
        Of the vector. A class, because it must survive pickling.
    """

    name: str
    skips_points: ClassVar[bool] = True

    def __call__(self, b: Any, t: Any) -> Any:
        """The row at a time index."""
        record = getattr(b, "record", None)
        t = point_of(t)
        given = isinstance(t, (int, float))  # or a variable that stands for all times
        if given and record is not None and all(times[0] != t for times in record.grid.stage_times):
            return Constraint.Skip  # the same values again
        return sum(entry.expression for entry in getattr(b, self.name)[t].ravel()) == 1
