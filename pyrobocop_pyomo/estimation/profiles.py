"""Profile likelihood: how much worse the best fit becomes where one unknown is held elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting.figures import figure_or_new
from pyrobocop_pyomo.presentation import Presented, disclosed_text, sparkline
from pyrobocop_pyomo.studies.sweep import SweepResult, sweep

from .fit_statistics import FitStatistics
from .problem import EstimatedNumber, EstimationProblem
from .statistics import quantile


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
    others : array, shape (points, unknowns)
        Estimates of all unknowns there.
    threshold : float
        The increase at the ends of the confidence interval.
    sweep : SweepResult
        All fits.
    """

    name: str
    estimate: float
    values: Array
    increases: Array
    others: Array
    threshold: float
    sweep: SweepResult

    @property
    def interval(self) -> tuple[float, float]:
        """Where the increase reaches the threshold; infinite where it does not within the values.

        The signed root of the increase is nearly a line, and so is interpolated as one.
        """
        known = np.isfinite(self.increases)
        values = self.values[known]
        roots = np.sign(values - self.estimate) * np.sqrt(np.maximum(self.increases[known], 0.0))
        reach = float(np.sqrt(self.threshold))
        lower = upper = np.inf
        above, below = np.flatnonzero(roots >= reach), np.flatnonzero(roots <= -reach)
        if above.size and above[0] > 0:
            upper = float(np.interp(reach, roots[above[0] - 1 : above[0] + 1], values[above[0] - 1 : above[0] + 1]))
        if below.size and below[-1] + 1 < values.size:
            lower = -float(np.interp(-reach, roots[below[-1] : below[-1] + 2], values[below[-1] : below[-1] + 2]))
        return -lower, upper

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

    def _html_parts(self) -> list[str]:
        return [sparkline(self.values, self.increases), disclosed_text("as text", str(self))]

    def __str__(self) -> str:
        lower, upper = self.interval
        lines = [f"profile of {self.name}: {self.estimate:.7g}, interval {lower:.6g} to {upper:.6g}"]
        lines += [f"{value:>14.7g} {rise:>12.5g}" for value, rise in zip(self.values, self.increases, strict=True)]
        return "\n".join(lines)


def profile_of(
    problem: EstimationProblem,
    statistics: FitStatistics,
    name: str,
    points: int,
    reach: float,
    level: float,
    progress: bool | None,
) -> Profile:
    """See `EstimationResult.profile`."""
    if name not in problem.names:
        raise EstimationError(f"there is no unknown '{name}'; there are {', '.join(problem.names)}.")
    if problem.criterion != "least squares":
        raise EstimationError("a profile likelihood needs criterion='least squares': another one is no likelihood.")
    if isinstance(points, bool) or not isinstance(points, int) or points < 3:
        raise EstimationError(f"points = {points!r}; a profile needs at least 3 values.")
    place = problem.names.index(name)
    error = float(statistics.standard_errors[place])
    if not np.isfinite(error) or not error > 0.0:
        raise EstimationError(
            f"'{name}' has the standard error {error:g}: nothing says how far its profile should reach."
        )
    unknown, estimate = problem.unknowns[place], float(statistics.estimates[place])
    values = _around(unknown, estimate, error * reach, points)
    before = VariableValues.of_all(problem.model)
    order = sorted(range(len(values)), key=lambda i: abs(values[i] - estimate))
    nearer: dict[int, int | None] = {}
    for number, i in enumerate(order):
        sides = [k for k in range(number) if (values[order[k]] - estimate) * (values[i] - estimate) >= 0.0]
        nearer[number] = None if not number else max(sides, default=0)
    try:
        for each, number in zip(problem.unknowns, statistics.estimates.tolist(), strict=True):
            each.put(number)

        def put(model: Any, data: dict[str, float]) -> None:
            unknown.put(data[name])
            unknown.variable.fix()

        def read(model: Any, result: Any) -> dict[str, Any]:
            return {"unknowns": problem.estimates()}

        found = sweep(
            problem.model,
            [{name: values[i]} for i in order],
            put=put,
            read=read,
            start_from=lambda number: nearer[number],
            progress=progress,
        )
    finally:
        before.restore()
    variance = 1.0 if statistics.freedom is None else statistics.sum_of_squares / max(statistics.freedom, 1)
    increases, others = np.full(len(values), np.nan), np.full((len(values), len(problem.names)), np.nan)
    for outcome in found:
        if outcome.result is not None and outcome.result.solved:
            i = order[outcome.case.number]
            squares = outcome.objective / problem.factor
            increases[i] = max(squares - statistics.sum_of_squares, 0.0) / max(variance, 1e-300)
            others[i] = outcome.numbers["unknowns"]
    threshold = quantile(level, statistics.freedom) ** 2
    return Profile(name, estimate, np.array(values), increases, others, threshold, found)


def _around(unknown: EstimatedNumber, estimate: float, reach: float, points: int) -> list[float]:
    lower, upper = unknown.variable.bounds
    half = points // 2
    steps = np.arange(-half, points - half) / half
    values = estimate + reach * steps
    inside = (values >= (-np.inf if lower is None else lower)) & (values <= (np.inf if upper is None else upper))
    return [float(number) for number in values[inside]]
