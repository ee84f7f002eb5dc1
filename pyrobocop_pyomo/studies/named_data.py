"""What counts as data of a model that may change: mutable Params and fixed Vars."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var

from pyrobocop_pyomo.diagnosis.findings import quoted
from pyrobocop_pyomo.errors import ModelError


def data_members(component: Any) -> dict[Any, Any]:
    """The members, by index, of a component whose numbers are data: a mutable Param, or a Var.

    Raises
    ------
    ModelError
        If its numbers cannot change from outside.
    """
    kind = getattr(component, "ctype", None)
    name = getattr(component, "name", None) or repr(component)
    if kind is Param:
        if not component.parent_component().mutable:
            raise ModelError(f"'{name}': is not mutable, so expressions hold its number. Declare mutable=True.")
    elif kind is not Var:
        raise ModelError(f"'{name}': mutable Params and Vars hold data; this is a {type(component).__name__}.")
    if not component.is_indexed():
        return {None: component}
    # A Param with a default has a member for each index only once it is used.
    return {index: component[index] for index in (component.index_set() if kind is Param else component)}


def fixed_members(component: Any) -> list[Any]:
    """The members of a component whose numbers are data as the model stands: a mutable Param, or a fixed Var.

    Raises
    ------
    ModelError
        If its numbers cannot change from outside.
    """
    members = list(data_members(component).values())
    for member in members:
        if member.is_variable_type() and not member.fixed:
            raise ModelError(f"'{member.name}': is free, so it is part of the solution. Fix it, or use a Param.")
    return members


def member_values(component: Any, given: Any, label: str) -> list[tuple[Any, float]]:
    """Members of a component, and the numbers that they are to get.

    Parameters
    ----------
    component : Component
    given : number, array or mapping
        One for all members, one for each in their order, or some by index.
    label : str
        What gives them, for messages.

    Raises
    ------
    ModelError
        When it is none of these, or the component cannot change.
    """
    members, name = data_members(component), getattr(component, "name", None) or repr(component)
    if isinstance(given, Mapping):
        unknown = [index for index in given if index not in members]
        if unknown:
            raise ModelError(f"'{name}': has no index {unknown[0]!r}; it has {quoted(members)}.")
        return [(members[index], finite_number(each, f"{name}[{index}]", label)) for index, each in given.items()]
    if np.ndim(given) == 0:
        number = finite_number(given, name, label)
        return [(member, number) for member in members.values()]
    values = np.asarray(given, dtype=object).ravel()
    if values.size != len(members):
        raise ModelError(f"'{name}': {label} has {values.size} values for its {len(members)} members.")
    return [(of, finite_number(each, name, label)) for of, each in zip(members.values(), values.tolist(), strict=True)]


def finite_number(given: Any, name: str, label: str) -> float:
    """A number of a component that the user gave.

    Raises
    ------
    ModelError
        When it is no finite number.
    """
    try:
        number = float(given)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ModelError(f"'{name}': {label} gives it {given!r}; expected a finite number.")
    return number


def by_component(given: Any, model: Any) -> list[tuple[Any, Any]]:
    """Read what is said per component: a mapping from components or their names, or pairs of component and value.

    Pyomo's single Params cannot be keys of a plain dict, so names, pairs and a ComponentMap are the ways to write it.

    Raises
    ------
    ModelError
        If it is none of these, or a name is not in the model.
    """
    try:
        pairs = [(component, said) for component, said in (given.items() if isinstance(given, Mapping) else given)]
    except (TypeError, ValueError):
        raise ModelError(
            f"'{model.name}': expected a mapping such as {{'p': value}}, or pairs of a component and what is said of "
            "it, such as [(m.p, value)]."
        ) from None
    return [(named(component, model), said) for component, said in pairs]


def named(component: Any, model: Any) -> Any:
    """The component, found in the model where a name was given."""
    if not isinstance(component, str):
        return component
    found = model.find_component(component)
    if found is None:
        raise ModelError(f"'{model.name}': has no component '{component}'.")
    return found
