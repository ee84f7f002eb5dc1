"""`FitStatistics`: what a fit is worth, from the residuals and the sensitivities at its point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.presentation import Presented

from .fit_remarks import RARE, remarks_on_outlier, remarks_on_outputs
from .problem import EstimationProblem


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
        """Of the estimates, shape (unknowns, unknowns); NaN where a variance is zero or not finite."""
        with np.errstate(all="ignore"):
            found: Array = self.covariance / np.outer(self.standard_errors, self.standard_errors)
        return np.where(np.isfinite(found), found, np.nan)

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


def statistics_of(problem: EstimationProblem) -> FitStatistics:
    """Statistics at the values that stand on the model.

    Parameters
    ----------
    problem : EstimationProblem
        At a fit.
    """
    remarks: list[str] = []
    residuals = problem.measured - problem.predictions()
    matrix = np.full((len(residuals), len(problem.unknowns)), np.nan)
    biactive: list[str] = []
    try:
        matrix, biactive = problem.sensitivities.at_current_values()
    except EvaluationError as error:
        remarks.append(f"no standard errors: {error}")
    if biactive:
        others = f" and of {len(biactive) - 1} more" if len(biactive) > 1 else ""
        remarks.append(
            f"both sides of {biactive[0]}{others} are zero: standard errors hold to one side of the estimates"
        )
    present, known = np.isfinite(residuals), bool(np.isfinite(problem.deviations).all())
    roots = np.sqrt(problem.weights[present])
    rows, left = roots[:, None] * matrix[present], roots * residuals[present]
    # How far each unknown alone is from the least sum of squares, to first order; 0 where that is not known.
    curvature = (rows**2).sum(axis=0)
    steps = np.divide(left @ rows, curvature, where=curvature > 0.0, out=np.zeros(len(curvature)))
    unknowns = zip(problem.unknowns, steps.tolist(), strict=True)
    free = np.array([not _is_at_bound(unknown.variable, step) for unknown, step in unknowns], dtype=bool)
    freedom, squares = int(present.sum()) - int(free.sum()), float(left @ left)
    variance = 1.0 if known else squares / max(freedom, 1)
    covariance = np.full((len(free), len(free)), np.nan)
    if not known and freedom <= 0:
        remarks.append(
            f"no standard errors: {present.sum()} measurements say nothing of their scatter with {free.sum()} "
            "unknowns; give error="
        )
    elif np.isfinite(rows).all():
        covariance[np.ix_(free, free)] = covariance_of(rows[:, free], variance)
        remarks += remarks_on_outlier(problem, residuals, rows[:, free], known=known)
    if known and freedom > 0 and squares > scipy.stats.chi2.isf(RARE, freedom):
        remarks.append(
            f"the residuals are {np.sqrt(squares / freedom):.2g} times as large as the errors that were stated, and "
            "the standard errors are too small by about as much: state larger errors, or look for what the model lacks"
        )
    remarks += remarks_on_outputs(problem, residuals, known=known)
    return FitStatistics(
        names=tuple(problem.names),
        estimates=problem.estimates(),
        covariance=covariance,
        residuals=residuals,
        freedom=None if known else max(freedom, 0),
        sum_of_squares=squares,
        matrix=matrix,
        at_bound=tuple(name for name, is_free in zip(problem.names, free, strict=True) if not is_free),
        remarks=tuple(remarks),
    )


def _is_at_bound(variable: Any, step: float) -> bool:
    """Whether a bound holds an unknown: it is as good as there, by its size or by the step that the data ask for."""
    number = variable.value
    return any(
        bound is not None and abs(number - bound) <= MET * max(abs(number), abs(bound), towards * step)
        for bound, towards in zip(variable.bounds, (-1.0, 1.0), strict=True)
    )


def covariance_of(matrix: Array, variance: float = 1.0) -> Array:
    """Covariance of a least-squares estimate of unknowns, to first order.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives S of the outputs, each over its standard deviation, or over what is in proportion to it.
    variance : float
        Of the outputs after this division.

    Returns
    -------
    array, shape (unknowns, unknowns)
        ``variance (S'S)^-1``; infinite in what the data do not see.
    """
    sizes = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    # By the singular values of S and not by the inverse of S'S, which has twice as few digits.
    _, values, right = np.linalg.svd(matrix / sizes, full_matrices=len(matrix) < len(sizes))
    rank = int((values > 1e-11 * values.max(initial=1e-300)).sum())
    root = (right[:rank].T / values[:rank]) / sizes[:, None]
    found: Array = variance * root @ root.T
    # An unknown that takes part in a combination that is not seen may be anything.
    unseen = np.flatnonzero(np.abs(right[rank:]).max(axis=0, initial=0.0) > 1e-6)
    found[unseen, :] = found[:, unseen] = np.nan
    found[unseen, unseen] = np.inf
    return found


def quantile(level: float, freedom: int | None) -> float:
    """How many standard errors an interval reaches to either side; Student's t with a freedom, else normal."""
    tail = 0.5 + level / 2
    return float(scipy.special.ndtri(tail) if freedom is None else scipy.special.stdtrit(max(freedom, 1), tail))
