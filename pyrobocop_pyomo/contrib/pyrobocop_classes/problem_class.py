"""`ProblemClass`: an object with PyRoboCOP's methods, which are called, and whose numbers are checked."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, ExpressionArray, array
from pyrobocop_pyomo.modeling.rule_slips import slips_explained, takes_arguments
from pyrobocop_pyomo.numerics import Array

REQUIRED = ("get_info", "bounds", "initialpoint", "initialcondition", "objective", "constraint")
# The methods that state formulas; without parameters they may leave out the last argument.
FORMULAS = {
    "constraint": ("c", "t", "x", "xdot", "y", "u", "p"),
    "objective": ("t", "x", "xdot", "y", "u", "p"),
    "objective_mayer": ("x0", "xf", "p"),
}

_INFINITE = 1e19  # as Ipopt has it

# Names of infinity and of no number that NumPy 2 has removed; classes were written with them.
_OLD_NAMES = {"Inf": np.inf, "Infinity": np.inf, "infty": np.inf, "PINF": np.inf, "NINF": -np.inf, "NaN": np.nan}
_LOCK = threading.RLock()


@contextmanager
def _old_names_of_numpy() -> Iterator[None]:
    """Context in which NumPy has these names, in one thread at a time."""
    with _LOCK:
        missing = [name for name in _OLD_NAMES if not hasattr(np, name)]
        for name in missing:
            setattr(np, name, _OLD_NAMES[name])
        try:
            yield
        finally:
            for name in missing:
                delattr(np, name)


class ProblemClass:
    """An object with PyRoboCOP's methods.

    Parameters
    ----------
    problem : object

    Attributes
    ----------
    name : str
        Of its class.
    counts : dict of kind to int
        How many ``x``, ``xdot``, ``y``, ``u`` and ``p`` there are.
    pairs, rows : int
        Pairs and equations at a point.
    elements : int
    times : array, shape (elements + 1,)
        Boundaries of the elements.

    Raises
    ------
    ModelError
        When methods are missing, or ``get_info`` contradicts itself.
    """

    def __init__(self, problem: Any) -> None:
        self._problem = problem
        self.name = type(problem).__name__
        self._require(*REQUIRED)
        info = self.call("get_info")
        try:
            stated = [int(np.asarray(count).item()) for count in info[:6]]
            states, algebraics, controls, parameters, self.pairs, self.elements = stated
            self.times = np.asarray(info[6], dtype=float).ravel()
        except (TypeError, ValueError, IndexError) as error:
            raise ModelError(
                f"{self.name}.get_info() returned {info!r}; expected (n_d, n_a, n_u, n_p, n_cc, N, times, ...)."
            ) from error
        self.counts = {"x": states, "xdot": states, "y": algebraics, "u": controls, "p": parameters}
        self.rows = states + algebraics - self.pairs
        if min(stated) < 0 or min(states, self.elements, self.rows) < 1 or len(self.times) != self.elements + 1:
            raise ModelError(
                f"{self.name}.get_info() counts {stated} for (n_d, n_a, n_u, n_p, n_cc, N) and gives {len(self.times)} "
                "times; n_d and N are at least 1, n_d + n_a - n_cc is the number of equations at a point, and N + 1 "
                "times are the boundaries of the elements."
            )
        if parameters:
            self._require("bounds_params", "initialpoint_params")
        if self.pairs:
            self._require("get_complementarity_info")
        if self.has("get_objects_info"):
            self._require("get_object_vertices")

    def __deepcopy__(self, memo: dict[int, Any]) -> ProblemClass:
        return self  # nothing of a model is in it

    def has(self, name: str) -> bool:
        """Whether there is a method of a name."""
        return callable(getattr(self._problem, name, None))

    def _require(self, *names: str) -> None:
        missing = [name for name in names if not self.has(name)]
        if missing:
            raise ModelError(f"{self.name} has no method {', '.join(missing)}.")

    def names(self, kind: str) -> list[str]:
        """Names of the phase's variables of a kind: ``x``, ``y``, ``u`` or ``p``."""
        return [f"{kind}{j}" for j in range(self.counts[kind])]

    # ---------------------------------------------------------------- calls

    def call(self, name: str, *arguments: Any) -> Any:
        """What a method returns."""
        with _old_names_of_numpy():
            return getattr(self._problem, name)(*arguments)

    def formulas(self, block: Any, name: str, *arguments: Any) -> Any:
        """What one of the methods in `FORMULAS` returns for variables of a phase; slips that are known are explained.

        Raises
        ------
        ModelError
        """
        method, given = getattr(self._problem, name), FORMULAS[name]
        if not self.counts["p"] and not takes_arguments(method, len(given)):
            given, arguments = given[:-1], arguments[:-1]
        with slips_explained(method, f"{self.name}.{name}", block, given, ModelError):
            return self.call(name, *arguments)

    def numbers(self, expected: str, lengths: tuple[int, ...], name: str, *arguments: int) -> Array:
        """What a method returns, arrays of any shape behind each other, as one row of numbers.

        Raises
        ------
        ModelError
            When there are none of the expected lengths, or something else is among them.
        """
        returned = self.call(name, *arguments)
        parts = returned if isinstance(returned, (tuple, list)) else (returned,)
        label = f"{self.name}.{name}({', '.join(map(str, arguments))})"
        try:
            flat = np.concatenate([np.ravel(np.asarray([] if part is None else part, dtype=float)) for part in parts])
        except (TypeError, ValueError) as error:
            raise ModelError(f"{label} returned {returned!r}; expected {expected} ({error}).") from error
        if len(flat) not in lengths or np.isnan(flat).any():
            raise ModelError(
                f"{label} returned {len(flat)} numbers; expected {expected}, {lengths[0]} together, none of them NaN."
            )
        infinite: Array = np.abs(flat) >= _INFINITE
        return np.where(infinite, np.copysign(np.inf, flat), flat)

    # ---------------------------------------------------------------- numbers

    def by_kind(self, name: str, rows: int) -> dict[str, Array]:
        """Bounds (two rows) or guesses (one) of ``x``, ``xdot``, ``y`` and ``u``, shape ``(elements + 1, rows, n)``."""
        kinds = [kind for kind in self.counts if kind != "p"]
        sizes = [self.counts[kind] for kind in kinds]
        expected = f"{'lower and upper bounds' if rows == 2 else 'values'} of x, xdot, y and u"
        of_elements = [self.numbers(expected, (rows * sum(sizes),), name, i) for i in range(self.elements + 1)]
        table = np.reshape(of_elements, (self.elements + 1, rows, sum(sizes)))
        return dict(zip(kinds, np.split(table, np.cumsum(sizes)[:-1], axis=-1), strict=True))

    def ends(self, name: str) -> Array:
        """Bounds of the states at one end, shape ``(2, states)``; values are both."""
        n, further = self.counts["x"], self.counts["y"]
        lengths = (2 * n, n, 2 * n + further, n + further)
        flat = self.numbers(f"lower and upper bounds of the {n} states", lengths, name)
        if len(flat) not in lengths[:2]:
            flat = flat[: len(flat) - further]  # some classes give algebraics as well, which the equations determine
        return np.resize(flat, (2, n))

    def sides(self, bounds: Array) -> Any:
        """Of each pair both sides: an algebraic, and which of its bounds, 0 for the lower and 1 for the upper.

        Parameters
        ----------
        bounds : array, shape (elements + 1, 2, algebraics)

        Raises
        ------
        ModelError
            When there is no such bound.
        """
        if not self.pairs:
            return []
        name, expected = "get_complementarity_info", "idx1, side1, idx2, side2 of each pair"
        flat = self.numbers(expected, (4 * self.pairs,), name).astype(int)
        sides: Any = flat.reshape(2, 2, self.pairs).transpose(2, 0, 1).tolist()
        for algebraic, side in (side for pair in sides for side in pair):
            is_there = 0 <= algebraic < self.counts["y"] and side in (0, 1)
            if not is_there or np.isinf(bounds[:-1, side, algebraic]).any():
                raise ModelError(
                    f"{self.name}.{name}(): a pair has the side {side} of y[{algebraic}], which is no finite bound in "
                    "every element. Algebraics count from 0, sides are 0 for the lower bound and 1 for the upper."
                )
        return sides


