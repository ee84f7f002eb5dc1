"""`fingerprint`: by which a file knows what it is of, a team or the case of a sweep."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from types import MethodType
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError


def fingerprint(things: Iterable[Any]) -> str:
    """A number of what things hold, the same in every process and on every machine with the same version of Python.

    Parameters
    ----------
    things : iterable
        Numbers, texts, arrays, sequences, mappings, data frames, functions, classes and dataclasses of such. A function
        counts with its name, its defaults and what it closes over, a component of Pyomo with its name.

    Returns
    -------
    str
        64 hexadecimal digits (SHA-256).

    Raises
    ------
    ModelError
        When something has no such number, such as an open file.
    """
    return hashlib.sha256(repr(_plain(list(things))).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A value as something whose text says all of it, each kind with a mark of its own."""
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
        return value
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return "array", value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return {"mapping": [(_plain(key), _plain(item)) for key, item in value.items()]}
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return {"set": sorted(map(repr, value))}
    if isinstance(value, MethodType):
        return {"method": _plain([value.__func__, value.__self__])}
    if hasattr(value, "__qualname__"):
        defaults = getattr(value, "__defaults__", None)
        return {"name": f"{value.__module__}.{value.__qualname__}", "holds": _plain([defaults, *_closed_over(value)])}
    if hasattr(value, "func") and hasattr(value, "keywords"):
        return {"partial": _plain([value.func, value.args, value.keywords])}
    if hasattr(value, "name") and hasattr(value, "ctype"):
        return {"component": value.name}
    if hasattr(value, "to_dict") and hasattr(value, "to_numpy"):  # a data frame or a series
        return _plain(value.to_dict())
    if hasattr(value, "__dict__"):
        return {"object": type(value).__qualname__, "holds": _plain(vars(value))}
    raise ModelError(
        f"a {type(value).__name__} has no fingerprint, by which a file knows what it is of. Give numbers, texts, "
        "arrays, lists and mappings, or go without a file."
    )


def _closed_over(function: Any) -> Iterator[Any]:
    for cell in getattr(function, "__closure__", None) or ():
        with contextlib.suppress(ValueError):  # a name without a value yet
            yield cell.cell_contents
