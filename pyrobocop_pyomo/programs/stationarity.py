"""How far a point with multipliers is from stationary, whatever units the program is in."""

from __future__ import annotations

import contextlib

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics.characteristic_scales import objective_scale

from .nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint, finite, scattered

# Derivatives at a point may be zero by chance, as those of an objective at its minimum: they are taken about a tenth of
# each size beside it as well.
_STEP = 0.1
# Of the change of the objective by all variables: what is less tells nothing beside the rounding of all the rest.
_LEAST_SHARE = 1e-4


def stationarity(nlp: NonlinearProgram, point: PrimalDualPoint, sizes: FloatArray) -> float:
    r"""What first-order conditions leave, relative to the largest of the terms that have to balance.

    With the terms :math:`\partial f / \partial x_j`, :math:`\lambda_i \partial g_i / \partial x_j` and
    :math:`z_j` of the Lagrangian's derivative by a variable, at the point and a tenth of the sizes :math:`s` beside it,
    :math:`w_j` is :math:`s_j` times the largest. Compared with it are :math:`s_j` times the sum of these terms, and the
    multipliers of bounds and of rows times the distances from these. So nothing changes where the objective, a row or a
    variable is measured in another unit.

    Parameters
    ----------
    nlp : NonlinearProgram
    point : PrimalDualPoint
    sizes : float array, shape (n,)
        Of the variables at the point.

    Raises
    ------
    EvaluationError
        When a derivative does not exist at the point, or the multipliers are not finite.
    """
    multipliers, lower, upper = point.complete(nlp)
    rows, columns = nlp.jacobian_structure
    free = nlp.x_lower < nlp.x_upper
    gradients, jacobians = [nlp.gradient(point.x)], [nlp.jacobian(point.x)]
    x = beside(nlp, point.x, sizes)
    with contextlib.suppress(EvaluationError):  # what is known at the point has to do
        gradients, jacobians = [*gradients, nlp.gradient(x)], [*jacobians, nlp.jacobian(x)]
    with np.errstate(all="ignore"):  # what overflows is noticed in the result
        residual = gradients[0] - lower + upper
        np.add.at(residual, columns, jacobians[0] * multipliers[rows])
        terms = np.maximum(np.abs(lower), np.abs(upper))
        for gradient, jacobian in zip(gradients, jacobians, strict=True):
            terms = np.maximum(terms, np.abs(gradient))
            np.maximum.at(terms, columns, np.abs(jacobian * multipliers[rows]))
        weights = np.maximum(terms * sizes, _LEAST_SHARE * objective_scale(np.array(gradients), sizes))
        of_bounds = np.abs(lower) * np.minimum(point.x - nlp.x_lower, sizes)
        of_bounds = np.maximum(of_bounds, np.abs(upper) * np.minimum(nlp.x_upper - point.x, sizes))
        found = (np.maximum(np.abs(residual) * sizes, of_bounds) / weights)[free]
        values = nlp.constraints(point.x)
        reach, weight = np.zeros(nlp.m), np.zeros(nlp.m)
        np.maximum.at(reach, rows, np.abs(jacobians[0]) * sizes[columns])
        np.maximum.at(weight, rows, weights[columns])
        slack = np.where(multipliers > 0.0, nlp.g_upper - values, values - nlp.g_lower)
        there = weight > 0.0
        of_rows = np.abs(multipliers[there]) * np.minimum(np.abs(slack), reach)[there] / weight[there]
        found = finite(np.concatenate([found, of_rows]), nlp.derivatives, "gradient of the Lagrangian")
    return float(found.max(initial=0.0))


def beside(nlp: NonlinearProgram, x: FloatArray, sizes: FloatArray) -> FloatArray:
    """A point about a tenth of each size away, within the bounds; every variable goes its own way."""
    steps = _STEP * sizes * (0.5 + scattered(nlp.n))
    up = x + steps
    return np.clip(np.where(up <= nlp.x_upper, up, x - steps), nlp.x_lower, nlp.x_upper)
