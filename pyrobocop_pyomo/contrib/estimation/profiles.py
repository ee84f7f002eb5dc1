"""Profile likelihood: how much worse the best fit becomes where one unknown is held elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting.figures import figure_or_new
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.studies.sweep import SweepResult, sweep

from .fit_statistics import FitStatistics, quantile
from .problem import EstimationProblem


@dataclass(frozen=True, eq=False)
class Profile(Presented):
    """The profile of one unknown.

    Attributes
    ----------
    name : str
    estimate : float
    values : array, shape (points,)
        At which it was held, in increasing order.
    increases : array, shape (points,)
        Of the sum of squares over the variance: twice the decrease of the log-likelihood. NaN where a fit failed.
    threshold : float
        The increase at the ends of the confidence interval.
    sweep : SweepResult
        All fits.
    """

    name: str
    estimate: float
    values: Array
    increases: Array
    threshold: float
    sweep: SweepResult

    @property
    def interval(self) -> tuple[float, float]:
        """Where the increase reaches the threshold; infinite where it does not within the values.

        The signed root of the increase is nearly a line, and so is interpolated as one.
        """
        known = np.isfinite(self.increases)
        distances = self.values[known] - self.estimate
        roots = np.sign(distances) * np.sqrt(np.maximum(self.increases[known], 0.0))
        upper = _first_above(float(np.sqrt(self.threshold)), roots, distances)
        lower = _first_above(float(np.sqrt(self.threshold)), -roots[::-1], -distances[::-1])
        return self.estimate - lower, self.estimate + upper

    def plot(self, figure: Any = None) -> Any:
        """The increase over the values, and the threshold.

        Parameters
        ----------
        figure : Figure or SubFigure, optional
            A new one by default.
        """
        figure = figure_or_new(figure, 5.0, 3.4)
        axis = figure.subplots()
        axis.plot(self.values, self.increases, ".-", linewidth=1.4)
        axis.axhline(self.threshold, color="0.4", linestyle="--", linewidth=1.0)
        axis.axvline(self.estimate, color="0.7", linewidth=1.0)
        axis.set_xlabel(self.name)
        axis.set_ylabel("increase of the sum of squares")
        axis.grid(alpha=0.3)
        return figure

    def __str__(self) -> str:
        lower, upper = self.interval
        lines = [f"profile of {self.name}: {self.estimate:.7g}, interval {lower:.6g} to {upper:.6g}"]
        lines += [f"{value:>14.7g} {rise:>12.5g}" for value, rise in zip(self.values, self.increases, strict=True)]
        return "\n".join(lines)


def _first_above(reach: float, roots: Array, distances: Array) -> float:
    """The distance at which the roots reach a number, interpolated; infinite where they do not."""
    above = np.flatnonzero(roots >= reach)
    if not above.size or above[0] == 0:
        return np.inf
    around = slice(above[0] - 1, above[0] + 1)
    return float(np.interp(reach, roots[around], distances[around]))


def profile_of(problem: EstimationProblem, statistics: FitStatistics, name: str, points: int, level: float) -> Profile:
    """See `EstimationResult.profile`."""
    if name not in problem.names:
        raise EstimationError(f"there is no unknown '{name}'; there are {', '.join(problem.names)}.")
    if isinstance(points, bool) or not isinstance(points, int) or points < 3:
        raise EstimationError(f"points = {points!r}; a profile needs at least 3 values.")
    place = problem.names.index(name)
    unknown, estimate = problem.unknowns[place], float(statistics.estimates[place])
    error = float(statistics.standard_errors[place])
    if not 0.0 < error < np.inf:
        raise EstimationError(
            f"'{name}' has the standard error {error:g}: nothing says how far its profile should reach."
        )
    lower, upper = (np.nan if bound is None else bound for bound in unknown.variable.bounds)
    steps = np.arange(-(points // 2), points - points // 2) / (points // 2)
    values = estimate + 3.0 * error * steps
    values = values[~((values < lower) | (values > upper))]
    # From the estimate outwards, each from its neighbour on the way.
    order = sorted(range(len(values)), key=lambda i: abs(values[i] - estimate))
    sides = np.sign(values - estimate)[order].tolist()
    before = VariableValues.of_all(problem.model)

    def put(model: Any, data: dict[str, float]) -> None:
        unknown.put(data[name])
        unknown.variable.fix()

    def start_from(number: int) -> int | None:
        nearer = [k for k in range(number) if sides[k] in (0.0, sides[number])]
        return None if not number else max(nearer, default=0)

    try:
        for each, number in zip(problem.unknowns, statistics.estimates.tolist(), strict=True):
            each.put(number)
        found = sweep(problem.model, [{name: float(values[i])} for i in order], put=put, start_from=start_from)
    finally:
        before.restore()
    variance = 1.0 if statistics.freedom is None else statistics.sum_of_squares / max(statistics.freedom, 1)
    increases = np.full(len(values), np.nan)
    for outcome in found:
        if outcome.result is not None and outcome.result.solved:
            rise = outcome.objective / problem.factor - statistics.sum_of_squares
            increases[order[outcome.case.number]] = max(rise, 0.0) / max(variance, 1e-300)
    return Profile(name, estimate, values, increases, quantile(level, statistics.freedom) ** 2, found)
