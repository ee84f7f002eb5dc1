"""Relaxed choices over intervals, rounded to one choice in each: combinatorial integral approximation.

A choice between ``n`` alternatives has weights that sum to 1 in each of ``N`` intervals. What a differential equation
sees of them are their integrals. So the rounded choice is one whose accumulated weights stay near the relaxed ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.optional_imports import scipy

from .arrays import Array
from .linear_programs import LinearProgram, Rows


@dataclass(frozen=True, eq=False)
class IntegralApproximation:
    """One alternative in each interval.

    Attributes
    ----------
    choice : array of int, shape (N,)
        Number of the alternative in each interval.
    gap : float
        Largest difference of the accumulated weights from the relaxed ones, in units of time.
    bound : float or None
        What the gap is at most, whatever the weights are; None where switches were limited.
    """

    choice: Array
    gap: float
    bound: float | None

    @property
    def switches(self) -> int:
        """How often the alternative changes."""
        return int(np.count_nonzero(np.diff(self.choice)))


def integral_gap(weights: ArrayLike, choice: ArrayLike, widths: ArrayLike) -> float:
    """Largest difference of accumulated weights, over all alternatives and interval ends.

    Parameters
    ----------
    weights : array, shape (n, N)
    choice : array of int, shape (N,)
    widths : array, shape (N,)
    """
    relaxed = np.asarray(weights, dtype=float)
    rounded = np.asarray(choice)[None, :] == np.arange(len(relaxed))[:, None]
    return float(np.abs(np.cumsum((relaxed - rounded) * np.asarray(widths, dtype=float), axis=1)).max(initial=0.0))


def sum_up_rounding(weights: ArrayLike, widths: ArrayLike) -> IntegralApproximation:
    """In each interval the alternative that is farthest behind its relaxed weight.

    Parameters
    ----------
    weights : array, shape (n, N)
        Not negative; the weights of an interval sum to 1.
    widths : array, shape (N,)
        Of the intervals.

    Returns
    -------
    IntegralApproximation
        Its gap is at most half of the largest width for two alternatives, and ``n - 1`` times the largest width for
        more.

    References
    ----------
    Sager, Bock & Diehl, The integer approximation error in mixed-integer optimal control, Math. Program. 133 (2012),
    thm. 5 and 6, doi:10.1007/s10107-010-0405-3
    """
    relaxed, steps = np.asarray(weights, dtype=float), np.asarray(widths, dtype=float)
    behind = np.zeros(len(relaxed))
    choice = np.zeros(len(steps), dtype=int)
    for k, width in enumerate(steps.tolist()):
        behind += relaxed[:, k] * width
        choice[k] = int(behind.argmax())
        behind[choice[k]] -= width
    factor = 0.5 if len(relaxed) == 2 else len(relaxed) - 1.0
    return IntegralApproximation(choice, integral_gap(relaxed, choice, steps), factor * float(steps.max(initial=0.0)))


def limited_approximation(
    weights: ArrayLike,
    widths: ArrayLike,
    *,
    max_switches: int | None = None,
    min_dwell: float = 0.0,
) -> IntegralApproximation | None:
    """The choice of the smallest gap among those that switch seldom enough, or the best one found in 20 seconds.

    It is that of a mixed-integer linear program.

    Parameters
    ----------
    weights : array, shape (n, N)
    widths : array, shape (N,)
    max_switches : int, optional
        How often the alternative may change.
    min_dwell : float
        How long an alternative stays at least once it is chosen, as far as the horizon goes.

    Returns
    -------
    IntegralApproximation or None
        None where nothing was found in time.

    References
    ----------
    Sager, Jung & Kirches, Combinatorial integral approximation, Math. Methods Oper. Res. 73 (2011),
    doi:10.1007/s00186-011-0355-4
    """
    relaxed, steps = np.asarray(weights, dtype=float), np.asarray(widths, dtype=float)
    alternatives, intervals = relaxed.shape
    size = alternatives * intervals
    starts = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    accumulated = np.cumsum(relaxed * steps, axis=1).ravel()
    one, all_before = np.eye(intervals), np.tril(np.ones((intervals, intervals))) * steps
    # Unknowns: choices, then whether an alternative begins in an interval, then the gap.
    unknowns = scipy.sparse.identity(2 * size + 1, format="csr")
    choices, begins, gap = unknowns[:size], unknowns[size : 2 * size], unknowns[np.full(size, 2 * size)]

    def of_each(block: Array) -> Any:
        return scipy.sparse.kron(scipy.sparse.identity(alternatives), block, format="csr")

    rows: list[Rows] = [
        (scipy.sparse.csr_matrix(np.tile(one, alternatives)) @ choices, 1.0, 1.0),
        (of_each(all_before) @ choices - gap, -np.inf, accumulated),
        (of_each(all_before) @ choices + gap, accumulated, np.inf),
        (of_each(one[1:]) @ begins - of_each(one[1:] - one[:-1]) @ choices, 0.0, np.inf),
    ]
    stays = (starts < (starts + min_dwell - 1e-9 * steps)[:, None]) & (np.arange(intervals)[:, None] > 0)
    begun, after = np.nonzero(np.triu(stays, 1))
    rows.append((of_each(one[after]) @ choices - of_each(one[begun]) @ begins, 0.0, np.inf))
    if max_switches is not None:
        later = np.tile(np.arange(intervals) > 0, alternatives).astype(float)
        rows.append((scipy.sparse.csr_matrix(later) @ begins, -np.inf, float(max_switches)))
    # Switches that gain nothing cost a little.
    cost = np.concatenate([np.zeros(size), np.full(size, 1e-6 * float(steps.mean()) / max(size, 1)), [1.0]])
    largest = np.append(np.ones(2 * size), np.inf)
    program = LinearProgram(cost, np.zeros(2 * size + 1), largest, rows, np.arange(2 * size + 1) < size)
    found = program.solve(Deadline.after(20.0)).x
    if found is None:
        return None
    choice = found[:size].reshape(alternatives, intervals).argmax(axis=0)
    return IntegralApproximation(choice, integral_gap(relaxed, choice, steps), None)
