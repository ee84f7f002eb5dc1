"""The linear program with complementarity constraints around a point: which direction, if any, descends?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .branch import Branch, branch_with
from .linearisation import Linearisation
from .mixed_integer import minimise
from .problem import ComplementarityProgram

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Descent:
    """Answer of the linear program.

    Attributes
    ----------
    step : float array, shape (n,)
        At most the trust radius in each component.
    decrease : float
        By how much the linearised objective falls along it, per unit of the trust radius; never negative.
    branch : Branch
        The one that the step leads into.
    proven : bool
        Whether no step within the trust radius does better, to the solver's tolerance.
    open_pairs : int
        Number of pairs that could choose a side.
    """

    step: FloatArray
    decrease: float
    branch: Branch
    proven: bool
    open_pairs: int


def steepest_branch(
    program: ComplementarityProgram,
    point: Linearisation,
    radius: float,
    *,
    branch: Branch | None = None,
    elastic: float | None = None,
    time_limit: float = 5.0,
    node_limit: int | None = None,
    gap: float = 1e-6,
) -> Descent | None:
    """Minimise the linearised objective over the linearised feasible set within a trust region.

    ::

        min  grad f . d   s.t.  g_l <= g + J d <= g_u,  x_l <= x + d <= x_u,
                                0 <= a + a'd ⟂ b + b'd >= 0,  |d|_inf <= radius

    Every pair whose two sides are both within reach gets a binary variable. Where no direction descends as the radius
    shrinks, the point is B-stationary.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
    radius : float
        Of the trust region, in the units of the variables.
    branch : Branch, optional
        The branch to stay in: a linear program remains.
    elastic : float, optional
        Price of violating a linearised row, per unit; needed at a point that is not feasible. By default rows hold.
    time_limit : float
        Seconds.
    node_limit : int, optional
        Most nodes of the search tree.
    gap : float
        Relative distance from the optimum at which the search may stop.

    Returns
    -------
    Descent or None
        None where no step was found: the linearised constraints contradict each other, or time ran out.

    References
    ----------
    Nurkanovic & Leyffer (2025), A globally convergent method for computing B-stationary points of mathematical
    programs with equilibrium constraints, doi:10.48550/arXiv.2501.13835
    """
    nlp, n = point.nlp, point.nlp.n
    x = point.x
    # Lengths are measured in units of the radius: the solver's tolerances are absolute ones.
    lower = np.maximum(np.minimum((nlp.x_lower - x) / radius, 0.0), -1.0)
    upper = np.minimum(np.maximum((nlp.x_upper - x) / radius, 0.0), 1.0)
    a, b = np.maximum(program.a.values(x), 0.0) / radius, np.maximum(program.b.values(x), 0.0) / radius
    nearest = branch_with(program, a <= b) if branch is None else branch
    within = (np.maximum(a, b) <= 1.0) & ~program.a.constant & ~program.b.constant
    if branch is not None:
        within[:] = False
    for sides, zero, values in ((program.a, nearest.a_zero, a), (program.b, nearest.b_zero, b)):
        fixed = zero & ~within & ~sides.constant
        to_zero = np.clip(-sides.sign[fixed] * values[fixed], -1.0, 1.0)
        lower[sides.index[fixed]] = upper[sides.index[fixed]] = to_zero
    open_pairs = np.flatnonzero(within)
    count = open_pairs.size

    matrix, rows_lower, rows_upper = _rows(point, radius, loose=elastic is not None)
    slack = matrix.shape[0] if elastic is not None else 0
    binaries = scipy.sparse.csr_array((matrix.shape[0], count))
    slacks = [sign * scipy.sparse.eye_array(slack, format="csr") for sign in (1.0, -1.0) if slack]
    constraints = [(scipy.sparse.block_array([[matrix, binaries, *slacks]], format="csr"), rows_lower, rows_upper)]
    if count:
        pair_matrix, pair_lower, pair_upper = _pair_rows(program, open_pairs, a, b, n)
        no_slacks = scipy.sparse.csr_array((pair_matrix.shape[0], 2 * slack))
        wide = scipy.sparse.block_array([[pair_matrix, no_slacks]], format="csr")
        constraints.append((wide, pair_lower, pair_upper))
    answer, proven = minimise(
        np.concatenate([point.gradient, np.zeros(count), np.full(2 * slack, elastic or 0.0)]),
        np.concatenate([lower, np.zeros(count + 2 * slack)]),
        np.concatenate([upper, np.ones(count), np.full(2 * slack, np.inf)]),
        np.concatenate([np.zeros(n), np.ones(count), np.zeros(2 * slack)]),
        constraints,
        time_limit,
        node_limit,
        gap,
    )
    if answer is None:
        return None
    step = answer[:n]
    a_zero = nearest.a_zero.copy()
    a_zero[open_pairs] = answer[n : n + count] > 0.5
    decrease = max(0.0, -float(point.gradient @ step))
    return Descent(radius * step, decrease, branch_with(program, a_zero), proven, count)


def _rows(point: Linearisation, radius: float, *, loose: bool) -> tuple[csr_array, FloatArray, FloatArray]:
    """Linearised rows that some step can reach, with bounds that a zero step meets unless slacks will do it."""
    lower, upper = (point.nlp.g_lower - point.rows) / radius, (point.nlp.g_upper - point.rows) / radius
    if not loose:
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    farthest = abs(point.jacobian).sum(axis=1)
    kept = np.flatnonzero((lower > -farthest) | (upper < farthest))
    return point.jacobian[kept], lower[kept], upper[kept]


def _pair_rows(
    program: ComplementarityProgram, pairs: np.ndarray, a: FloatArray, b: FloatArray, n: int
) -> tuple[csr_array, FloatArray, FloatArray]:
    """``0 <= a + a'd <= (a + 1)(1 - y)`` and ``0 <= b + b'd <= (b + 1) y`` with one binary y per pair."""
    count = pairs.size
    numbers = np.arange(count)
    blocks, lower, upper = [], [], []
    for sides, values, y_factor, right in ((program.a, a, 1.0, 1.0), (program.b, b, -1.0, 0.0)):
        value = values[pairs]
        slope = scipy.sparse.csr_array((sides.sign[pairs], (numbers, sides.index[pairs])), shape=(count, n))
        choice = scipy.sparse.csr_array((y_factor * (value + 1.0), (numbers, numbers)), shape=(count, count))
        blocks += [
            scipy.sparse.block_array([[slope, scipy.sparse.csr_array((count, count))]], format="csr"),
            scipy.sparse.block_array([[slope, choice]], format="csr"),
        ]
        lower += [-value, np.full(count, -np.inf)]
        upper += [np.full(count, np.inf), right * (value + 1.0) - value]
    return scipy.sparse.vstack(blocks, format="csr"), np.concatenate(lower), np.concatenate(upper)
