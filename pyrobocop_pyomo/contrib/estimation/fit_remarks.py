"""What should be known before a fit is believed: an outlier, another unit, a fit that is far off, a coarse mesh."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import numpy as np

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import phases_of

from .problem import EstimationProblem

logger = logging.getLogger(__name__)

# Residuals that are larger by chance so rarely say that the errors were stated too small, or that the model is wrong.
RARE = 1e-3
# Data that many times what the model gives, or that part of it, are in another unit if both are alike to this share.
OTHER_UNIT, ALIKE = 20.0, 0.75
# In standard errors: an interval that is off by less still has nearly its level.
LARGE_SHIFT = 0.5
# A motion that is unstable runs away from its data without the feedback that it was measured with: what is shifted by
# more says nothing about the fit.
MOST_SHIFT = 100.0


def remarks_on_outputs(problem: EstimationProblem, residuals: Array, *, known: bool) -> Iterator[str]:
    """Outputs whose data and predictions are alike but for a large factor, or not alike where no errors say how far."""
    outputs = np.array([output for _, output in problem.output_of])
    for output in problem.outputs:
        measured, left = (of[(outputs == output) & np.isfinite(residuals)] for of in (problem.measured, residuals))
        predicted, size = measured - left, float(measured @ measured)
        times = float(measured @ predicted) / max(float(predicted @ predicted), np.finfo(float).tiny)
        alike = size - float(((measured - times * predicted) ** 2).sum()) >= ALIKE * size > 0.0
        if alike and not 1.0 / OTHER_UNIT < times < OTHER_UNIT:
            yield (
                f"the data of '{output}' are {times:.2g} times what the model gives: check their unit (degrees are "
                "57.3 times radians, millimetres 1000 times metres)"
            )
        elif not known and float(left @ left) > (1.0 - ALIKE) * size:
            yield (
                f"the fit is far from the data of '{output}': it leaves {left @ left / size:.0%} of the sum of their "
                "squares. Look for a datum that is wrong and for what the model lacks, or fit from another guess"
            )


def remarks_on_outlier(problem: EstimationProblem, residuals: Array, matrix: Array, *, known: bool) -> Iterator[str]:
    """The datum that is farther from the fit than the others explain, by its externally studentised residual.

    Parameters
    ----------
    problem : EstimationProblem
    residuals : array, shape (measurements,)
    matrix : array, shape (present measurements, free unknowns)
        Derivatives of the predictions, times the roots of the weights.
    known : bool
        Whether standard deviations were given.

    References
    ----------
    Cook & Weisberg, Residuals and Influence in Regression (1982), sec. 2.2
    """
    places = np.flatnonzero(np.isfinite(residuals))
    directions, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    seen = sizes > np.finfo(float).eps * len(places) * sizes.max(initial=0.0)
    share = np.maximum(1.0 - (directions[:, seen] ** 2).sum(axis=1), 0.0)  # of its own error that a residual shows
    freedom = len(places) - int(seen.sum())
    if freedom < 2:
        return
    with np.errstate(all="ignore"):
        squares = problem.weights[places] * residuals[places] ** 2
        stated = np.where(share > np.finfo(float).eps, squares / share, 0.0)
        square = freedom * stated / (stated @ share)
        deviations = np.sqrt(square * (freedom - 1) / np.maximum(freedom - square, 0.0))
    # Errors that were stated explain what they explain, however small the other residuals are.
    deviations = np.minimum(deviations, np.sqrt(stated)) if known else deviations
    worst = int(np.nan_to_num(deviations).argmax())
    datum = problem.measurements[places[worst]]
    when = "" if np.isnan(datum.time) else f" at t = {datum.time:g}"
    number = problem.measured[places[worst]]
    measured, fit = f"{number:.4g}", f"{number - residuals[places[worst]]:.4g}"
    is_rare = 2 * len(places) * scipy.special.stdtr(freedom - 1, -deviations[worst]) < RARE
    if is_rare and measured != fit:
        yield (
            f"'{datum.output}' of {datum.data_set}{when} is {measured}, the fit {fit}: {deviations[worst]:.0f} times "
            "the error that the others suggest. Look whether it is mistyped; the estimates follow it"
        )


def remarks_on_mesh(problem: EstimationProblem, matrix: Array, errors: Array) -> Iterator[str]:
    """Which estimate the mesh shifts most, where that is much and can be found out.

    Parameters
    ----------
    problem : EstimationProblem
        At its fit; it keeps its values.
    matrix : array, shape (measurements, unknowns)
        Derivatives of the predictions.
    errors : array, shape (unknowns,)
        Standard errors.
    """
    free = np.isfinite(errors) & (errors > 0.0)
    if not free.any() or any(experiment.phase is None for experiment in problem.experiments.values()):
        return
    fitted, before = VariableValues.of_all(problem.model), problem.predictions()
    try:
        _put_finer_motions(problem)
        change = problem.predictions() - before
    except PyRobocopError as error:
        logger.info("the error of the mesh is not known: %s", error)
        return
    finally:
        fitted.restore()
    present = np.isfinite(problem.measured) & np.isfinite(change)
    roots = np.sqrt(problem.weights[present])
    # As in the fit to first order, with the change of the predictions in place of the residuals.
    scaled = roots[:, None] * matrix[present][:, free] * errors[free]
    shifts = np.abs(np.linalg.lstsq(scaled, roots * change[present], rcond=None)[0])
    worst = int(shifts.argmax())
    if LARGE_SHIFT < shifts[worst] < MOST_SHIFT:
        yield (
            f"the mesh is coarse: a finer one would shift '{problem.names[np.flatnonzero(free)[worst]]}' by about "
            f"{shifts[worst]:.2g} of its standard errors; take more elements"
        )


def _put_finer_motions(problem: EstimationProblem) -> None:
    """Simulate each experiment on half the widths, and put the values on the model."""
    copy = problem.model.clone()
    copy.del_component(copy.squares)  # it reads variables that another mesh does not have
    for experiment in problem.experiments.values():
        for phase in phases_of(experiment.model):
            finer = copy.find_component(phase)
            finer.remesh(halves_of(phase.grid.mesh))
            phase.initialize(finer.simulate())
