"""`homotopy`: follow a path of data from an easy problem to the wanted one, each solve from the last point."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import HomotopyStalled, ModelError, PyRobocopError, SolverNotFoundError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .data_path import DataPath

# Near a solution the tight problem is solved at once; what it leaves goes through looser ones.
FOLLOWING_STRATEGIES = ("tight", "barrier", "continuation")


@dataclass(frozen=True, eq=False)
class HomotopyStep:
    """One problem on the path.

    Attributes
    ----------
    position : float
        Where on the path, 0 at its start and 1 at its end.
    accepted : bool
        Whether the point is feasible and was gone on from.
    result : SolveResult or None
        None where solving raised an error.
    error : str
        That error, empty otherwise.
    """

    position: float
    accepted: bool
    result: SolveResult | None
    error: str = ""

    def __str__(self) -> str:
        if self.result is None:
            return f"{self.position:>8.5f} {'-':>14}  error: {self.error}"
        return (
            f"{self.position:>8.5f} {self.result.objective:>14.7g}  {self.result.quality.name.lower():<10} "
            f"{self.result.iterations:>6} {self.result.seconds:>8.2f}  {'' if self.accepted else 'step halved'}"
        ).rstrip()


@dataclass(frozen=True, eq=False)
class HomotopyResult:
    """The problems that were solved on the way.

    Attributes
    ----------
    name : str
        Of the model.
    steps : list of HomotopyStep
        In order, with those that were not accepted.
    seconds : float
    """

    name: str
    steps: list[HomotopyStep]
    seconds: float

    @property
    def result(self) -> SolveResult | None:
        """Of the last accepted step, whose point is on the model; None where there is none."""
        return next((step.result for step in reversed(self.steps) if step.accepted), None)

    @property
    def reached(self) -> float:
        """How much of the path was followed, from 0 to 1; -1 where not even its start was solved."""
        return max((step.position for step in self.steps if step.accepted), default=-1.0)

    @property
    def iterations(self) -> int:
        """Ipopt's iterations in all steps together."""
        return sum(0 if step.result is None else step.result.iterations for step in self.steps)

    def to_pandas(self) -> Any:
        """A data frame with a row per step."""
        rows = [
            {
                "position": step.position,
                "accepted": step.accepted,
                "objective": float("nan") if step.result is None else step.result.objective,
                "quality": "error" if step.result is None else step.result.quality.name.lower(),
                "iterations": 0 if step.result is None else step.result.iterations,
                "seconds": float("nan") if step.result is None else step.result.seconds,
            }
            for step in self.steps
        ]
        return pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="step"))

    def __str__(self) -> str:
        header = f"{'position':>8} {'objective':>14}  {'quality':<10} {'iter':>6} {'seconds':>8}"
        return "\n".join([f"{self.name}: followed to {max(self.reached, 0.0):.5g}", header, *map(str, self.steps)])


