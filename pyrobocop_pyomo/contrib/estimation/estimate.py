"""`estimate`: parameters of labelled models from data, with pairs or without, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.variable_values import VariableValues, put_values
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import MET, NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import pandas, scipy
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.studies.outcomes import solve_as_given

from .problem import EstimationProblem

# Residuals that are larger by chance so rarely say that the errors were stated too small, or that the model is wrong.
RARE = 1e-3


@dataclass(frozen=True, eq=False)
class EstimationResult(Presented):
    """Estimates with their uncertainty, to first order at the point of a fit; printing it shows a table.

    Attributes
    ----------
    problem : EstimationProblem
        Its model holds the fit.
    estimates : Series
        By the name of the unknown.
    covariance : DataFrame
        Of the estimates; NaN for what a bound holds, infinite where the data do not see the unknowns.
    residuals : DataFrame
        The data of the problem, with predictions and residuals: measured less predicted.
    freedom : int or None
        Degrees of freedom of the estimated variance; None where standard deviations were given.
    sum_of_squares : float
        Of the residuals, weighted: each over its standard deviation where these were given.
    at_bound : tuple of str
        Unknowns that are held by a bound.
    remarks : tuple of str
        What limits all this.
    result : SolveResult or None
        Of the fit.
    """

    problem: EstimationProblem
    estimates: Any
    covariance: Any
    residuals: Any
    freedom: int | None
    sum_of_squares: float
    at_bound: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    result: SolveResult | None = None

    @property
    def standard_errors(self) -> Any:
        """Of the estimates, by name: a Series."""
        return pandas.Series(np.sqrt(np.diag(self.covariance)), index=self.estimates.index)

    @property
    def rmse(self) -> Any:
        """Root of the mean squared residual of each output, over all experiments: a Series."""
        squares = self.residuals["residual"] ** 2
        return squares.groupby(self.residuals["output"], sort=False).mean() ** 0.5

    def to_pandas(self, level: float = 0.95) -> Any:
        """A data frame with a row per unknown: estimate, standard error, and the ends of its confidence interval.

        Parameters
        ----------
        level : float
            Between 0 and 1. Intervals are normal, or Student's t where the variance is estimated.
        """
        reach = quantile(level, self.freedom) * self.standard_errors
        lower, upper = self.estimates - reach, self.estimates + reach
        return pandas.DataFrame(
            {"estimate": self.estimates, "std. error": self.standard_errors, "lower": lower, "upper": upper}
        )

    def _summary(self) -> str:
        pairs = zip(self.estimates.items(), self.standard_errors, strict=True)
        return ", ".join(f"{name} = {number:.5g} +- {error:.2g}" for (name, number), error in pairs)

    def __str__(self) -> str:
        outputs = pandas.DataFrame({"rmse": self.rmse, "of the range": self.rmse / self.problem.ranges})
        remarks = (*self.remarks, *(f"{name} is held by a bound" for name in self.at_bound))
        return "\n".join(
            [
                f"{len(self.estimates)} unknowns from {self.residuals['measured'].count()} measurements",
                *(f"- {remark}" for remark in remarks),
                self.to_pandas().to_string(float_format="{:.6g}".format),
                "Intervals of 95 %, to first order, and without the error that the mesh makes.",
                outputs.to_string(float_format="{:.4g}".format),
                "" if self.result is None else str(self.result),
            ]
        )


def estimate(experiments: Any, **options: Any) -> EstimationResult:
    """Estimate time-invariant parameters of labelled models from their measurements.

    A sum of weighted squared residuals is minimised subject to the equations of all experiments together, pairs
    included. Objectives of the models do not count.

    Parameters
    ----------
    experiments : labelled model, object with ``get_labeled_model()``, or a list of them
        What `pyomo.contrib.parmest` takes: models with the suffixes ``experiment_outputs`` and ``unknown_parameters``,
        and ``measurement_error`` where standard deviations are known; `label_measurements` makes them for a phase.
        An unknown of the same name in several experiments is one number.
    **options
        Passed to `solve`.

    Returns
    -------
    EstimationResult
        Also when the fit was not solved. Models that were given hold the fit, unless an unknown is a Param.

    Raises
    ------
    EstimationError
        When there are no labels, or they make no sense.

    References
    ----------
    Bard (1974), Nonlinear Parameter Estimation, sec. 7-5;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069
    """
    problem = EstimationProblem(experiments)
    result = solve_as_given(problem.model, **options)
    given = experiments if isinstance(experiments, (list, tuple)) else [experiments]
    for theirs, ours in zip(given, problem.experiments, strict=True):
        if isinstance(theirs, BlockData):
            _give_back(theirs, ours)
    return replace(statistics_of(problem), result=result)


def _give_back(model: Any, fitted: Any) -> None:
    """Put the fit on the user's model: its copy has the same variables in the same order, if no Param became one."""
    theirs, ours = VariableValues.of_all(model).variables, VariableValues.of_all(fitted)
    if len(theirs) == len(ours.variables):
        put_values(theirs, ours.taken)


