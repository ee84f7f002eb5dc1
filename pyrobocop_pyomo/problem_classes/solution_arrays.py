"""A solution as the arrays that PyRoboCOP's ``parsesolution`` gives."""

from __future__ import annotations

import logging
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.numerics import Array

from .stated_problem import StatedProblem

logger = logging.getLogger(__name__)


class SolutionArrays(NamedTuple):
    """Values by element, variable and point; what unpacks into ``x, xdot, y, u, p``.

    Attributes
    ----------
    x : array, shape (N + 1, n_d, K + 1)
        States at the start of each element, then at its K points; at last the final state, in all columns.
    xdot : array, shape (N, n_d, K)
    y : array, shape (N, n_a, K)
    u : array, shape (N, n_u, K)
    p : array, shape (n_p,)
    """

    x: Array
    xdot: Array
    y: Array
    u: Array
    p: Array


def solution_arrays(model: Any) -> SolutionArrays:
    """The values that stand on a model of `from_pyrobocop`.

    Where the phase has got another mesh since, as by refinement, N is its number of elements, not that of the class;
    the log says so.

    Parameters
    ----------
    model : ConcreteModel

    Raises
    ------
    ProblemClassError
        When the model was not made by `from_pyrobocop`.
    """
    problem = getattr(model, "problem", None)
    if not isinstance(problem, StatedProblem):
        raise ProblemClassError(f"'{getattr(model, 'name', model)}' was not made by from_pyrobocop.")
    trajectory, sizes = model.phase.trajectory(), problem.data.sizes
    stages, boundaries = trajectory.grid.scheme.stages, np.array(trajectory.grid.mesh.boundaries)
    if len(boundaries) != len(sizes.times) or np.abs(boundaries - sizes.times).max() > 1e-9 * np.ptp(sizes.times):
        logger.warning(
            "%s: the phase has another mesh than the class: N = %d elements, where get_info says %d. Rows of the "
            "arrays belong to the times model.phase.grid.mesh.boundaries; model.phase.remesh(%s) leads back.",
            model.name,
            len(boundaries) - 1,
            sizes.elements,
            "model.problem.data.sizes.times",
        )

    def stacked(parts: list[Array], columns: int) -> Array:
        return np.stack(parts, axis=1) if parts else np.empty((len(boundaries) - 1, 0, columns))

    states = stacked([trajectory.element_states(name)[:, : stages + 1] for name in problem.names("x")], stages + 1)
    final = np.array([trajectory.states[name][-1] for name in problem.names("x")])
    return SolutionArrays(
        np.concatenate([states, np.repeat(final[None, :, None], stages + 1, axis=2)]),
        stacked([trajectory.element_rates(name) for name in problem.names("x")], stages),
        stacked([trajectory.element_signals(name) for name in problem.names("y")], stages),
        stacked([trajectory.element_signals(name) for name in problem.names("u")], stages),
        np.array([trajectory.parameters[name] for name in problem.names("p")]),
    )