def homotopy(
    model: Any,
    parameters: Mapping[str, Any] | Iterable[tuple[Any, Any]] | Callable[[float], object],
    steps: int = 10,
    *,
    smallest_step: float = 1e-3,
    time_limit: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> HomotopyResult:
    """Solve a model for data that move from an easy problem to the wanted one.

    Each problem starts from the solution of the last one. Where a problem ends in an infeasible point, the step along
    the path is halved; after two successes in a row it is doubled again, up to ``1 / steps``. In the end the model
    holds the wanted data and their solution.

    Parameters
    ----------
    model : Block
    parameters : mapping, iterable or callable
        What moves: ``{"p": (first, last)}`` by name, or pairs ``[(m.p, (first, last))]`` of mutable Params or fixed
        Vars; the last value alone where the path starts at the present one. They move on straight lines. For an
        indexed component, first and last are numbers for all members or mappings by index. A callable
        ``parameters(s)`` puts the data of position s on the model, from 0 to 1.
    steps : int
        Steps along the path, if none has to be halved.
    smallest_step : float
        Where halving ends, as a part of the path.
    time_limit : float, optional
        Seconds, for the whole path.
    progress : bool, optional
        Show a line per problem; by default only on a terminal.
    **options
        Passed to `solve`. Without ``strategies`` or ``schedule``, problems after the first go for the tight strategy
        first.

    Returns
    -------
    HomotopyResult

    Raises
    ------
    HomotopyStalled
        When the step became too small, or at the time limit or Ctrl-C. The model then holds the data and the point of
        the last problem that was solved; where there is none, all is as it was before (but for data that a callable
        put there).
    ModelError
        When the arguments or the model make no sense.
    """
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise ModelError(f"steps = {steps!r}; expected a number of steps of at least 1.")
    if not 0.0 < smallest_step <= 1.0:
        raise ModelError(f"smallest_step = {smallest_step!r}; expected a part of the path, between 0 and 1.")
    path = DataPath(model, parameters)
    return _Follower(model, path, steps, smallest_step, time_limit, Progress(progress), options).follow()


class _Follower:
    """The state of one path."""

    def __init__(
        self,
        model: Any,
        path: DataPath,
        steps: int,
        smallest_step: float,
        time_limit: float | None,
        bar: Progress,
        options: Mapping[str, Any],
    ) -> None:
        self._model, self._path, self._bar, self._options = model, path, bar, options
        self._longest, self._shortest, self._time_limit = 1.0 / steps, smallest_step, time_limit
        self._values = VariableValues.of_free(model)
        self._good = self._values.read()
        self._steps: list[HomotopyStep] = []
        self._position = -1.0  # nothing solved yet
        self._started = time.perf_counter()

    def follow(self) -> HomotopyResult:
        length, successes = self._longest, 0
        while self._position < 1.0:
            # Sums of tenths miss one by rounding.
            wanted = 0.0 if self._position < 0.0 else self._position + length
            wanted = 1.0 if wanted > 1.0 - 1e-9 else wanted
            try:
                step = self._try(wanted)
            except BaseException:
                self._go_back()
                raise
            self._steps.append(step)
            self._bar.line(f"{self._model.name}: {step}")
            if step.accepted:
                self._good, self._position = self._values.read(), wanted
                successes += 1
                # One success says little of the next step: doubling at once would fail every other time.
                if successes > 1:
                    length, successes = min(2.0 * length, self._longest), 0
                continue
            successes = 0
            self._go_back()
            length *= 0.5
            cut = step.result is not None and step.result.stop_reason.is_final
            if cut or self._position < 0.0 or length < self._shortest:
                raise self._stalled(step, length)
        return self._so_far()

    def _try(self, position: float) -> HomotopyStep:
        self._path.put(position)
        left = None if self._time_limit is None else self._time_limit - (time.perf_counter() - self._started)
        options = {**self._options, "time_limit": None if left is None else max(left, 1e-3)}
        if self._position >= 0.0 and not {"strategies", "schedule"} & options.keys():
            options["strategies"] = FOLLOWING_STRATEGIES
        try:
            result = solve(self._model, progress=False, **options)
        except (ModelError, SolverNotFoundError):
            raise
        except PyRobocopError as error:
            return HomotopyStep(position, False, None, f"{type(error).__name__}: {error}")
        return HomotopyStep(position, result.quality is not Quality.INFEASIBLE, result)

    def _go_back(self) -> None:
        self._values.write(self._good)
        if self._position < 0.0:
            self._path.restore()
        else:
            self._path.put(self._position)

    def _so_far(self) -> HomotopyResult:
        return HomotopyResult(self._model.name, self._steps, time.perf_counter() - self._started)

    def _stalled(self, step: HomotopyStep, length: float) -> HomotopyStalled:
        why = step.error if step.result is None else f"{step.result.stop_reason.value} {step.result.quality.value}"
        if self._position < 0.0:
            where = "the first problem of the path was not solved. Start from easier data, or from a better guess"
            kept = "The model is as it was before."
        else:
            where = (
                f"the path was followed to {self._position:.5g} of 1, and the problem at {step.position:.5g} was not "
                f"solved; the next step would be {length:.1e}, the smallest allowed is {self._shortest:.1e}. Take "
                "another path around this place, or a smaller smallest_step"
            )
            kept = "The model holds the last data that were solved, with their point."
        return HomotopyStalled(f"'{self._model.name}': {where}. {why} {kept}", self._so_far(), self._position)
