"""Calling the methods of a problem class: which are there, what they take, and what they return, as plain arrays."""

from __future__ import annotations

import inspect
import logging
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ExpressionArrayError, ProblemClassError
from pyrobocop_pyomo.numerics import Array

logger = logging.getLogger(__name__)

REQUIRED = ("get_info", "bounds", "initialpoint", "initialcondition", "objective", "constraint")
DERIVATIVES = ("gradient", "jacobianstructure", "jacobian", "hessianstructure", "hessian")
# How many arguments a method takes, parameters p included, which may be left out where there are none.
ARGUMENTS = {"objective": 6, "constraint": 7, "objective_mayer": 3, "get_object_vertices": 6}
WITH_PARAMETERS = ("objective", "constraint", "objective_mayer")

_INFINITE = 1e19  # as Ipopt has it


class _OldNames:
    """Names of infinity and of no number that NumPy 2 has removed, on NumPy while a method of a problem class runs.

    Classes were written with them, and say nothing else with them than `numpy.inf` and `numpy.nan`.
    """

    def __init__(self) -> None:
        names = {"Inf": np.inf, "Infinity": np.inf, "infty": np.inf, "PINF": np.inf, "NINF": -np.inf, "NaN": np.nan}
        self._missing = {name: number for name, number in names.items() if not hasattr(np, name)}
        self._lock, self._asked = threading.Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            self._asked += 1
            for name, number in self._missing.items():
                setattr(np, name, number)

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._asked -= 1
            for name in self._missing if not self._asked else ():
                delattr(np, name)


_OLD_NAMES = _OldNames()


class Methods:
    """The methods of one object.

    Parameters
    ----------
    problem : object
        With PyRoboCOP's methods.
    """

    def __init__(self, problem: Any) -> None:
        self._problem = problem
        self.class_name = (problem if isinstance(problem, type) else type(problem)).__name__

    def has(self, name: str) -> bool:
        """Whether there is a method of a name."""
        return callable(getattr(self._problem, name, None))

    def count(self, name: str) -> float:
        """How many arguments a method takes by position; infinitely many with ``*args``."""
        try:
            parameters = inspect.signature(getattr(self._problem, name)).parameters.values()
        except (TypeError, ValueError):  # a method without a signature, of compiled code
            return float("inf")
        if any(parameter.kind is inspect.Parameter.VAR_POSITIONAL for parameter in parameters):
            return float("inf")
        by_position = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        return sum(parameter.kind in by_position for parameter in parameters)

    def call(self, name: str, *arguments: Any, shown: str = "") -> Any:
        """Ask a method.

        Raises
        ------
        ProblemClassError
            When it fails, naming it, with what to do instead where that is known.
        """
        what = f"{self.class_name}.{name}({shown})"
        try:
            with _OLD_NAMES:
                return getattr(self._problem, name)(*arguments)
        except ProblemClassError:
            raise
        except ExpressionArrayError as error:
            raise ProblemClassError(f"{what}: {error}") from error
        except Exception as error:
            reason = f"{error}".strip().splitlines()[0].rstrip(".") if f"{error}".strip() else "no message"
            raise ProblemClassError(f"{what} failed: {type(error).__name__}: {reason}.{_remedy(error)}") from error

    def numbers(self, name: str, *arguments: Any, shown: str = "") -> Any:
        """What a method returns, as an array of floats; a list of such, where it returned several arrays."""
        result = self.call(name, *arguments, shown=shown)
        what = f"{self.class_name}.{name}({shown})"
        if isinstance(result, (tuple, list)) and any(np.ndim(part) > 0 or part is None for part in result):
            return [as_vector(part, what) for part in result]
        return as_vector(result, what)


def _remedy(error: Exception) -> str:
    text = str(error)
    if "bool" in text and "expression" in text:
        return (
            " A rule cannot branch on variables, nor take the larger of two: state both cases by complementarity, "
            "or as phases in time."
        )
    if "no callable" in text and "method" in text:
        return (
            " A function of NumPy met a number among the variables of a plain array: build the array by "
            "pyrobocop_pyomo.array, or apply the function to its entries."
        )
    if isinstance(error, IndexError):
        return (
            " Arrays have the lengths that the counts of get_info say: n_d, n_a, n_u, n_p, and n_d + n_a - n_cc rows."
        )
    if "UFuncTypeError" in type(error).__name__ or "Cannot cast" in text:
        return " Make arrays that variables are assigned to with dtype=object."
    return ""


def as_vector(values: Any, label: str) -> Array:
    """Numbers of any shape as a vector.

    Raises
    ------
    ProblemClassError
        When there is something else among them.
    """
    if values is None:
        return np.empty(0)
    try:
        return np.asarray(values, dtype=float).ravel()
    except (TypeError, ValueError) as error:
        raise ProblemClassError(f"{label} returned {values!r}, where numbers are expected ({error}).") from None


def finite_or_none(number: float) -> float | None:
    """A bound, None where there is none: Ipopt's 1e19 counts as infinite."""
    return None if abs(number) >= _INFINITE else float(number)


def missing_methods(methods: Methods, required: Sequence[str]) -> list[str]:
    """A sentence for what is missing, and for each method that takes the wrong number of arguments."""
    absent = [name for name in required if not methods.has(name)]
    found = [f"it has no method {', '.join(absent)}"] if absent else []
    for name, expected in ARGUMENTS.items():
        if not methods.has(name):
            continue
        least = expected - (name in WITH_PARAMETERS)
        count = methods.count(name)
        if not (least <= count <= expected or count == float("inf")):
            found.append(f"{name} takes {count:g} arguments where {expected} are handed over (besides self)")
    return found


def notice_derivatives(methods: Methods) -> None:
    """Tell that derivatives written by hand are not used."""
    present = [name for name in DERIVATIVES if methods.has(name)]
    if present:
        logger.warning(
            "%s: %s %s ignored; exact derivatives are computed from the equations.",
            methods.class_name, ", ".join(present), "is" if len(present) == 1 else "are",
        )  # fmt: skip