class ColumnArray(ExpressionArray):
    """Variables of one kind at one point, shape ``(n,)``.

    Authors write ``x[0]`` or ``x[0, 0]``: a second index chooses a column, of which there is one, or one per point of
    the first element for the initial state of a Mayer term.
    """

    columns: Any = None

    def __array_finalize__(self, source: Any) -> None:
        self.columns = None  # of a slice or a result, nothing is known

    def __getitem__(self, key: Any) -> Any:
        if self.ndim != 1 or not isinstance(key, tuple) or len(key) != 2 or None in key:
            return super().__getitem__(key)
        columns = np.asarray(self)[:, None] if self.columns is None else self.columns
        chosen = columns[key]
        return chosen.view(ExpressionArray) if isinstance(chosen, np.ndarray) else chosen


def column_array(values: Iterable[Any]) -> ColumnArray:
    """An array of variables, or of numbers in their place."""
    return array([ArrayEntry(value) for value in values]).view(ColumnArray)


class ArrayToFill(ExpressionArray):
    """Zeros that a method fills in place; one column also takes a vector."""

    @classmethod
    def zeros(cls, *shape: int) -> ArrayToFill:
        """All entries 0.0."""
        return np.full(shape, 0.0, dtype=object).view(cls)

    def __setitem__(self, key: Any, entry: Any) -> None:
        given: Any = array(entry)
        shape = np.shape(np.asarray(self)[key])
        super().__setitem__(key, given.reshape(shape) if given.size == np.prod(shape) else given)
