"""Sides of pairs chosen by binary variables: HiGHS finds good choices among many with its heuristics.

The branch and bound of `pair_tree` is quicker and proves sooner that there is nothing better nearby. A search that
reaches far finds a choice here where that tree ended at its limit without any.
"""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .linear_programs import LinearProgram
from .mixed_integer import minimise
from .pair_tree import BestSides, OpenSides


def best_sides_by_binaries(
    program: LinearProgram, a: OpenSides, b: OpenSides, *, time_limit: float, node_limit: int, gap: float
) -> BestSides:
    """Choose sides with one binary y per pair: ``a <= a_max (1 - y)`` and ``b <= b_max y``.

    Parameters
    ----------
    program : LinearProgram
        Without the condition that one side of each pair is zero; its bounds keep the sides nonnegative.
    a, b : OpenSides
        Of the pairs that may choose.
    time_limit : float
        Seconds.
    node_limit : int
        Most nodes of HiGHS's search tree.
    gap : float
        Relative distance from the optimum at which the search may stop.
    """
    n, count = program.cost.size, a.column.size
    matrix, lower, upper = program.rows
    wide = scipy.sparse.block_array([[matrix, scipy.sparse.csr_array((matrix.shape[0], count))]], format="csr")
    rows: list[tuple[object, FloatArray | float, FloatArray | float]] = [(wide, lower, upper)]
    numbers = np.arange(count)
    for sides, factor, right in ((a, 1.0, 1.0), (b, -1.0, 0.0)):
        farthest = np.where(sides.sign > 0.0, program.upper[sides.column], program.lower[sides.column])
        room = np.maximum(sides.sign * (farthest - sides.zero), 0.0)
        slope = scipy.sparse.csr_array((sides.sign, (numbers, sides.column)), shape=(count, n))
        choice = scipy.sparse.csr_array((factor * room, (numbers, numbers)), shape=(count, count))
        below = scipy.sparse.block_array([[slope, choice]], format="csr")
        rows.append((below, -np.inf, right * room + sides.sign * sides.zero))
    answer, proven, nodes = minimise(
        np.concatenate([program.cost, np.zeros(count)]),
        np.concatenate([program.lower, np.zeros(count)]),
        np.concatenate([program.upper, np.ones(count)]),
        np.concatenate([np.zeros(n), np.ones(count)]),
        rows,
        time_limit,
        node_limit,
        gap,
    )
    if answer is None:
        return BestSides(None, np.inf, np.zeros(count, dtype=bool), False, nodes)
    x = answer[:n]
    return BestSides(x, float(program.cost @ x), answer[n:] > 0.5, proven, nodes)
