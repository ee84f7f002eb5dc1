"""`EstimationResult`: estimates, how sure they are, and how well the model meets the data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.plotting.figures import figure_or_new
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.trajectories import Trajectory

from .experiments import Experiment
from .fit_statistics import FitStatistics
from .problem import EstimationProblem


@dataclass(frozen=True, eq=False)
class EstimationResult(Presented):
    """The answer of `estimate`; printing it shows a table.

    Attributes
    ----------
    problem : EstimationProblem
        Its model holds the fit.
    result : SolveResult
        Of the fit.
    statistics : FitStatistics
    diagnosis : Diagnosis or None
        What was said of the parameters before the fit; None where that was not asked for.
    level : float
        Of the confidence intervals.
    seconds : float
        Elapsed in all.
    """

    problem: EstimationProblem
    result: SolveResult
    statistics: FitStatistics
    diagnosis: Diagnosis | None
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

    @property
    def names(self) -> tuple[str, ...]:
        """Of all that was estimated: parameters, own ones by data set, values at the start."""
        return self.statistics.names

    @property
    def estimates(self) -> dict[str, float]:
        """Estimate of each unknown, by name."""
        return self._by_name(self.statistics.estimates.tolist())

    @property
    def standard_errors(self) -> dict[str, float]:
        """By name; NaN for what a bound holds, infinite for what the data do not see."""
        return self._by_name(self.statistics.standard_errors.tolist())

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Confidence intervals of the level that was asked for, by name."""
        return self._by_name(map(tuple, self.statistics.intervals(self.level).tolist()))

    def _by_name(self, numbers: Iterable[Any]) -> dict[str, Any]:
        return dict(zip(self.names, numbers, strict=True))

    @property
    def covariance(self) -> Any:
        """Covariance of the estimates as a data frame."""
        return pandas.DataFrame(self.statistics.covariance, index=self.names, columns=self.names)

    @property
    def correlation(self) -> Any:
        """Correlation of the estimates as a data frame."""
        return pandas.DataFrame(self.statistics.correlation, index=self.names, columns=self.names)

    @cached_property
    def residuals(self) -> dict[tuple[str, str], Array]:
        """Measured less predicted, by data set and output, in the order of the samples; NaN where data are missing."""
        keys = self.problem.output_of
        return {
            key: self.statistics.residuals[[i for i, each in enumerate(keys) if each == key]]
            for key in dict.fromkeys(keys)
        }

    @property
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
        shares = [rmse / self.problem.scales[output] for output, rmse in self.rmse.items()]
        return float(np.sqrt(np.nanmean(np.square(shares))))

    def trajectory(self, data_set: str | None = None) -> Trajectory:
        """The fitted trajectory of the phase that was measured.

        Parameters
        ----------
        data_set : str, optional
            Its name; needed where there are several.

        Raises
        ------
        EstimationError
            When there is no data set of that name, or its model has no phase.
        """
        known = {name: each for name, each in self.problem.experiments.items() if each.phase is not None}
        name = next(iter(known)) if data_set is None and len(known) == 1 else data_set
        if name not in known:
            raise EstimationError(
                f"there is no data set '{name}' with a phase; there are {', '.join(known) or 'none'}."
            )
        found: Trajectory = known[name].phase.trajectory()
        return found

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
        data = self.problem.measurements
        return pandas.DataFrame(
            {
                "data_set": [each.data_set for each in data],
                "output": [each.output for each in data],
                "time": [each.time for each in data],
                "measured": self.problem.measured,
                "predicted": self.problem.measured - self.statistics.residuals,
                "residual": self.statistics.residuals,
            }
        )

    def plot(self, figure: Any = None) -> Any:
        """Data as dots and the model as lines, one panel per output, one colour per data set.

        Parameters
        ----------
        figure : Figure or SubFigure, optional
            Where to draw; a new figure by default.
        """
        outputs = self.problem.outputs
        columns = 1 if len(outputs) <= 4 else 2
        rows = -(-len(outputs) // columns)
        figure = figure_or_new(figure, 6.0 * columns, 1.9 * rows + 0.8)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, output in zip(axes, outputs, strict=False):
            for number, experiment in enumerate(self.problem.experiments.values()):
                self._draw(axis, output, experiment, f"C{number % 10}")
            axis.set_ylabel(output)
            axis.grid(alpha=0.3)
        for axis in axes[len(outputs) :]:
            axis.set_visible(False)
        if 1 < len(self.problem.experiments) <= 6:  # more names would hide the data
            axes[0].legend(fontsize="small")
        return figure

    def _draw(self, axis: Any, output: str, experiment: Experiment, colour: str) -> None:
        keys = self.problem.output_of
        places = [i for i, key in enumerate(keys) if key == (experiment.name, output)]
        if not places:
            return
        times = np.array([self.problem.measurements[i].time for i in places])
        measured, predicted = self.problem.measured[places], self.problem.predictions()[places]
        if not np.isfinite(times).all():
            axis.plot(predicted, measured, ".", color=colour, label=experiment.name)
            axis.axline((float(predicted[0]), float(predicted[0])), slope=1.0, color="0.6", linewidth=1.0)
            axis.set_xlabel("predicted")
            return
        order = np.argsort(times, kind="stable")
        line = times[order], predicted[order]
        trajectory = None if experiment.phase is None else experiment.phase.trajectory()
        if trajectory is not None and output in trajectory.names:
            dense = np.linspace(trajectory.time[0], trajectory.time[-1], 400)
            line = dense, trajectory(dense)[output]
        axis.plot(*line, color=colour, linewidth=1.4, label=experiment.name)
        axis.plot(times, measured, ".", color=colour, markersize=4, alpha=0.6)
        axis.set_xlabel("time")

    def __str__(self) -> str:
        problem, count = self.problem, int(np.isfinite(self.problem.measured).sum())
        proven = f", {self.result.certificate.name.lower()}" if self.result.residuals else ""
        sets = f"{len(problem.experiments)} data set{'s' if len(problem.experiments) > 1 else ''}"
        findings = [] if self.diagnosis is None else [*map(str, self.diagnosis.findings), *self.diagnosis.remarks]
        width = max(9, *(len(name) for name in self.names))
        lines = [
            f"{len(self.names)} unknowns from {count} measurements in {sets}: "
            f"{self.result.quality.name.lower()}{proven}, {self.result.iterations} iterations, {self.seconds:.2f} s",
            *(f"- {line}" for line in (*findings, *self.statistics.remarks)),
            f"{'parameter':<{width}}  {'estimate':>13}  {'std. error':>11}  {f'{100 * self.level:g} % interval':>27}",
        ]
        for name, (lower, upper) in self.intervals.items():
            held = "  at a bound" if name in self.statistics.at_bound else ""
            lines.append(
                f"{name:<{width}}  {self.estimates[name]:>13.7g}  {self.standard_errors[name]:>11.3g}  "
                f"{lower:>13.6g} {upper:>13.6g}{held}"
            )
        lines += ["", f"{'output':<16} {'rmse':>11}  relative to the range of the data"]
        for output, rmse in self.rmse.items():
            lines.append(f"{output:<16} {rmse:>11.4g}  {rmse / problem.scales[output]:.2%}")
        return "\n".join(lines)
