"""What counts as data of a model that may change: mutable Params and fixed Vars."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pyomo.core.base.param import Param
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError


def data_members(component: Any) -> list[Any]:
    """The members of a component that holds data, or the component itself where it is one member.

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
        raise ModelError(f"{name}: expected a mutable Param or a fixed Var, found {type(component).__name__}.")
    members = list(component.values()) if component.is_indexed() else [component]
    for member in members:
        if kind is Var and not member.fixed:
            raise ModelError(f"'{member.name}': is free, so it is part of the solution. Fix it, or use a Param.")
    return members


def by_component(given: Any, model: Any) -> list[tuple[Any, Any]]:
    """Read what is said per component: a mapping from components or their names, or pairs of component and value.

    Pyomo's single Params cannot be keys of a plain dict, so names, pairs and a ComponentMap are the ways to write it.

    Raises
    ------
    ModelError
        If it is none of these, or a name is not in the model.
    """
    pairs: list[tuple[Any, ...]]
    if isinstance(given, Mapping):
        pairs = list(given.items())
    elif isinstance(given, Iterable) and not isinstance(given, str):
        pairs = [tuple(item) if isinstance(item, (tuple, list)) else (item,) for item in given]
    else:
        pairs = [(given,)]
    if any(len(pair) != 2 for pair in pairs):
        raise ModelError(
            f"'{model.name}': expected a mapping such as {{'p': value}}, or pairs of a component and what is said of "
            "it, such as [(m.p, value)]."
        )
    return [(named(component, model), said) for component, said in pairs]


def named(component: Any, model: Any) -> Any:
    """The component, found in the model where a name was given."""
    if not isinstance(component, str):
        return component
    found = model.find_component(component)
    if found is None:
        raise ModelError(f"'{model.name}': has no component '{component}'.")
    return found
