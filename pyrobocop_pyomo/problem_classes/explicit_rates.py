"""Solving rows that are linear in the derivatives for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types

from pyrobocop_pyomo.modeling.expression_arrays import array, plain_entry
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, ExpressionEvaluator
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array

# A pivot that is smaller, relative to the largest coefficient of its row, counts as zero.
_SMALLEST_PIVOT = 1e-10

# Determinants that are expressions are looked at for random values of their variables.
_SAMPLES = 50
_SMALLEST_DETERMINANT = 1e-7  # relative to the largest
_LARGEST_GROUP = 4
_NUMPY_FUNCTIONS = {name: getattr(np, numpy_name) for name, numpy_name in NUMPY_NAMES.items()}

Membership = tuple[tuple[int, ...], tuple[int, ...]]  # states, and the rows that determine their derivatives


@dataclass(frozen=True)
class AffineRow:
    """One equation at one point: ``constant + sum_j coefficients[j] * xdot_j = 0``.

    Attributes
    ----------
    constant : number or expression
    coefficients : mapping of state to number or expression
    is_affine : bool
        False where derivatives stand in `constant` or in a coefficient too.
    """

    constant: Any
    coefficients: Mapping[int, Any]
    is_affine: bool = True

    @property
    def is_numeric(self) -> bool:
        """Whether it can be solved for derivatives once and for all."""
        numbers = all(a.__class__ in native_numeric_types for a in self.coefficients.values())
        return self.is_affine and bool(self.coefficients) and numbers


@dataclass(frozen=True)
class SolvedGroup:
    """Rows that determine the derivatives of some states: ``xdot[states] = -inverse @ constants[rows]``."""

    states: tuple[int, ...]
    rows: tuple[int, ...]
    inverse: Array


def solve_rows(rows: Sequence[AffineRow]) -> list[SolvedGroup]:
    """Groups of rows and states, each of which determines its derivatives; what is left stays implicit."""
    groups = []
    for members in _coupled([row if row.is_numeric else None for row in rows]):
        states = sorted({j for i in members for j in rows[i].coefficients})
        matrix = np.array([[float(rows[i].coefficients.get(j, 0.0)) for j in states] for i in members])
        chosen = _independent(matrix)
        if len(chosen) == len(states):
            inverse = np.linalg.inv(matrix[chosen])
            inverse[np.abs(inverse) < 1e-14 * np.abs(inverse).max()] = 0.0
            groups.append(SolvedGroup(tuple(states), tuple(members[k] for k in chosen), inverse))
    return groups


def _coupled(rows: Sequence[AffineRow | None]) -> list[list[int]]:
    """Indices of the rows, those together that share derivatives directly or through others."""
    parts: list[tuple[set[int], list[int]]] = []
    for i, row in enumerate(rows):
        if row is None:
            continue
        states, members = set(row.coefficients), [i]
        apart = []
        for part in parts:
            if part[0] & states:
                states |= part[0]
                members += part[1]
            else:
                apart.append(part)
        parts = [*apart, (states, sorted(members))]
    return [members for _, members in sorted(parts, key=lambda part: part[1])]


def _independent(matrix: Array) -> list[int]:
    """The first rows that are linearly independent, by Gaussian elimination."""
    reduced = matrix / np.abs(matrix).max(axis=1, keepdims=True)
    pivots: list[tuple[int, int]] = []
    chosen: list[int] = []
    for i in range(len(reduced)):
        for k, pivot in pivots:
            reduced[i] -= reduced[k] * (reduced[i, pivot] / reduced[k, pivot])
        best = int(np.argmax(np.abs(reduced[i])))
        if abs(reduced[i, best]) > _SMALLEST_PIVOT:
            pivots.append((i, best))
            chosen.append(i)
    return chosen


def rates_of(group: SolvedGroup, rows: Sequence[AffineRow]) -> dict[int, Any]:
    """The derivatives that a group determines, as expressions."""
    rates = {}
    for state, weights in zip(group.states, group.inverse.tolist(), strict=True):
        terms = [(weight, rows[i].constant) for weight, i in zip(weights, group.rows, strict=True) if weight]
        total: Any = 0.0
        for weight, constant in terms:
            if weight == 1.0:
                total = total - constant
            elif weight == -1.0:
                total = total + constant
            else:
                total = total - weight * constant
        rates[state] = total
    return rates


def solvable_groups(rows: Sequence[AffineRow], groups: Sequence[SolvedGroup]) -> set[Membership]:
    """What numbers do not determine, but a matrix of expressions that is safely regular."""
    known = {j for group in groups for j in group.states}
    used = {i for group in groups for i in group.rows}
    open_rows = [
        AffineRow(row.constant, {j: a for j, a in row.coefficients.items() if j not in known})
        if row.is_affine
        else None
        for row in rows
    ]
    candidates = [
        row if row is not None and row.coefficients and i not in used else None for i, row in enumerate(open_rows)
    ]
    found = set()
    for members in _coupled(candidates):
        states = sorted({j for i in members for j in rows[i].coefficients if j not in known})
        if len(states) == len(members) <= _LARGEST_GROUP and _is_regular(_matrix(rows, states, members)):
            found.add((tuple(states), tuple(members)))
    return found


def rates_of_matrix(group: Membership, rows: Sequence[AffineRow], known: Mapping[int, Any]) -> dict[int, Any]:
    """The derivatives of such a group, as expressions; those that are known are given."""
    states, members = group
    right = []
    for i in members:
        total = rows[i].constant
        for j, a in rows[i].coefficients.items():
            if j in known:
                total = total + a * known[j]
        right.append(-total)
    if len(states) == 1:
        return {states[0]: right[0] / rows[members[0]].coefficients[states[0]]}
    solved = np.linalg.solve(array(_matrix(rows, states, members)), array(right))
    return {j: plain_entry(rate) for j, rate in zip(states, solved, strict=True)}


def _matrix(rows: Sequence[AffineRow], states: Sequence[int], members: Sequence[int]) -> list[list[Any]]:
    return [[rows[i].coefficients.get(j, 0.0) for j in states] for i in members]


def _is_regular(matrix: list[list[Any]]) -> bool:
    """Whether the determinant has one sign and does not come near zero, within the bounds of its variables."""
    generator = np.random.default_rng(0)
    entries = [entry for row in matrix for entry in row]
    expressions = [entry for entry in entries if hasattr(entry, "is_expression_type")]
    leaves = {
        id(variable): generator.uniform(*_range(variable), _SAMPLES)
        for expression in expressions
        for variable in variables_in(expression)
    }
    evaluator = ExpressionEvaluator(leaves, _NUMPY_FUNCTIONS)
    try:
        with np.errstate(all="ignore"):
            values = [np.broadcast_to(evaluator.of(entry), _SAMPLES) for entry in entries]
            numbers = np.array(values, dtype=float).T.reshape(_SAMPLES, len(matrix), len(matrix))
            determinants = np.linalg.det(numbers)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return False
    sizes = np.abs(determinants)
    one_sign = bool((determinants > 0).all() or (determinants < 0).all())
    return bool(np.isfinite(determinants).all()) and one_sign and sizes.min() > _SMALLEST_DETERMINANT * sizes.max()


def _range(variable: Any) -> tuple[float, float]:
    """Where values of a variable are drawn from."""
    lower, upper = variable.bounds
    if lower is None and upper is None:
        return -3.0, 3.0
    if lower is None:
        return upper - 6.0, upper
    return lower, (lower + 6.0 if upper is None else upper)
