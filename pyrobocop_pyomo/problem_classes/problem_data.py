"""The numbers that a problem class gives: sizes, times, bounds, guesses, pairs. All that is wrong is said at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.numerics import Array

from .methods import REQUIRED, Methods, as_vector, finite_or_none, missing_methods

KINDS = ("x", "xdot", "y", "u")


@dataclass(frozen=True)
class Sizes:
    """What ``get_info`` says.

    Attributes
    ----------
    states, algebraics, controls, parameters, pairs, elements : int
    times : array, shape (elements + 1,)
    """

    states: int
    algebraics: int
    controls: int
    parameters: int
    pairs: int
    elements: int
    times: Array

    @property
    def rows(self) -> int:
        """Equations at a point."""
        return self.states + self.algebraics - self.pairs

    @property
    def of_kinds(self) -> dict[str, int]:
        """Variables at a point, in the order in which bounds and guesses are stacked."""
        return dict(zip(KINDS, (self.states, self.states, self.algebraics, self.controls), strict=True))


@dataclass(frozen=True)
class Side:
    """One side of a pair: an algebraic variable and which of its bounds, ``"lower"`` or ``"upper"``."""

    algebraic: int
    bound: str


@dataclass(frozen=True)
class ProblemData:
    """Everything that is read once.

    Attributes
    ----------
    sizes : Sizes
    bounds : dict of kind to array, shape (2, elements + 1, n)
        Lower and upper bounds by element index.
    guesses : dict of kind to array, shape (elements + 1, n)
    initial : array, shape (2, states)
        Bounds of the initial state.
    final : array, shape (2, states), or None
    parameter_bounds, parameter_guess : arrays, shapes (2, n_p) and (n_p,)
    pairs : tuple of (Side, Side)
    """

    sizes: Sizes
    bounds: dict[str, Array]
    guesses: dict[str, Array]
    initial: Array
    final: Array | None
    parameter_bounds: Array
    parameter_guess: Array
    pairs: tuple[tuple[Side, Side], ...]


def read_problem(methods: Methods) -> ProblemData:
    """Ask a problem class for its numbers.

    Raises
    ------
    ProblemClassError
        Listing the methods that are missing, take the wrong arguments or contradict ``get_info``.
    """
    return _ProblemReader(methods).read()


class _ProblemReader:
    def __init__(self, methods: Methods) -> None:
        self._methods = methods
        self._wrong: list[str] = missing_methods(methods, REQUIRED)

    def read(self) -> ProblemData:
        methods = self._methods
        sizes = self._sizes() if methods.has("get_info") else None
        if sizes is None:
            raise self._error()
        for needed, names in (
            (sizes.parameters, ("bounds_params", "initialpoint_params")),
            (sizes.pairs, ("get_complementarity_info",)),
            (methods.has("get_objects_info"), ("get_object_vertices",)),
            (methods.has("get_object_vertices"), ("get_objects_info",)),
        ):
            absent = [name for name in names if needed and not methods.has(name)]
            if absent:
                self._wrong.append(f"it has no method {', '.join(absent)}, which is needed here")
        if sizes.parameters:
            for name, most in (("objective", 5), ("constraint", 6)):
                if methods.has(name) and methods.count(name) <= most:
                    self._wrong.append(f"{name} has no place for the {sizes.parameters} parameters p")
        # What is there is read on, so that everything is said at once.
        bounds = self._bounds(sizes) if methods.has("bounds") else None
        guesses = self._guesses(sizes) if methods.has("initialpoint") else None
        initial = self._ends("initialcondition", sizes) if methods.has("initialcondition") else None
        final_name = next((name for name in ("bounds_finaltime", "bounds_finaftime") if methods.has(name)), None)
        final = None if final_name is None else self._ends(final_name, sizes)
        parameter_bounds, parameter_guess = self._parameters(sizes)
        pairs = self._pairs(sizes, bounds) if bounds is not None else ()
        if self._wrong or bounds is None or guesses is None or initial is None:
            raise self._error()
        return ProblemData(sizes, bounds, guesses, initial, final, parameter_bounds, parameter_guess, pairs)

    def _error(self) -> ProblemClassError:
        return ProblemClassError(
            f"{self._methods.class_name} cannot be taken as a problem: " + "; ".join(dict.fromkeys(self._wrong)) + "."
        )

    def _sizes(self) -> Sizes | None:
        info = self._methods.call("get_info")
        if not isinstance(info, (tuple, list)) or len(info) < 7:
            self._wrong.append(
                f"get_info returned {info!r}; expected (n_d, n_a, n_u, n_p, n_cc, N, times, nonzeros of Jacobian and "
                "Hessian)"
            )
            return None
        try:
            counts: Any = [int(np.asarray(entry).item()) for entry in info[:6]]
            times = as_vector(info[6], "get_info: times")
        except (TypeError, ValueError) as error:
            self._wrong.append(f"get_info returned {info!r}, whose counts or times are no numbers ({error})")
            return None
        states, algebraics, controls, parameters, pairs, elements = counts
        sizes = Sizes(states, algebraics, controls, parameters, pairs, elements, times)
        before = len(self._wrong)
        if sizes.states < 1 or min(counts) < 0 or sizes.elements < 1:
            self._wrong.append(
                f"get_info counts {sizes.states} states, {sizes.algebraics} algebraics, {sizes.controls} controls, "
                f"{sizes.parameters} parameters, {sizes.pairs} pairs and {sizes.elements} elements; at least one state "
                "and one element are needed, and no count is negative"
            )
        elif sizes.rows < 1:
            self._wrong.append(
                f"get_info leaves n_d + n_a - n_cc = {sizes.rows} equations per point for {sizes.states} states"
            )
        if len(times) != sizes.elements + 1:
            self._wrong.append(
                f"get_info gives {len(times)} times for {sizes.elements} elements; N + 1 = {sizes.elements + 1} are "
                "needed, the boundaries of the elements"
            )
        elif not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            self._wrong.append("get_info gives times that are not finite or do not increase")
        return sizes if len(self._wrong) == before else None

    def _bounds(self, sizes: Sizes) -> dict[str, Array]:
        total = sum(sizes.of_kinds.values())
        rows = np.empty((2, sizes.elements + 1, total))
        rows[0], rows[1] = -np.inf, np.inf
        for i in range(sizes.elements + 1):
            pair = self._lower_and_upper("bounds", total, "[x, xdot, y, u]", i)
            if pair is None:
                break
            rows[:, i] = pair
        by_kind = _split(rows, sizes)
        for kind, table in by_kind.items():
            crossed = np.argwhere(table[0] > table[1])
            if len(crossed):
                i, j = crossed[0]
                self._wrong.append(
                    f"bounds({i}) gives {kind}[{j}] the lower bound {table[0, i, j]:g} above the upper "
                    f"{table[1, i, j]:g}"
                )
        return by_kind

    def _lower_and_upper(self, name: str, size: int, label: str, *arguments: int) -> Array | None:
        """Two rows of `size` numbers; None, with a sentence, for anything else."""
        shown = ", ".join(map(str, arguments))
        found = self._methods.numbers(name, *arguments, shown=shown)
        flat = np.concatenate(found) if isinstance(found, list) else found
        lengths = [len(part) for part in found] if isinstance(found, list) else [len(flat)]
        if len(flat) != 2 * size or (len(lengths) == 2 and lengths != [size, size]):
            self._wrong.append(
                f"{name}({shown}) returned arrays of the lengths {lengths}; expected a lower and an upper one of "
                f"{size} entries each, for {label}"
            )
            return None
        if np.isnan(flat).any():
            self._wrong.append(f"{name}({shown}) holds a NaN")
            return None
        return flat.reshape(2, size)

    def _guesses(self, sizes: Sizes) -> dict[str, Array]:
        lengths = list(sizes.of_kinds.values())
        rows = np.zeros((sizes.elements + 1, sum(lengths)))
        for i in range(sizes.elements + 1):
            found = self._methods.numbers("initialpoint", i, shown=str(i))
            parts = found if isinstance(found, list) else [found]
            flat = np.concatenate(parts)
            given = [len(part) for part in parts]
            if len(flat) != sum(lengths) or (len(parts) == 4 and given != lengths):
                self._wrong.append(
                    f"initialpoint({i}) returned arrays of the lengths {given}; expected x, xdot, y, u of {lengths}"
                )
                break
            if not np.isfinite(flat).all():
                self._wrong.append(f"initialpoint({i}) holds a value that is not finite")
                break
            rows[i] = flat
        return _split(rows, sizes)

    def _ends(self, name: str, sizes: Sizes) -> Array:
        found = self._methods.numbers(name)
        if isinstance(found, list) and [len(part) for part in found[:-1]] in ([sizes.states], [sizes.states] * 2):
            # Some classes give algebraics at the start as well, which the equations determine.
            found = found[:-1] if len(found[-1]) == sizes.algebraics != sizes.states else found
        flat = np.concatenate(found) if isinstance(found, list) else found
        if name == "initialcondition" and len(flat) == sizes.states:
            flat = np.concatenate([flat, flat])
        if len(flat) != 2 * sizes.states or np.isnan(flat).any():
            self._wrong.append(
                f"{name}() returned {len(flat)} numbers; expected lower and upper bounds of the {sizes.states} states"
                + (", or their values" if name == "initialcondition" else "")
            )
            return np.zeros((2, sizes.states))
        ends = flat.reshape(2, sizes.states)
        if (ends[0] > ends[1]).any():
            j = int(np.argmax(ends[0] > ends[1]))
            self._wrong.append(f"{name}() gives x[{j}] the lower bound {ends[0, j]:g} above the upper {ends[1, j]:g}")
        return ends

    def _parameters(self, sizes: Sizes) -> tuple[Array, Array]:
        if not sizes.parameters:
            return np.zeros((2, 0)), np.zeros(0)
        if not (self._methods.has("bounds_params") and self._methods.has("initialpoint_params")):
            return np.zeros((2, sizes.parameters)), np.zeros(sizes.parameters)  # said already
        bounds = self._lower_and_upper("bounds_params", sizes.parameters, "p")
        found = self._methods.numbers("initialpoint_params")
        guess = np.concatenate(found) if isinstance(found, list) else found
        if len(guess) != sizes.parameters or not np.isfinite(guess).all():
            self._wrong.append(f"initialpoint_params() returned {guess}; expected {sizes.parameters} finite numbers")
        return np.zeros((2, sizes.parameters)) if bounds is None else bounds, guess

    def _pairs(self, sizes: Sizes, bounds: dict[str, Array]) -> tuple[tuple[Side, Side], ...]:
        if not sizes.pairs or not self._methods.has("get_complementarity_info"):
            return ()
        found: Any = self._methods.numbers("get_complementarity_info")
        if not isinstance(found, list) or [len(part) for part in found] != [sizes.pairs] * 4:
            self._wrong.append(
                f"get_complementarity_info() has to return four arrays of {sizes.pairs} entries: idx1, side1, idx2, "
                "side2"
            )
            return ()
        return tuple(
            (self._side(pair, first, of_first, sizes, bounds), self._side(pair, second, of_second, sizes, bounds))
            for pair, (first, of_first, second, of_second) in enumerate(zip(*found, strict=True))
        )

    def _side(self, pair: int, index: float, side: float, sizes: Sizes, bounds: dict[str, Array]) -> Side:
        what = f"get_complementarity_info(): pair {pair}"
        if index != int(index) or not 0 <= index < sizes.algebraics:
            self._wrong.append(f"{what} names y[{index:g}] of {sizes.algebraics} algebraics, counted from 0")
            return Side(0, "lower")
        if side not in (0, 1):
            self._wrong.append(f"{what} has the side {side:g}; 0 is the lower bound, 1 the upper")
            return Side(int(index), "lower")
        bound = "upper" if side else "lower"
        own = bounds["y"][int(side), :-1, int(index)]
        infinite = [i for i, number in enumerate(own) if finite_or_none(number) is None]
        if infinite:
            self._wrong.append(
                f"{what} uses the {bound} bound of y[{index:g}], which bounds({infinite[0]}) leaves infinite: a "
                "side of a pair is the distance from a finite bound"
            )
        return Side(int(index), bound)


def _split(rows: Array, sizes: Sizes) -> dict[str, Array]:
    ends = np.cumsum(list(sizes.of_kinds.values()))
    return dict(zip(KINDS, np.split(rows, ends[:-1], axis=-1), strict=True))
