"""Linear programs, some with binary variables, by HiGHS through SciPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.ipopt.c_output import c_output_muted
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray


def prepare() -> None:
    """Import the solver, which takes longer than it does for a small program."""
    _ = scipy.optimize.milp


def minimise(
    cost: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    binary: FloatArray,
    constraints: Sequence[tuple[Any, FloatArray | float, FloatArray | float]],
    time_limit: float,
    node_limit: int | None = None,
    gap: float = 1e-6,
) -> tuple[FloatArray | None, bool, int]:
    """Minimise ``cost @ x``.

    Parameters
    ----------
    cost, lower, upper, binary : float array, shape (n,)
        Costs and bounds; 1 where a variable is an integer, else 0.
    constraints : sequence of (matrix, lower, upper)
        Rows ``lower <= matrix @ x <= upper``; a matrix without rows is left out.
    time_limit : float
        Seconds.
    node_limit : int, optional
        Most nodes of the search tree: unlike seconds, the same on a busy machine.
    gap : float
        Relative distance from the optimum at which the search may stop.

    Returns
    -------
    float array or None
        The best point found.
    bool
        Whether it is the optimum, to the solver's tolerances.
    int
        Nodes of the search tree; at least 1.
    """
    rows = [scipy.optimize.LinearConstraint(*some) for some in constraints if some[0].shape[0]]
    # HiGHS now and then prints a line, whatever its options are.
    with c_output_muted():
        result = scipy.optimize.milp(
            cost,
            integrality=binary,
            bounds=scipy.optimize.Bounds(lower, np.maximum(lower, upper)),
            constraints=rows or None,
            options={"time_limit": time_limit, "mip_rel_gap": gap, "node_limit": node_limit},
        )
    return result.x, result.status == 0, max(1, int(result.mip_node_count or 0))
