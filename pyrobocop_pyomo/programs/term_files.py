"""A model's terms as a ``.nl`` file: the terms of one shape are written by one pattern, without a walk over each.

Pyomo's writer walks over the tree of every row. Here the walk of `collect_terms` has found what repeats itself. ASL
reads trees, so what a term uses twice is written out; where that is long, `term_file` leaves the model to others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.modeling.expression_nodes import comparisons

from .expression_codes import decoded
from .model_numbers import ModelNumbers
from .model_terms import ModelTerms, Terms
from .nl_files import ModelFile
from .nonlinear_program import FloatArray, IndexArray
from .sparse_entries import merged_places
from .term_groups import TermGroup

# Nodes that a term may have when it is written out, for each of its own. Where there are more, names save time.
_MOST_COPIES = 4
# Shorter terms are written out in any case.
_SHORT = 200

# Operators before two summands; none before one.
_SUMS = {1: "", 2: "o0\n"}
_FUNCTIONS = {
    "abs": 15, "ceil": 14, "floor": 13, "sqrt": 39, "log": 43, "log10": 42, "exp": 44, "sin": 41, "cos": 46, "tan": 38,
    "asin": 51, "acos": 53, "atan": 49, "sinh": 40, "cosh": 45, "tanh": 37, "asinh": 50, "acosh": 52, "atanh": 47,
}  # fmt: skip


class _TooLong(Exception):
    """A term that is too long to be written out."""


class _Pattern:
    """An expression in the prefix notation of ``.nl`` files, with places in braces for variables and numbers.

    Parameters
    ----------
    text : str
    nodes, most : int
        How many there are, and may be.
    """

    __slots__ = ("most", "nodes", "text")

    def __init__(self, text: str, nodes: int, most: int) -> None:
        self.text, self.nodes, self.most = text, nodes, most
        if nodes > most:
            raise _TooLong

    def under(self, operator: int, *others: Any) -> _Pattern:
        """This and other arguments under an operator."""
        arguments = [self, *(_number(other, self.most) for other in others)]
        text = f"o{operator}\n" + "".join(argument.text for argument in arguments)
        return _Pattern(text, 1 + sum(argument.nodes for argument in arguments), self.most)

    def __add__(self, other: Any) -> _Pattern:
        return self.under(0, other)

    def __mul__(self, other: Any) -> _Pattern:
        return self.under(2, other)

    def __truediv__(self, other: Any) -> _Pattern:
        return self.under(3, other)

    def __pow__(self, other: Any) -> _Pattern:
        return self.under(5, other)

    def __neg__(self) -> _Pattern:
        return self.under(16)

    def __le__(self, other: Any) -> _Pattern:
        return self.under(23, other)

    def __lt__(self, other: Any) -> _Pattern:
        return self.under(22, other)

    def equals(self, other: Any) -> _Pattern:
        """Where both are the same."""
        return self.under(24, other)


def _number(entry: Any, most: int) -> _Pattern:
    return entry if isinstance(entry, _Pattern) else _Pattern(f"n{float(entry)!r}\n", 1, most)


def _function(operator: int) -> Callable[[_Pattern], _Pattern]:
    return lambda argument: argument.under(operator)


_MEANINGS: dict[str, Callable[..., Any]] = {
    **{name: _function(operator) for name, operator in _FUNCTIONS.items()},
    **comparisons(lambda a, b: a.under(21, b)),
    "==": lambda a, b: a.equals(b),
    "choose": lambda condition, a, b: condition.under(35, a, b),
}


class _Sums:
    """Rows that are written: their constants, linear parts and patterns of nonlinear terms.

    Parameters
    ----------
    terms : Terms
    rows : int
    parameters : (k,) array
        Values of all parameters.

    Attributes
    ----------
    constants : (rows,) array
    is_nonlinear : (rows,) bool array
    """

    def __init__(self, terms: Terms, rows: int, parameters: FloatArray) -> None:
        self._groups = [(_pattern(group), group, _numbers(group, parameters)) for group in terms.groups.values()]
        of_terms = [(np.repeat(group.rows, group.size), np.array(group.columns)) for _, group, _ in self._groups]
        empty = np.empty(0, dtype=np.intp)
        self._nonlinear = [np.concatenate([empty, *several]).astype(np.intp) for several in zip(*of_terms, strict=True)]
        self._nonlinear = self._nonlinear or [empty, empty]
        self._linear, (given_rows, given, coefficients) = terms.linear_parts()
        self.constants: FloatArray = np.bincount(given_rows, coefficients * parameters[given], rows).astype(float)
        for row, constant in terms.constants.items():
            self.constants[row] += constant
        self.is_nonlinear = np.zeros(rows, dtype=bool)
        for _, group, _ in self._groups:
            self.is_nonlinear[group.rows] = True

    @property
    def are_finite(self) -> bool:
        """Whether all numbers exist."""
        of_terms = [several for _, group, numbers in self._groups for several in (numbers, group.scales)]
        return all(np.isfinite(several).all() for several in (self.constants, self._linear[2], *of_terms))

    def occurs(self, n: int) -> NDArray[np.bool_]:
        """Which of n variables are in nonlinear terms."""
        found = np.zeros(n, dtype=bool)
        found[self._nonlinear[1]] = True
        return found

    def jacobian(self, place: np.ndarray, rows: np.ndarray) -> tuple[IndexArray, IndexArray, FloatArray]:
        """Rows, columns and linear coefficients of all entries, in the order of the file.

        Parameters
        ----------
        place, rows : int arrays
            Where each variable, and each row, stands in the file.
        """
        pairs = [(rows[own], place[columns]) for own, columns in (self._linear[:2], self._nonlinear)]
        structure, places = merged_places(pairs, len(place))
        linear = np.bincount(places[: self._linear[2].size], self._linear[2], structure[0].size)
        return *structure, linear.astype(float)

    def bodies(self, place: np.ndarray, constants: FloatArray) -> list[str]:
        """Nonlinear part of each row, plus a constant."""
        summands: list[list[str]] = [[] for _ in self.constants]
        for pattern, group, numbers in self._groups:
            columns = place[np.array(group.columns, dtype=np.intp)].reshape(len(group.rows), -1)
            each = zip(group.rows, group.scales, columns.tolist(), numbers.tolist(), strict=True)
            for row, scale, own, given in each:
                text = pattern.format(*own, *given)
                summands[row].append(text if scale == 1.0 else f"o2\nn{float(scale)!r}\n{text}")
        for row in np.flatnonzero((constants != 0.0) | ~self.is_nonlinear).tolist():
            summands[row].append(f"n{float(constants[row])!r}\n")
        return ["".join((_SUMS.get(len(own), f"o54\n{len(own)}\n"), *own)) for own in summands]


def _pattern(group: TermGroup) -> str:
    """The terms of a group, with a place in braces for each variable, and for each number after them."""
    most = max(_SHORT, _MOST_COPIES * len(group.code))
    variables = [_Pattern(f"v{{{i}}}\n", 1, most) for i in range(group.size)]
    numbers = [_Pattern(f"n{{{group.size + i}!r}}\n", 1, most) for i in range(group.numbers_per_term)]
    return _number(decoded(group.code, variables, numbers, _MEANINGS), most).text


def _numbers(group: TermGroup, parameters: FloatArray) -> FloatArray:
    numbers = np.array(group.numbers, dtype=float)
    if group.parameters:
        places, known = np.array(group.parameters).T
        numbers[places] = parameters[known]
    return numbers.reshape(len(group.rows), group.numbers_per_term)


def term_file(terms: ModelTerms) -> ModelFile | None:
    """Write a model whose terms were collected.

    Returns
    -------
    ModelFile or None
        With one objective, to be minimised. None where a term is too long to be written out, the model calls Python
        functions, or one of its numbers does not exist.

    Raises
    ------
    ModelError
        As `ModelNumbers`.
    InfeasibleConstraintException
        When a row without free variables contradicts itself.
    """
    if terms.calls.calls:
        return None
    numbers = ModelNumbers(terms)
    n, m = len(terms.variables), len(terms.constraints)
    try:
        rows, cost = (_Sums(of, count, numbers.parameters) for of, count in ((terms.rows, m), (terms.cost, 1)))
    except _TooLong:
        return None
    if not (rows.are_finite and cost.are_finite):
        return None
    # The order of the format: variables that are nonlinear in both, in rows, in the objective, nowhere; then rows.
    in_rows, in_cost = rows.occurs(n), cost.occurs(n)
    variables = np.argsort(2 * ~in_rows + ~in_cost, kind="stable")
    constraints = np.argsort(~rows.is_nonlinear, kind="stable")
    place, row_place = np.argsort(variables), np.argsort(constraints)
    jacobian, gradient = rows.jacobian(place, row_place), cost.jacobian(place, np.zeros(1, dtype=np.intp))
    # The constant of a linear row moves its bounds.
    moved = np.where(rows.is_nonlinear, 0.0, rows.constants)
    lower, upper = (bounds[constraints] for bounds in (numbers.g_lower - moved, numbers.g_upper - moved))
    ranges, equations = int((np.isfinite(lower) & np.isfinite(upper) & (lower != upper)).sum()), (lower == upper).sum()
    both, nonlinear, all_nonlinear = (int(which.sum()) for which in (in_rows & in_cost, in_rows, in_rows | in_cost))
    bodies = rows.bodies(place, rows.constants - moved)
    text = [
        "g3 1 1 0\n",
        f" {n} {m} 1 {ranges} {equations}\n {rows.is_nonlinear.sum()} {cost.is_nonlinear.sum()}\n 0 0\n",
        # What is in the objective alone comes after what is in rows alone, and is counted with it.
        f" {nonlinear} {all_nonlinear if all_nonlinear > nonlinear else both} {both}\n 0 0 0 1\n 0 0 0 0 0\n",
        f" {jacobian[0].size} {gradient[0].size}\n 0 0\n 0 0 0 0 0\n",
        *(f"C{number}\n{bodies[row]}" for number, row in enumerate(constraints.tolist())),
        f"O0 0\n{cost.bodies(place, cost.constants)[0]}",
        f"x{n}\n",
        *map("%d %r\n".__mod__, enumerate(numbers.values_of_variables()[variables].tolist())),
        "r\n",
        *map(_bounds, lower.tolist(), upper.tolist()),
        "b\n",
        *map(_bounds, numbers.x_lower[variables].tolist(), numbers.x_upper[variables].tolist()),
        f"k{n - 1}\n",
        *map("%d\n".__mod__, np.cumsum(np.bincount(jacobian[1], minlength=n))[: n - 1].tolist()),
        *_segments("J", *jacobian),
        *_segments("G", *gradient),
    ]
    return ModelFile(
        "".join(text),
        [terms.variables[column] for column in variables.tolist()],
        [terms.constraints[row] for row in constraints.tolist()],
        [],
    )


def _bounds(lower: float, upper: float) -> str:
    if lower == upper:
        return f"4 {lower!r}\n"
    if lower == -np.inf:
        return "3\n" if upper == np.inf else f"1 {upper!r}\n"
    return f"2 {lower!r}\n" if upper == np.inf else f"0 {lower!r} {upper!r}\n"


def _segments(letter: str, rows: IndexArray, columns: IndexArray, coefficients: FloatArray) -> list[str]:
    """The linear part of each row that has entries, which are in the order of their rows."""
    lines = list(map("%d %r\n".__mod__, zip(columns.tolist(), coefficients.tolist(), strict=True)))
    numbers, starts, counts = np.unique(rows, return_index=True, return_counts=True)
    found = zip(numbers.tolist(), starts.tolist(), counts.tolist(), strict=True)
    return ["".join((f"{letter}{row} {count}\n", *lines[start : start + count])) for row, start, count in found]
