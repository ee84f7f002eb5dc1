"""Of which size variables, rows and an objective typically are, from known sizes and derivatives; arrays only.

Variables and rows come in groups, as all values of a state over time: a group has one scale. All scales follow a change
of units exactly: a length in feet instead of metres gets 3.28 times the scale, and the scaled problem stays the
same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

Integers = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class GroupedEntries:
    """Derivatives of rows by variables, with the groups of both.

    Attributes
    ----------
    rows, columns : int array, shape (entries,)
        Numbers of rows and variables.
    values : float array, shape (points, entries)
        Derivatives at one or more points; NaN where there is none.
    row_groups : int array, shape (m,)
    column_groups : int array, shape (n,)
    own : int array, shape (groups of rows,)
        For the collocation rows of a state the group of its values, -1 for other rows.
    """

    rows: Integers
    columns: Integers
    values: Array
    row_groups: Integers
    column_groups: Integers
    own: Integers


def sizes_of_groups(guesses: Array, widths: Array) -> Array:
    r"""Scales of variables, by their largest guesses and the distances of their bounds.

    The geometric mean :math:`\sqrt{g w}` of both: bounds are often much wider than what happens between them, and
    guesses are often as simple as 1.

    Parameters
    ----------
    guesses : float array, shape (groups,)
        Largest magnitude of a value; 0 says nothing.
    widths : float array, shape (groups,)
        Distance of the bounds; infinite or 0 says nothing.

    Returns
    -------
    float array, shape (groups,)
        NaN where neither says anything.
    """
    numbers = np.array([guesses, widths], dtype=float)
    says = (numbers > 0.0) & (numbers < np.inf)
    with np.errstate(invalid="ignore"):
        return np.exp(np.log(np.where(says, numbers, 1.0)).sum(axis=0) / says.sum(axis=0))


def variable_scales(known: Array, entries: GroupedEntries) -> Array:
    """Scales of all groups of variables: where one is not known, the rows tell.

    In ``D x - h v = 0`` with a known scale of x, v is of the size that moves x by its scale over the whole horizon.

    Parameters
    ----------
    known : float array, shape (groups,)
        NaN where a scale is not known.
    entries : GroupedEntries

    Returns
    -------
    float array, shape (groups,)
        NaN where no row with a derivative connects a group with a known scale.
    """
    scales = known.copy()
    row_group, column_group, sizes = _group_entries(entries)
    while np.isnan(scales).any():
        terms = sizes * scales[column_group]  # NaN where a scale is not known
        there = ~np.isnan(terms)
        largest = np.zeros(entries.own.size)
        np.maximum.at(largest, row_group[there], terms[there])
        told = ~there & (largest[row_group] > 0.0)
        smallest = np.full(scales.size, np.inf)
        np.minimum.at(smallest, column_group[told], largest[row_group[told]] / sizes[told])
        new = np.isnan(scales) & np.isfinite(smallest)
        if not new.any():
            break
        scales[new] = smallest[new]
    return scales


def row_scales(scales: Array, entries: GroupedEntries, right_hand_sides: Array) -> Array:
    """Scales of all groups of rows, of variables that have scales.

    Collocation rows of a state are of its size. Others are of the size of their largest term, linearised: the median
    over the rows of a group, so that a singular point does not decide. Rows without a derivative have the size of
    their right-hand side.

    Parameters
    ----------
    scales : float array, shape (groups of variables,)
    entries : GroupedEntries
    right_hand_sides : float array, shape (m,)
        Magnitude of the finite bounds of each row; 0 where there is none.

    Returns
    -------
    float array, shape (groups of rows,)
    """
    with np.errstate(over="ignore"):  # what is not finite does not count
        terms = np.abs(entries.values) * scales[entries.column_groups[entries.columns]]
    largest = np.zeros(entries.row_groups.size)
    for at_point in terms:
        good = np.isfinite(at_point)
        np.maximum.at(largest, entries.rows[good], at_point[good])
    count = entries.own.size
    by_terms = _medians(entries.row_groups, largest, count)
    by_right_hand_side = _medians(entries.row_groups, right_hand_sides, count)
    found = np.where(by_terms > 0.0, by_terms, np.where(by_right_hand_side > 0.0, by_right_hand_side, 1.0))
    return np.where(entries.own >= 0, scales[entries.own], found)


def objective_scale(gradients: Array, scales: Array) -> float:
    """By how much an objective changes when all variables change by their scales, linearised.

    Parameters
    ----------
    gradients : float array, shape (points, n)
        NaN where there is none.
    scales : float array, shape (n,)

    Returns
    -------
    float
        1 where the gradients are zero.
    """
    sums = np.abs(gradients * scales).sum(axis=1)
    sums = sums[np.isfinite(sums)]
    largest = float(sums.max(initial=0.0))
    return largest if largest > 0.0 else 1.0


def _group_entries(entries: GroupedEntries) -> tuple[Integers, Integers, Array]:
    """Group of rows, group of columns and median size of the derivatives, where there are any."""
    row_group = entries.row_groups[entries.rows]
    column_group = entries.column_groups[entries.columns]
    sizes = np.abs(np.where(np.isfinite(entries.values), entries.values, 0.0)).max(axis=0, initial=0.0)
    # Rows of a state hold what changes it times the width of an element: all of them together move it.
    rows_of_group = np.bincount(entries.row_groups, minlength=entries.own.size)
    foreign = (entries.own[row_group] >= 0) & (entries.own[row_group] != column_group)
    sizes = np.where(foreign, sizes * rows_of_group[row_group], sizes)
    width = int(column_group.max(initial=0)) + 1
    keys, numbers = np.unique(row_group * width + column_group, return_inverse=True)
    medians = _medians(numbers.ravel(), sizes, keys.size)
    kept = medians > 0.0
    return keys[kept] // width, keys[kept] % width, medians[kept]


def _medians(groups: Integers, values: Array, count: int) -> Array:
    """Median of the positive values of each group; 0 where it has none."""
    order = np.lexsort((values, groups))
    order = order[values[order] > 0.0]
    groups, values = groups[order], np.append(values[order], 0.0)
    first = np.searchsorted(groups, np.arange(count), side="left")
    after = np.searchsorted(groups, np.arange(count), side="right")
    return np.where(after > first, values[(first + after - 1) // 2], 0.0)
