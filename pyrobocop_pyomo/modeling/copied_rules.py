"""Rules of a model that is copied: what they hold of the original becomes the copy's.

A rule may read the model through its first argument, and also through what surrounds it: a closure over ``m``, a
variable of the module, a default argument, the arguments of a ``functools.partial``, the object of a bound method. A
deep copy leaves functions alone, so that the copied model's rules would go on reading the original.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from types import CellType, CodeType, FunctionType, MethodType
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap, ComponentSet

# Where functions and objects that were copied stand in the memo of a deep copy, beside the identities of the rest.
_COPIED = "__pyrobocop_rules__"


def copied_rule(rule: Any, memo: dict[int, Any]) -> Any:
    """The rule for the copy of a model; the rule itself where it holds nothing of the original.

    Parameters
    ----------
    rule : callable
        Of the user.
    memo : dict
        Of the deep copy that is going on.
    """
    return _Copying(memo).of(rule)


class _Copying:
    """One deep copy; functions that several rules share, or that call themselves, are copied once."""

    def __init__(self, memo: dict[int, Any]) -> None:
        self._memo = memo
        # Kept in the memo, so that rules of one model which share a helper share its copy.
        shared: Any = memo.setdefault(_COPIED, {})  # type: ignore[call-overload]
        self._functions: dict[int, Any] = shared

    def of(self, held: Any) -> Any:
        """What stands in a rule, with everything of the model replaced by the copy's."""
        if isinstance(held, FunctionType):
            return self._function(held)
        if isinstance(held, MethodType):
            return self._method(held)
        if isinstance(held, functools.partial):
            function, arguments, keywords = self.of(held.func), self._items(held.args), self._items(held.keywords)
            same = function is held.func and arguments is held.args and keywords is held.keywords
            return held if same else functools.partial(function, *arguments, **keywords)
        if isinstance(held, (list, tuple, dict, set, frozenset)):
            return self._items(held)
        if isinstance(held, np.ndarray):
            return self._array(held)
        if _is_of_pyomo(held):
            return self._of_model(held)
        return self._object(held) if _may_hold_rules(held) else held

    def _of_model(self, held: Any) -> Any:
        """The copy's component; of another model, the very same."""
        if isinstance(held, (ComponentMap, ComponentSet)) or not hasattr(held, "parent_component"):
            return copy.deepcopy(held, self._memo)  # collections and expressions
        return self._memo.get(id(held), held)

    def _array(self, held: Any) -> Any:
        if held.dtype != object:
            return held
        copied = held.copy()
        for place, entry in np.ndenumerate(held):
            copied[place] = self.of(entry)
        return copied if any(new is not old for new, old in zip(copied.flat, held.flat, strict=True)) else held

    def _items(self, held: Any) -> Any:
        if isinstance(held, Mapping):
            if type(held) is not dict:
                return held
            pairs = [(key, entry, self.of(key), self.of(entry)) for key, entry in held.items()]
            same = all(new_key is key and new is entry for key, entry, new_key, new in pairs)
            return held if same else {new_key: new for _, _, new_key, new in pairs}
        entries = [self.of(entry) for entry in held]
        if all(new is old for new, old in zip(entries, held, strict=True)):
            return held
        if hasattr(held, "_fields"):  # a named tuple
            return type(held)(*entries)
        return type(held)(entries)

    def _function(self, function: FunctionType) -> Any:
        key = id(function)
        if key in self._functions:
            return self._functions[key][1]
        self._functions[key] = function, function  # one that calls itself meets itself below
        cells = function.__closure__ or ()
        contents = [cell_content(cell) for cell in cells]
        new_contents = [self.of(content) for content in contents]
        names = {name: function.__globals__[name] for name in _global_names(function.__code__, function.__globals__)}
        new_names = {name: self._of_global(held, function) for name, held in names.items()}
        defaults, keywords = self._items(function.__defaults__ or ()), self._items(function.__kwdefaults__ or {})
        attributes = self._items(function.__dict__)  # the function that a decorator wraps
        changed = {name: held for name, held in new_names.items() if held is not names[name]}
        same = all(new is old for new, old in zip(new_contents, contents, strict=True)) and not changed
        same &= defaults is (function.__defaults__ or defaults) and keywords is (function.__kwdefaults__ or keywords)
        if same and attributes is function.__dict__:
            return function
        namespace = _Names(function.__globals__, changed) if changed else function.__globals__
        closure = tuple(
            cell if new is old else CellType(new) for cell, new, old in zip(cells, new_contents, contents, strict=True)
        )
        copied = FunctionType(function.__code__, namespace, function.__name__, defaults or None, closure or None)
        copied.__kwdefaults__ = keywords or None
        copied.__qualname__, copied.__doc__, copied.__module__ = (
            function.__qualname__, function.__doc__, function.__module__,
        )  # fmt: skip
        copied.__dict__.update(attributes)
        self._functions[key] = function, copied
        return copied

    def _of_global(self, held: Any, function: FunctionType) -> Any:
        """What a module's name means in the copy: components, and helpers of the same module that read them."""
        if isinstance(held, FunctionType):
            return self.of(held) if held.__globals__ is function.__globals__ else held
        return self.of(held) if _may_hold_components(held) else held

    def _method(self, method: MethodType) -> Any:
        if isinstance(method.__self__, type):
            return method
        owner = self._object(method.__self__)
        return method if owner is method.__self__ else MethodType(method.__func__, owner)

    def _object(self, owner: Any) -> Any:
        """An object of the user's that holds something of the model: a shallow copy that holds the copy's."""
        if _is_of_pyomo(owner):
            return self._of_model(owner)
        if hasattr(type(owner), "__deepcopy__"):  # it knows what in it is of the model
            return copy.deepcopy(owner, self._memo)
        key = id(owner)
        if key in self._functions:
            return self._functions[key][1]
        attributes = getattr(owner, "__dict__", None)
        self._functions[key] = owner, owner
        if not attributes:
            return owner
        copied = {
            name: self.of(held) if _may_hold_components(held) or _is_written_down(held) else held
            for name, held in attributes.items()
        }
        if all(copied[name] is held for name, held in attributes.items()):
            return owner
        twin = copy.copy(owner)
        if twin is owner:  # it knows how to be copied, and says that it is not
            return owner
        twin.__dict__.update(copied)
        self._functions[key] = owner, twin
        return twin


