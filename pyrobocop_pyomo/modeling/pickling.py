"""What a pickle can hold of the user's functions."""

from __future__ import annotations

import pickle
from typing import Any


def picklable_or_none(function: Any) -> Any:
    """The function if a pickle can hold it, which takes a function at the top level of a module; None otherwise."""
    try:
        pickle.dumps(function)
    except (pickle.PicklingError, AttributeError, TypeError, ValueError, RuntimeError):
        # Local functions, locks and open files, pointers, classes that refuse by NotImplementedError, deep recursion.
        return None
    return function
