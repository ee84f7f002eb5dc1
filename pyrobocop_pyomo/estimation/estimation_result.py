"""`EstimationResult`: estimates, how sure they are, and how well the model meets the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.plotting.estimates import FitPanel, draw_fit
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.studies.sweep import SweepResult
from pyrobocop_pyomo.trajectories import Trajectory

from .fit_statistics import FitStatistics
from .problem import EstimationProblem
from .profiles import Profile, profile_of


@dataclass(frozen=True, eq=False)
class EstimationResult(Presented):
    """The answer of `estimate`; printing it shows a table.

    Attributes
    ----------
    problem : EstimationProblem
        Its model holds the fit.
    result : SolveResult
        Of the fit that was taken.
    statistics : FitStatistics
    diagnosis : Diagnosis or None
        What was said of the parameters before the fit; None where that was not asked for.
    starts : SweepResult or None
        All fits, where there were several starts.
    level : float
        Of the confidence intervals.
    seconds : float
        Elapsed in all.
    """

    problem: EstimationProblem
    result: SolveResult
    statistics: FitStatistics
    diagnosis: Diagnosis | None
    starts: SweepResult | None
    level: float
    seconds: float = field(default=0.0, compare=False)

    @property
    def solved(self) -> bool:
        """Whether the fit is shown to be a local optimum, and where there are pairs, proven so on all branches."""
        return self.result.solved

    def raise_for_status(self) -> None:
        """Do nothing when the fit was solved.

        Raises
        ------
        SolveFailed
            Otherwise.
        """
        self.result.raise_for_status()

    @cached_property
    def estimates(self) -> dict[str, float]:
        """Estimate of each unknown, by name."""
        return dict(zip(self.names, self.statistics.estimates.tolist(), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """Of all that was estimated: parameters, own ones by data set, values at the start."""
        return self.statistics.names

    @cached_property
    def standard_errors(self) -> dict[str, float]:
        """By name; NaN for what a bound holds, infinite for what the data do not see."""
        return dict(zip(self.names, self.statistics.standard_errors.tolist(), strict=True))

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Confidence intervals of the level that was asked for, by name."""
        return {
            name: (lower, upper)
            for name, (lower, upper) in zip(self.names, self.statistics.intervals(self.level).tolist(), strict=True)
        }

    @property
    def covariance(self) -> Any:
        """Covariance of the estimates as a data frame."""
        return pandas.DataFrame(self.statistics.covariance, index=self.names, columns=self.names)

    @property
    def correlation(self) -> Any:
        """Correlation of the estimates as a data frame."""
        return pandas.DataFrame(self.statistics.correlation, index=self.names, columns=self.names)

    @property
    def sum_of_squares(self) -> float:
        """Of the residuals, each over its standard deviation where these were given."""
        return self.statistics.sum_of_squares

    @cached_property
    def residuals(self) -> dict[tuple[str, str], Array]:
        """Measured less predicted, by data set and output, in the order of the samples; NaN where data are missing."""
        found: dict[tuple[str, str], list[float]] = {}
        for key, number in zip(self.problem.output_of, self.statistics.residuals.tolist(), strict=True):
            found.setdefault(key, []).append(number)
        return {key: np.array(numbers) for key, numbers in found.items()}

    @cached_property
    def rmse(self) -> dict[str, float]:
        """Root of the mean squared residual of each output, over all data sets."""
        found = {}
        for output in self.problem.outputs:
            values = np.concatenate([each for (_, name), each in self.residuals.items() if name == output])
            values = values[np.isfinite(values)]
            found[output] = float(np.sqrt((values**2).mean())) if values.size else np.nan
        return found

    @property
    def nrmse(self) -> float:
        """Root of the mean, over the outputs, of the squared residuals relative to the range of the data."""
        shares = [self.rmse[output] / self.problem.scales[output] for output in self.problem.outputs]
        return float(np.sqrt(np.nanmean(np.square(shares))))

    def model(self, data_set: str | None = None) -> Any:
        """The model of a data set, with its fit.

        Parameters
        ----------
        data_set : str, optional
            Its name; needed where there are several.

        Raises
        ------
        EstimationError
            When there is none of that name.
        """
        return self._experiment(data_set).model

    def trajectory(self, data_set: str | None = None) -> Trajectory:
        """The fitted trajectory of the phase that was measured.

        Raises
        ------
        EstimationError
            When there is no data set of that name, or its model has no phase.
        """
        experiment = self._experiment(data_set)
        if experiment.phase is None:
            raise EstimationError(f"data set '{experiment.name}': its model was labelled, no phase is known.")
        found: Trajectory = experiment.phase.trajectory()
        return found

    def _experiment(self, data_set: str | None) -> Any:
        known = self.problem.experiments
        if data_set is None and len(known) == 1:
            return next(iter(known.values()))
        if data_set is None or data_set not in known:
            raise EstimationError(f"there is no data set '{data_set}'; there are {', '.join(known)}.")
        return known[data_set]

    def profile(self, name: str, points: int = 9, *, reach: float = 3.0, progress: bool | None = None) -> Profile:
        """Profile likelihood of an unknown: the best fit of all others for values of it.

        Parameters
        ----------
        name : str
        points : int
            How many values, the estimate included.
        reach : float
            How far they reach to either side, in standard errors.
        progress : bool, optional
            Show how far it is; by default only on a terminal.

        Returns
        -------
        Profile

        Raises
        ------
        EstimationError
            When there is no such unknown, it has no standard error, or the criterion is no likelihood.
        """
        return profile_of(self.problem, self.statistics, name, points, reach, self.level, progress)

    def to_pandas(self) -> Any:
        """A data frame with a row per unknown: estimate, standard error, interval, and whether a bound holds it."""
        intervals = self.statistics.intervals(self.level)
        return pandas.DataFrame(
            {
                "estimate": self.statistics.estimates,
                "standard_error": self.statistics.standard_errors,
                "lower": intervals[:, 0],
                "upper": intervals[:, 1],
                "at_bound": [name in self.statistics.at_bound for name in self.names],
            },
            index=pandas.Index(self.names, name="unknown"),
        )

    def residuals_to_pandas(self) -> Any:
        """A data frame with a row per measurement: data set, output, time, measured, predicted, residual."""
        predicted = self.problem.measured - self.statistics.residuals
        return pandas.DataFrame(
            {
                "data_set": [name for name, _ in self.problem.output_of],
                "output": [output for _, output in self.problem.output_of],
                "time": [each.time for _, each in self.problem.measurements],
                "measured": self.problem.measured,
                "predicted": predicted,
                "residual": self.statistics.residuals,
            }
        )

    def table(self) -> str:
        """Estimates, standard errors and intervals as a table in text."""
        width = max(9, *(len(name) for name in self.names))
        percent = f"{100 * self.level:g} % interval"
        lines = [f"{'parameter':<{width}}  {'estimate':>13}  {'std. error':>11}  {percent:>27}"]
        for name in self.names:
            lower, upper = self.intervals[name]
            held = "  at a bound" if name in self.statistics.at_bound else ""
            lines.append(
                f"{name:<{width}}  {self.estimates[name]:>13.7g}  {self.standard_errors[name]:>11.3g}  "
                f"{lower:>13.6g} {upper:>13.6g}{held}"
            )
        return "\n".join(lines)

    def plot(self, figure: Any = None) -> Any:
        """Data as dots and the model as lines, one panel per output, one colour per data set.

        Parameters
        ----------
        figure : Figure or SubFigure, optional
            Where to draw; a new figure by default.
        """
        panels: dict[str, FitPanel] = {}
        predicted = self.problem.measured - self.statistics.residuals
        predicted = np.where(np.isfinite(predicted), predicted, self.problem.predictions())
        times = np.array([each.time for _, each in self.problem.measurements])
        for place, (name, output) in enumerate(self.problem.output_of):
            panel = panels.setdefault(output, FitPanel(output, {}))
            panel.samples.setdefault(name, []).append(
                (float(times[place]), float(self.problem.measured[place]), float(predicted[place]))
            )
        return draw_fit(list(panels.values()), self._curves(), figure=figure)

    def _curves(self) -> Mapping[tuple[str, str], tuple[Array, Array]]:
        """Dense curves of the outputs that a trajectory knows."""
        found = {}
        for name, experiment in self.problem.experiments.items():
            if experiment.phase is None:
                continue
            trajectory = experiment.phase.trajectory()
            time = np.linspace(trajectory.time[0], trajectory.time[-1], 400)
            known = [output for output in self.problem.outputs if output in trajectory.names]
            values = trajectory(time) if known else {}
            found.update({(name, output): (time, np.asarray(values[output])) for output in known})
        return found

    def __str__(self) -> str:
        problem, count = self.problem, int(np.isfinite(self.problem.measured).sum())
        proven = f", {self.result.certificate.name.lower()}" if self.result.residuals else ""
        sets = f"{len(problem.experiments)} data set{'s' if len(problem.experiments) > 1 else ''}"
        lines = [
            f"{len(self.names)} unknowns from {count} measurements in {sets}: "
            f"{self.result.quality.name.lower()}{proven}, {self.result.iterations} iterations, {self.seconds:.2f} s",
            self.table(),
            "",
            f"{'output':<16} {'rmse':>11}  relative to the range of the data",
            *(
                f"{output:<16} {self.rmse[output]:>11.4g}  {self.rmse[output] / problem.scales[output]:.2%}"
                for output in problem.outputs
            ),
        ]
        findings = [] if self.diagnosis is None else [*map(str, self.diagnosis.findings), *self.diagnosis.remarks]
        return "\n".join([*lines, *(f"- {line}" for line in (*findings, *self.statistics.remarks))])
