"""`multistart`: solve from many starting points, rank what comes out, and leave the best on the model."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError, SolveFailed, SolverNotFoundError
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.iterate_log import ModelCheck
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .random_starts import RandomStarts


@dataclass(frozen=True, eq=False)
class StartOutcome:
    """What became of one start.

    Attributes
    ----------
    start : int
        0 is the guess that was on the model.
    result : SolveResult or None
        None where solving raised an error.
    error : str
        That error, empty otherwise.
    point : list of float
        Values of the free variables, for `MultistartResult.load`.
    """

    start: int
    result: SolveResult | None
    error: str = ""
    point: Values = field(default_factory=list, repr=False)

    @property
    def feasible(self) -> bool:
        """True when the point is feasible, whether it is shown to be optimal or not."""
        return self.result is not None and self.result.quality is not Quality.INFEASIBLE


@dataclass(frozen=True, eq=False)
class MultistartResult(Sequence[StartOutcome]):
    """Outcomes, the best first: feasible ones by objective, then infeasible ones by violation, then errors.

    Where there are obstacles, plans that are proven safe come before all others that are feasible.

    Attributes
    ----------
    name : str
        Of the model.
    outcomes : tuple of StartOutcome
    unused : int
        Starts that a time limit or Ctrl-C left undone.
    seconds : float
    """

    name: str
    outcomes: tuple[StartOutcome, ...]
    unused: int
    seconds: float
    _values: VariableValues = field(repr=False)

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, rank: Any) -> Any:
        return self.outcomes[rank]

    def __iter__(self) -> Iterator[StartOutcome]:
        return iter(self.outcomes)

    @property
    def best(self) -> SolveResult:
        """Result of the best start, whose point is on the model.

        Raises
        ------
        SolveFailed
            When no start has a result.
        """
        found = self.outcomes[0].result
        if found is None:
            raise SolveFailed(f"'{self.name}': no start could be solved. {self.outcomes[0].error}", self)
        return found

    def load(self, rank: int) -> SolveResult:
        """Put the point of another start on the model and return its result.

        Parameters
        ----------
        rank : int
            Place in this ranking, from 0.

        Raises
        ------
        SolveFailed
            When it has none.
        """
        chosen = self.outcomes[rank]
        if chosen.result is None:
            raise SolveFailed(f"'{self.name}': start {chosen.start} has no point. {chosen.error}", self)
        self._values.write(chosen.point)
        return chosen.result

    def raise_for_status(self) -> None:
        """Do nothing when the best point is optimal.

        Raises
        ------
        SolveFailed
            Otherwise.
        """
        self.best.raise_for_status()

    def to_pandas(self) -> Any:
        """A data frame with a row per start, the best first."""
        rows = [
            {
                "start": each.start,
                "objective": float("nan") if each.result is None else each.result.objective,
                "quality": "error" if each.result is None else each.result.quality.name.lower(),
                "certificate": "" if each.result is None else each.result.certificate.name.lower(),
                "iterations": 0 if each.result is None else each.result.iterations,
                "seconds": float("nan") if each.result is None else each.result.seconds,
                "error": each.error,
            }
            for each in self.outcomes
        ]
        return pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="rank"))

    def __str__(self) -> str:
        lines = [f"{'rank':>4} {'start':>5} {'objective':>14}  {'quality':<10} {'certificate':<11} {'iter':>6}"]
        lines += [f"{rank:>4} {_line(each)}" for rank, each in enumerate(self.outcomes, start=1)]
        if self.unused:
            lines.append(f"{self.unused} starts were left undone")
        return "\n".join(lines)


def multistart(
    model: Any,
    starts: int = 10,
    *,
    seed: int = 0,
    spread: float | Mapping[str, float] | Iterable[tuple[Any, float]] = 1.0,
    time_limit: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> MultistartResult:
    """Solve a model from several starting points.

    The first start is the guess on the model. The others are drawn around it: a variable with two bounds anywhere
    between them, any other within ``max(1, |guess|)`` of its guess and its bounds; values of one variable of a phase
    form a smooth curve over time. The model is left with the best point.

    Parameters
    ----------
    model : Block
    starts : int
        How many, the guess included.
    seed : int
        The same seed gives the same starts, and start k does not depend on how many there are.
    spread : float, mapping or iterable
        Scales the distances from the guess; with 1, variables with two bounds fill them. ``{"x": 0.5}`` or
        ``[(m.x, 0.5)]`` varies only the variables named and leaves the others at their guess.
    time_limit : float, optional
        Seconds, for all starts together.
    progress : bool, optional
        Show a line per start; by default only on a terminal.
    **options
        Passed to `solve`.

    Returns
    -------
    MultistartResult
        Also when no start succeeds, and after Ctrl-C.

    Raises
    ------
    ModelError
        When the arguments or the model make no sense.
    SolverNotFoundError
        When there is no Ipopt.
    """
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise ModelError(f"starts = {starts!r}; expected a number of starting points of at least 1.")
    started = time.perf_counter()
    values = VariableValues.of_free(model)
    sign = ModelCheck(model).sign
    guess = values.read()
    draws = RandomStarts(model, seed, spread) if starts > 1 else None
    bar = Progress(progress)
    done: list[StartOutcome] = []
    try:
        for number in range(starts):
            left = None if time_limit is None else time_limit - (time.perf_counter() - started)
            if done and left is not None and left <= 0.0:
                break
            values.write(guess)
            if draws is not None and number:
                draws.put(number)
            outcome = _solve_one(model, number, values, {**options, "time_limit": left})
            done.append(outcome)
            bar.line(f"start {_line(outcome)}")
            if outcome.result is not None and outcome.result.stop_reason.is_final:
                break
    except KeyboardInterrupt:
        if not done:
            values.write(guess)
            raise
    ranked = sorted(done, key=lambda each: _order(each, sign))
    values.write(ranked[0].point if ranked[0].result is not None else guess)
    seconds = time.perf_counter() - started
    return MultistartResult(model.name, tuple(ranked), starts - len(done), seconds, values)


def _solve_one(model: Any, number: int, values: VariableValues, options: Mapping[str, Any]) -> StartOutcome:
    try:
        result = solve(model, progress=False, **options)
    except (ModelError, SolverNotFoundError):
        raise  # no other start could do better
    except PyRobocopError as error:
        return StartOutcome(number, None, f"{type(error).__name__}: {error}")
    return StartOutcome(number, result, point=values.read())


def _order(outcome: StartOutcome, sign: float) -> tuple[Any, ...]:
    result = outcome.result
    if result is None:
        return (2, 0.0, outcome.start)
    if not outcome.feasible:
        return (1, max(result.constraint_violation, result.largest_product), outcome.start)
    # A plan that passes through an obstacle is often the cheapest.
    unsafe = result.safe is False
    # Starts that lead to one optimum differ by the solver's tolerance, which must not decide.
    return (0, unsafe, float(f"{sign * result.objective:.6g}"), not result.solved, outcome.start)


def _line(outcome: StartOutcome) -> str:
    result = outcome.result
    if result is None:
        return f"{outcome.start:>5} {'-':>14}  error: {outcome.error}"
    return (
        f"{outcome.start:>5} {result.objective:>14.7g}  {result.quality.name.lower():<10} "
        f"{result.certificate.name.lower():<11} {result.iterations:>6}"
    )