def statistics_of(problem: EstimationProblem) -> EstimationResult:
    """Estimates and their uncertainty, for the values that stand on the model of a problem.

    Parameters
    ----------
    problem : EstimationProblem
        At a fit.
    """
    remarks: list[str] = []
    names, variables = list(problem.unknowns), problem.variables
    measured, predicted = problem.data["measured"].to_numpy(), problem.predictions()
    residuals = measured - predicted
    matrix, biactive = np.full((len(residuals), len(names)), np.nan), list[str]()
    try:
        matrix, biactive = problem.sensitivities.at_current_values()
    except EvaluationError as error:
        remarks.append(f"no standard errors: {error}")
    if biactive:
        others = f" and of {len(biactive) - 1} more" if len(biactive) > 1 else ""
        remarks.append(
            f"both sides of {biactive[0]}{others} are zero: standard errors hold to one side of the estimates"
        )
    present, known = np.isfinite(residuals), bool(problem.data["deviation"].notna().all())
    roots = np.sqrt(problem.weights[present])
    rows, left = roots[:, None] * matrix[present], roots * residuals[present]
    # How far each unknown alone is from the least sum of squares, to first order; 0 where that is not known.
    curvature = (rows**2).sum(axis=0)
    steps = np.divide(left @ rows, curvature, where=curvature > 0.0, out=np.zeros(len(curvature)))
    free = ~np.array([_is_at_bound(*each) for each in zip(variables, steps.tolist(), strict=True)], dtype=bool)
    freedom, squares = int(present.sum()) - int(free.sum()), float(left @ left)
    variance = 1.0 if known else squares / max(freedom, 1)
    covariance = np.full((len(free), len(free)), np.nan)
    if not known and freedom <= 0:
        remarks.append(
            f"no standard errors: {present.sum()} measurements say nothing of their scatter with {free.sum()} "
            "unknowns; label them with their error"
        )
    elif np.isfinite(rows).all():
        covariance[np.ix_(free, free)] = covariance_of(rows[:, free], variance)
    if unseen := [name for name, number in zip(names, np.diag(covariance), strict=True) if np.isinf(number)]:
        remarks.append(
            f"the measurements do not determine {', '.join(unseen)}: measure something else, excite the system "
            "otherwise, or fix some of them"
        )
    if known and freedom > 0 and squares > scipy.special.chdtri(freedom, RARE):
        remarks.append(
            f"the residuals are {np.sqrt(squares / freedom):.2g} times as large as the errors that were stated, and "
            "the standard errors are too small by about as much: state larger errors, or look for what the model lacks"
        )
    return EstimationResult(
        problem=problem,
        estimates=pandas.Series([variable.value for variable in variables], index=names, dtype=float),
        covariance=pandas.DataFrame(covariance, index=names, columns=names),
        residuals=problem.data.assign(predicted=predicted, residual=residuals),
        freedom=None if known else max(freedom, 0),
        sum_of_squares=squares,
        at_bound=tuple(name for name, is_free in zip(names, free, strict=True) if not is_free),
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
        Derivatives S of the outputs, each over its standard deviation, or over a number in proportion to it.
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
    rank = int((values > NEGLIGIBLE * values.max(initial=1e-300)).sum())
    root = (right[:rank].T / values[:rank]) / sizes[:, None]
    covariance: Array = variance * root @ root.T
    # An unknown that takes part in a combination that is not seen may be anything.
    unseen = np.flatnonzero(np.abs(right[rank:]).max(axis=0, initial=0.0) > 1e-6)
    covariance[unseen, :] = covariance[:, unseen] = np.nan
    covariance[unseen, unseen] = np.inf
    return covariance


def quantile(level: float, freedom: int | None) -> float:
    """How many standard errors an interval reaches to either side; Student's t with a freedom, else normal."""
    tail = 0.5 + level / 2
    return float(scipy.special.ndtri(tail) if freedom is None else scipy.special.stdtrit(max(freedom, 1), tail))
