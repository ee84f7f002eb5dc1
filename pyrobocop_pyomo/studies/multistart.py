"""`multistart`: solve from many starting points, rank what comes out, and leave the best on the model."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError, SolveFailed
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.sending import check_picklable
from pyrobocop_pyomo.execution.tasks import GIVEN_UP, Task, run_tasks, study_engine
from pyrobocop_pyomo.ipopt.backends import best_backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import note_outcome
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.random_starts import RandomStarts

from .named_data import by_component
from .outcomes import COMMON_COLUMNS, Column, Outcome, StudyResult, ranked, result_or_error, seconds_left, table_row

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class StartOutcome(Outcome):
    """What became of one start.

    Attributes
    ----------
    start : int
        0 is the initial guess that was on the model.
    """

    start: int


@dataclass(frozen=True, eq=False, kw_only=True)
class MultistartResult(StudyResult[StartOutcome]):
    """Outcomes, the best first: feasible ones by objective, then infeasible ones by violation, then errors.

    Where there are obstacles, plans that are proven safe come before others that are feasible. The point of the
    best outcome is on the model. Starts that a time limit or Ctrl-C left undone are in `remaining`.
    """

    _values: VariableValues = field(repr=False)
    _model: Any = field(repr=False)

    own_columns = (Column("start", 5, lambda outcome: outcome.start, "d"),)

    def load(self, place: int) -> SolveResult:
        """Put the point of another start on the model and return its result.

        Parameters
        ----------
        place : int
            In this ranking, from 0.

        Raises
        ------
        SolveFailed
            When it has none.
        """
        chosen = self.outcomes[place]
        if chosen.result is None:
            raise SolveFailed(f"'{self.name}': start {chosen.start} has no point. {chosen.error}", self)
        self._values.write(chosen.values)
        note_outcome(self._model, chosen.result.outcome)
        return chosen.result


def multistart(
    model: Any,
    starts: int = 10,
    *,
    seed: int = 0,
    spread: float | Mapping[str, float] | Iterable[tuple[Any, float]] = 1.0,
    workers: int | str = 1,
    engine: str | Engine | None = None,
    time_limit: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> MultistartResult:
    """Solve a model from several starting points.

    The first start is the initial guess on the model. The others are drawn around it: a variable with two bounds
    anywhere between them, any other within ``max(1, |guess|)`` of its guess and its bounds; values of one variable of
    a phase form a smooth curve over time. The model is left with the best point.

    Parameters
    ----------
    model : Block
    starts : int
        How many, the initial guess included.
    seed : int
        The same seed gives the same starts, and start k does not depend on how many there are.
    spread : float, mapping or iterable
        Scales the distances from the initial guess; with 1, variables with two bounds fill them. ``{"x": 0.5}`` or
        ``[(m.x, 0.5)]`` varies only the variables named and leaves the others at their initial guess.
    workers : int or "all"
        Number of processes, or one on each core; with 1 all is done in this one. The outcomes are the same. More need a
        model that can be pickled; where it cannot, a warning says why, and all is done in this process. A script has
        to keep its work under ``if __name__ == "__main__":``, since each process imports it.
    engine : str or Engine, optional
        Where the starts are solved instead: ``"process"``, ``"dask"``, ``"mpi"`` or an object of `rcp.teams`, as for
        teams. With ``"mpi"`` every rank calls this function with the same arguments, and all get the same answer.
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
    EngineError
        When the engine is not installed, or none of its workers starts.
    SolverNotFoundError
        When there is no Ipopt.
    """
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise ModelError(f"starts = {starts!r}; expected a number of starting points of at least 1.")
    running = study_engine(workers, engine)
    running = None if starts == 1 else running
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    values = VariableValues.of_free(model)
    make = partial(_StartSolver, model, seed, spread if starts > 1 else None, options)
    solver = make()
    if running is not None:
        best_backend()  # raises with the remedies where there is none, once and not for every start
        try:
            check_picklable({"the model": model, "the options": dict(options)}, by_value=True)
        except ModelError as error:
            logger.warning("'%s': all starts are solved in this process: %s", model.name, error)
            running = None
    bar = Progress(progress if running is None or running.writes_files else False)
    solver.progress = lambda number: bar.within(f"{number} of {starts} starts done")
    columns = (*MultistartResult.own_columns, *COMMON_COLUMNS)
    outcomes: list[StartOutcome] = []

    def take(outcome: StartOutcome) -> tuple[Task, ...] | None:
        outcomes.append(outcome)
        bar.line(f"start {table_row(columns, outcome, len(outcomes))}")
        if len(outcomes) < starts:
            bar.live(f"{len(outcomes)} of {starts} starts done")
        return None if outcome.cut_short else ()

    run_tasks(
        [Task(number, (number,)) for number in range(starts)], take,
        make=make if running is not None else lambda: solver, engine=running, most=starts, deadline=deadline,
        given_up=lambda task: StartOutcome(task.key, error=GIVEN_UP),
    )  # fmt: skip
    values.write(values.taken)
    outcomes.sort(key=lambda outcome: outcome.start)
    if not outcomes:
        if not deadline.has_passed:
            raise KeyboardInterrupt
        take(solver.solve(0, deadline=deadline))  # which says what the initial guess is worth
    bar.live("")
    order = ranked(outcomes)
    values.write(order[0].values if order[0].result is not None else values.taken)
    if order[0].result is not None:
        note_outcome(model, order[0].result.outcome)
    return MultistartResult(
        name=model.name, outcomes=order,
        remaining=tuple(sorted(set(range(starts)) - {outcome.start for outcome in outcomes})),
        seconds=time.perf_counter() - started, _values=values, _model=model,
    )  # fmt: skip


class _StartSolver:
    """Solves one start after the other on one model."""

    def __init__(self, model: Any, seed: int, spread: Any, options: Mapping[str, Any]) -> None:
        self._model, self._options, self._values = model, options, VariableValues.of_free(model)
        self._random = None if spread is None else RandomStarts(model, seed, spreads(model, spread))
        self.progress: Callable[[int], Progress | bool] = lambda number: False

    def solve(self, number: int, *, deadline: Deadline) -> StartOutcome:
        started = time.perf_counter()
        self._values.write(self._values.taken)
        if self._random is not None and number:
            self._random.put(number)
        try:
            options = {**self._options, "time_limit": seconds_left(deadline)}
            result, error = result_or_error(self._model, options, self.progress(number))
        except Exception as raised:
            if hasattr(raised, "add_note"):
                raised.add_note(f"'{self._model.name}': raised by start {number}.")
            raise
        seconds, found = time.perf_counter() - started, [] if result is None else self._values.read()
        return StartOutcome(number, result=result, error=error, seconds=seconds, values=found)


def spreads(model: Any, spread: Any) -> dict[int | None, float]:
    """Read how far the variables of a component go: by the identity of the component, None for all others."""
    given = [(None, spread)] if isinstance(spread, (int, float)) else by_component(spread, model)
    found = {}
    for component, number in given:
        name = "spread" if component is None else f"the spread of '{getattr(component, 'name', component)}'"
        if component is not None and getattr(component, "ctype", None) is not Var:
            raise ModelError(f"'{model.name}': {name} is for no Var. The keys of spread are Vars or their names.")
        if isinstance(number, bool) or not isinstance(number, (int, float)) or not 0.0 <= number < float("inf"):
            raise ModelError(f"'{model.name}': {name} is {number!r}; expected a finite number >= 0.")
        found[None if component is None else id(component.parent_component())] = float(number)
    return found
