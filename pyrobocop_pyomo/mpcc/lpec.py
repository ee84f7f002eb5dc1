"""The linear program with complementarity constraints around a point: which direction, if any, descends?"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .branch import Branch, branch_with
from .linear_programs import LinearProgram
from .linearisation import Linearisation
from .pair_tree import OpenSides, PairTree
from .problem import ComplementarityProgram, Sides
from .side_binaries import best_sides_by_binaries

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Linear programs that one search may take where nothing else is said.
NODES = 1000


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
    gain : float
        By how much the decrease exceeds that of staying in a branch, where one was given to stay in; at least 0.
    """

    step: FloatArray
    decrease: float
    branch: Branch
    proven: bool
    open_pairs: int
    gain: float


def steepest_branch(
    program: ComplementarityProgram,
    point: Linearisation,
    radius: float,
    *,
    stay: Branch | None = None,
    least_gain: float = 0.0,
    elastic: float | None = None,
    time_limit: float = 5.0,
    node_limit: int = NODES,
    gap: float = 1e-6,
    by_binaries: bool = False,
    on_nodes: Callable[[int], object] | None = None,
) -> Descent | None:
    """Minimise the linearised objective over the linearised feasible set within a trust region.

    ::

        min  grad f . d   s.t.  g_l <= g + J d <= g_u,  x_l <= x + d <= x_u,
                                0 <= a + a'd ⟂ b + b'd >= 0,  |d|_inf <= radius

    Every pair whose two sides are both within reach may choose. Where no direction descends as the radius shrinks, the
    point is B-stationary.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
    radius : float
        Of the trust region, in the units of the variables.
    stay : Branch, optional
        A branch through the point: only what descends more than this one is looked for.
    least_gain : float
        By how much more, per unit of the radius.
    elastic : float, optional
        Price of violating a linearised row, per unit; needed at a point that is not feasible. By default rows hold.
    time_limit : float
        Seconds.
    node_limit : int
        Most linear programs: unlike seconds, the same on a busy machine.
    gap : float
        Relative distance from the optimum at which the search may stop.
    by_binaries : bool
        Whether HiGHS chooses the sides, with its heuristics, where the search has found no choice within its limit.
    on_nodes : callable, optional
        Told how many linear programs it took.

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
    nearest = branch_with(program, a <= b) if stay is None else stay
    within = (np.maximum(a, b) <= 1.0) & ~program.a.constant & ~program.b.constant
    for sides, zero, values in ((program.a, nearest.a_zero, a), (program.b, nearest.b_zero, b)):
        fixed = zero & ~within & ~sides.constant
        to_zero = np.clip(-sides.sign[fixed] * values[fixed], -1.0, 1.0)
        lower[sides.index[fixed]] = upper[sides.index[fixed]] = to_zero
    open_pairs = np.flatnonzero(within)

    matrix, rows_lower, rows_upper = _rows(point, radius, loose=elastic is not None)
    slack = matrix.shape[0] if elastic is not None else 0
    if slack:
        slacks = [sign * scipy.sparse.eye_array(slack, format="csr") for sign in (1.0, -1.0)]
        matrix = scipy.sparse.block_array([[matrix, *slacks]], format="csr")
    linear = LinearProgram(
        np.concatenate([point.gradient, np.full(2 * slack, elastic or 0.0)]),
        np.concatenate([lower, np.zeros(2 * slack)]),
        np.concatenate([upper, np.full(2 * slack, np.inf)]),
        [(matrix, rows_lower, rows_upper)],
    )
    open_a, open_b = (
        _open_sides(sides, values, open_pairs, linear) for sides, values in ((program.a, a), (program.b, b))
    )
    tree = PairTree(linear, open_a, open_b, nearest.a_zero[open_pairs], time_limit)
    staying, ceiling = 0.0, np.inf
    if stay is not None and open_pairs.size:
        # Where rounding keeps any step from it, there is still the step of length zero.
        staying = min(0.0, tree.cost_of(stay.a_zero[open_pairs], stay.b_zero[open_pairs]))
        ceiling = staying - least_gain
    started = time.perf_counter()
    best = tree.search(ceiling=ceiling, node_limit=node_limit, gap=gap)
    left = time_limit - (time.perf_counter() - started)
    if by_binaries and best.x is None and not best.proven and left > 0.0:
        best = best_sides_by_binaries(linear, open_a, open_b, time_limit=left, node_limit=node_limit, gap=gap)
    if on_nodes is not None:
        on_nodes(best.nodes)
    if best.x is None:
        if stay is None or not open_pairs.size:
            return None
        return Descent(np.zeros(n), -staying, stay, best.proven, open_pairs.size, 0.0)
    step = best.x[:n]
    a_zero = nearest.a_zero.copy()
    a_zero[open_pairs] = best.a_zero
    cost = float(point.gradient @ step)
    return Descent(
        radius * step,
        max(0.0, -cost),
        branch_with(program, a_zero),
        best.proven,
        open_pairs.size,
        max(0.0, staying - cost) if stay is not None and open_pairs.size else 0.0,
    )


def _open_sides(sides: Sides, values: FloatArray, pairs: np.ndarray, linear: LinearProgram) -> OpenSides:
    """The sides of pairs that may choose, in the variables of the linear program."""
    column = sides.index[pairs]
    zero = np.clip(-sides.sign[pairs] * values[pairs], linear.lower[column], linear.upper[column])
    return OpenSides(column, sides.sign[pairs], zero)


def _rows(point: Linearisation, radius: float, *, loose: bool) -> tuple[csr_array, FloatArray, FloatArray]:
    """Linearised rows that some step can reach, with bounds that a zero step meets unless slacks will do it."""
    lower, upper = (point.nlp.g_lower - point.rows) / radius, (point.nlp.g_upper - point.rows) / radius
    if not loose:
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    farthest = abs(point.jacobian).sum(axis=1)
    kept = np.flatnonzero((lower > -farthest) | (upper < farthest))
    return point.jacobian[kept], lower[kept], upper[kept]