class _Names(dict[str, Any]):
    """The names of a module, some of them with another meaning; the others as the module has them now."""

    def __init__(self, module: dict[str, Any], changed: Mapping[str, Any]) -> None:
        super().__init__(changed)
        # What the interpreter itself asks for must be there.
        self["__builtins__"] = module.get("__builtins__", __builtins__)
        self._module = module

    def __missing__(self, name: str) -> Any:
        return self._module[name]


def cell_content(cell: CellType) -> Any:
    """What a function holds in a cell of its closure; None before it is filled."""
    try:
        return cell.cell_contents
    except ValueError:  # not filled yet
        return None


def _global_names(code: CodeType, names: Mapping[str, Any]) -> Iterator[str]:
    """The names of a module that a function, or one within it, may read."""
    for name in code.co_names:
        if name in names:
            yield name
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _global_names(constant, names)


def _may_hold_components(held: Any) -> bool:
    return _is_of_pyomo(held) or isinstance(held, (list, tuple, dict, np.ndarray))


def _is_written_down(held: Any) -> bool:
    """True for functions, and for records of data, which may hold functions: a contact law has rules as fields."""
    return isinstance(held, FunctionType) or (is_dataclass(held) and not isinstance(held, type))


def _may_hold_rules(held: Any) -> bool:
    return (callable(held) or is_dataclass(held)) and not isinstance(held, type)


def _is_of_pyomo(held: Any) -> bool:
    """True for components, their data, blocks, expressions of them, and Pyomo's collections."""
    # Of its class, since a module that loads its names on demand would look for one that it lacks.
    cls = type(held)
    return cls is not type and (
        hasattr(cls, "ctype")
        or isinstance(held, (ComponentMap, ComponentSet))
        or (hasattr(cls, "is_expression_type") and bool(held.is_expression_type()))
    )
