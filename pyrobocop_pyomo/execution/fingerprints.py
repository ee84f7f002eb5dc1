"""`fingerprint`: by which a file knows what it is of, a team or the case of a sweep."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
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
    digest = hashlib.sha256()
    for part in _all_parts(things):
        digest.update(f"{len(part)}:".encode())
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """A value as sequences of bytes, each kind with a mark of its own."""
    if isinstance(value, np.generic):
        yield from _parts(value.item())
    elif isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"array {value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        yield from _all_parts(item for pair in value.items() for item in pair)
    elif isinstance(value, (tuple, list)):
        yield f"sequence {len(value)}".encode()
        yield from _all_parts(value)
    elif isinstance(value, (set, frozenset)):
        yield f"set {sorted(map(repr, value))}".encode()
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"dataclass {type(value).__qualname__}".encode()
        yield from _all_parts((item.name, getattr(value, item.name)) for item in fields(value))
    elif isinstance(value, MethodType):
        yield from _all_parts((value.__func__, value.__self__))
    elif hasattr(value, "__qualname__"):  # a function or a class
        yield f"name {value.__module__}.{value.__qualname__}".encode()
        yield from _all_parts((getattr(value, "__defaults__", None), *_closed_over(value)))
    elif hasattr(value, "func") and hasattr(value, "keywords"):  # a partial
        yield from _all_parts((value.func, value.args, value.keywords))
    elif hasattr(value, "name") and hasattr(value, "ctype"):
        yield f"component {value.name}".encode()
    elif hasattr(value, "to_dict") and hasattr(value, "to_numpy"):  # a data frame or a series
        yield from _parts(value.to_dict())
    elif hasattr(value, "__dict__"):
        yield f"object {type(value).__qualname__}".encode()
        yield from _parts(vars(value))
    else:
        raise ModelError(
            f"a {type(value).__name__} has no fingerprint, by which a file knows what it is of. Give numbers, texts, "
            "arrays, lists and mappings, or go without a file."
        )


def _all_parts(values: Iterable[Any]) -> Iterator[bytes]:
    for value in values:
        yield from _parts(value)


def _closed_over(function: Any) -> Iterator[Any]:
    for cell in getattr(function, "__closure__", None) or ():
        with contextlib.suppress(ValueError):  # a name without a value yet
            yield cell.cell_contents
