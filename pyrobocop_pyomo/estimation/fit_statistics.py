"""`FitStatistics`: what a fit is worth, from the residuals and the sensitivities at its point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, SensitivityError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.presentation import Presented, table

from .problem import EstimationProblem
from .statistics import correlation_of, covariance_of, quantile

# An unknown this near to a bound, relative to its size, is held by it.
_AT_BOUND = 1e-6
# Residuals that are larger by chance so rarely say that the errors were stated too small, or that the model is wrong.
_RARE = 1e-3
# Data that many times what the model gives, or that part of it, are in another unit if both are alike to this share.
_OTHER_UNIT, _ALIKE = 20.0, 0.75


@dataclass(frozen=True, eq=False)
class FitStatistics(Presented):
    """Estimates with their uncertainty, to first order at the point of the fit.

    Attributes
    ----------
    names : tuple of str
    estimates : array, shape (unknowns,)
    covariance : array, shape (unknowns, unknowns)
        NaN for what a bound holds, infinite where the data do not see the unknowns.
    residuals : array, shape (measurements,)
        Measured less predicted; NaN where nothing was measured.
    freedom : int or None
        Degrees of freedom of the estimated variance; None where standard deviations were given.
    sum_of_squares : float
        Of the residuals, weighted: each over its standard deviation where these were given.
    matrix : array, shape (measurements, unknowns)
        Derivatives of the predictions.
    at_bound : tuple of str
        Unknowns that are held by a bound.
    remarks : tuple of str
        What limits these statistics.
    """

    names: tuple[str, ...]
    estimates: Array
    covariance: Array
    residuals: Array
    freedom: int | None
    sum_of_squares: float
    matrix: Array
    at_bound: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    @property
    def standard_errors(self) -> Array:
        """Of the estimates, shape (unknowns,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Of the estimates, shape (unknowns, unknowns)."""
        return correlation_of(self.covariance)

    def intervals(self, level: float = 0.95) -> Array:
        """Confidence intervals, shape (unknowns, 2): normal, or Student's t where the variance is estimated.

        Parameters
        ----------
        level : float
            Between 0 and 1.
        """
        reach = quantile(level, self.freedom) * self.standard_errors
        return np.column_stack([self.estimates - reach, self.estimates + reach])

    def _summary(self) -> str:
        pairs = zip(self.names, self.estimates, self.standard_errors, strict=True)
        return ", ".join(f"{name} = {value:.5g} +- {error:.2g}" for name, value, error in pairs)

    def _html_parts(self) -> list[str]:
        rows = list(zip(self.names, map(float, self.estimates), map(float, self.standard_errors), strict=True))
        return [table(("unknown", "estimate", "standard error"), rows)]


def statistics_of(problem: EstimationProblem) -> FitStatistics:
    """Statistics at the values that stand on the model.

    Parameters
    ----------
    problem : EstimationProblem
        At a fit.
    """
    remarks: list[str] = []
    estimates = problem.estimates()
    residuals = problem.measured - problem.predictions()
    present = np.isfinite(residuals)
    squares = float((problem.weights[present] * residuals[present] ** 2).sum())
    at_bound = np.array([_is_at_bound(unknown.variable) for unknown in problem.unknowns], dtype=bool)
    count = len(problem.unknowns)
    covariance = np.full((count, count), np.nan)
    matrix = np.full((len(residuals), count), np.nan)
    free = ~at_bound
    freedom = int(present.sum()) - int(free.sum())
    variances, known = _variances(problem, residuals, present, freedom, squares)
    try:
        derivatives = problem.sensitivities.at_current_values()
    except (SensitivityError, EvaluationError) as error:
        remarks.append(f"no standard errors: {error}")
    else:
        matrix = derivatives.matrix
        if derivatives.biactive:
            count_of_others = len(derivatives.biactive) - 1
            others = f" and of {count_of_others} more" if count_of_others else ""
            remarks.append(
                f"both sides of {derivatives.biactive[0]}{others} are zero: standard errors hold to one side of the "
                "estimates"
            )
        if derivatives.undetermined:
            remarks.append(
                f"{derivatives.undetermined} variables are determined by the data alone; standard errors are those for "
                "known values of them"
            )
        covariance[np.ix_(free, free)] = covariance_of(
            matrix[present][:, free], problem.weights[present], variances[present]
        )
    if not known and freedom <= 0:
        covariance[np.ix_(free, free)] = np.nan
        remarks.append(
            f"no standard errors: {present.sum()} measurements say nothing of their scatter with {free.sum()} "
            "unknowns; give error="
        )
    if known and freedom > 0 and squares > scipy.stats.chi2.isf(_RARE, freedom):
        remarks.append(
            f"the residuals are {np.sqrt(squares / freedom):.2g} times as large as the errors that were stated, and "
            "the standard errors are too small by about as much: state larger errors, or look for what the model lacks"
        )
    remarks += _other_units(problem, residuals, present)
    names = tuple(problem.names)
    return FitStatistics(
        names=names,
        estimates=estimates,
        covariance=covariance,
        residuals=residuals,
        freedom=None if known else max(freedom, 0),
        sum_of_squares=squares,
        matrix=matrix,
        at_bound=tuple(name for name, held in zip(names, at_bound, strict=True) if held),
        remarks=tuple(remarks),
    )


def _other_units(problem: EstimationProblem, residuals: Array, present: Array) -> Iterator[str]:
    """Outputs whose data and predictions are alike but for a large factor."""
    outputs = np.array([output for _, output in problem.output_of])
    for output in problem.outputs:
        measured, left = (of[(outputs == output) & present] for of in (problem.measured, residuals))
        predicted, size = measured - left, float(measured @ measured)
        times = float(measured @ predicted) / max(float(predicted @ predicted), np.finfo(float).tiny)
        alike = size - float(((measured - times * predicted) ** 2).sum()) >= _ALIKE * size > 0.0
        if alike and not 1.0 / _OTHER_UNIT < times < _OTHER_UNIT:
            yield (
                f"the data of '{output}' are {times:.2g} times what the model gives: check their unit (degrees are "
                "57.3 times radians, millimetres 1000 times metres)"
            )


def _variances(
    problem: EstimationProblem, residuals: Array, present: Array, freedom: int, squares: float
) -> tuple[Array, bool]:
    """Variances of the errors, and whether they were given."""
    if np.isfinite(problem.deviations[present]).all():
        return problem.deviations**2, True
    share = max(freedom, 1) / max(int(present.sum()), 1)
    if problem.criterion == "least squares":
        # One variance for all, as the plain sum of squares assumes.
        return np.full(len(residuals), squares / max(freedom, 1)), False
    variances = np.ones(len(residuals))
    outputs = np.array([output for _, output in problem.output_of])
    for output in problem.outputs:
        places = (outputs == output) & present
        if places.any():
            variances[outputs == output] = float((residuals[places] ** 2).mean()) / share
    return variances, False


def _is_at_bound(variable: object) -> bool:
    number = variable.value  # type: ignore[attr-defined]
    return any(
        bound is not None and abs(number - bound) <= _AT_BOUND * max(abs(number), abs(bound), 1e-6)
        for bound in variable.bounds  # type: ignore[attr-defined]
    )
