"""`homotopy`: follow a path of data from an easy problem to the wanted one, each solve from the last point."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ModelError, SolveFailed
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import Values
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.solving import SolveResult
from pyrobocop_pyomo.solving.strategies import in_order

from .case_solver import CaseSolver, ModelState
from .named_data import by_component, finite_number, fixed_members, member_values
from .outcomes import Outcome, StudyResult
from .sweep_cases import SweepCase

# Near a solution the tight problem is solved at once; what it leaves goes through looser ones.
FOLLOWING_STRATEGIES = ("tight", "barrier", "continuation")
_PATH = "its path"


@dataclass(frozen=True, eq=False, kw_only=True)
class HomotopyResult(StudyResult):
    """The problems on the way, in order; the data of each are its ``position`` on the path, from 0 to 1.

    Where a problem is not feasible, the step along the path was halved. `best` is the last one that is, whose data and
    point are on the model.
    """

    def _best_first(self) -> tuple[Outcome, ...]:
        return tuple(step for step in reversed(self.outcomes) if step.feasible)

    @property
    def position(self) -> float:
        """How far the path was followed: 1 at its end, -1 where not even its first problem was solved."""
        return max((step.case.data["position"] for step in self.outcomes if step.feasible), default=-1.0)

    @property
    def reached(self) -> bool:
        """Whether the path was followed to its end, and the point there is optimal."""
        return self.position == 1.0 and self.best.solved

    def __str__(self) -> str:
        return f"{self.name}: followed to {max(self.position, 0.0):.5g}\n{self.table()}"


class _PathSolver(CaseSolver):
    """Solves each problem of a path from the point before, whatever the model; the first from the initial guess."""

    def _solve(
        self, state: ModelState, near: tuple[int, Values] | None, deadline: Deadline
    ) -> tuple[SolveResult, bool]:
        if near is None:
            return self._solved(deadline), False
        state.write(near[1])
        return self._solved(deadline, strategies=in_order(self._options.get("strategies"), FOLLOWING_STRATEGIES)), True


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
    SolveFailed
        When the step became too small, or at the time limit or Ctrl-C. The model then holds the data and the point of
        the last problem that was solved; where there is none, all is as it was before. Its ``result`` says how far the
        path was followed.
    ModelError
        When the arguments make no sense.
    """
    if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
        raise ModelError(f"steps = {steps!r}; expected a number of steps of at least 1.")
    if not 0.0 < smallest_step <= 1.0:
        raise ModelError(f"smallest_step = {smallest_step!r}; expected a part of the path, between 0 and 1.")
    started, deadline, bar = time.perf_counter(), Deadline.after(time_limit), Progress(progress)
    put = moving_data(model, parameters)
    solver = _PathSolver(model, lambda _, data: put(data["position"]), None, {**options, "progress": False})
    found: list[Outcome] = []
    last: Outcome | None = None  # the last one that was solved
    position, longest, successes = -1.0, 1.0 / steps, 0
    length = longest

    def so_far() -> HomotopyResult:
        seconds = time.perf_counter() - started
        return HomotopyResult(name=model.name, outcomes=tuple(found), seconds=seconds, _solver=solver)

    try:
        while position < 1.0:
            # Sums of tenths miss one by rounding.
            wanted = 0.0 if last is None else position + length
            wanted = 1.0 if wanted > 1.0 - 1e-9 else wanted
            bar.live(f"at {wanted:.4g}")
            near = None if last is None else (last.case.number, last.values)
            case = SweepCase(len(found), f"at {wanted:.5f}", {"position": wanted})
            step = solver.solve(case, near, None, deadline=deadline)
            found.append(step)
            why = "" if step.feasible else f" {step.reason}"
            bar.line(f"{model.name}: {step.name} {step.verdict}, objective {step.objective:.7g}.{why}")
            if step.feasible:
                last, position, successes = step, wanted, successes + 1
                # One success says little of the next step: doubling at once would fail every other time.
                if successes > 1:
                    length, successes = min(2.0 * length, longest), 0
            else:
                length, successes = 0.5 * length, 0
            is_stuck = not step.feasible and (last is None or length < smallest_step)
            if is_stuck or (step.cut_short and position < 1.0):
                raise SolveFailed(_why_it_ended(model, step, position, smallest_step), so_far())
    finally:
        solver.close()
        if last is not None:
            so_far().load(last.case.number)
    return so_far()


def _why_it_ended(model: Any, step: Outcome, position: float, shortest: float) -> str:
    why = step.error if step.result is None else f"{step.result.stop_reason.value} {step.result.quality.value}"
    missed = step.case.data["position"]
    if position < 0.0:
        where = "the first problem of the path was not solved. Start from easier data, or from a better initial guess"
        return f"'{model.name}': {where}. {why} The model is as it was before."
    return (
        f"'{model.name}': the path was followed to {position:.5g} of 1, to {missed:.5g} not in steps of "
        f"{shortest:.1e}: take another path around this place, or a smaller smallest_step. {why} The model holds the "
        "last data that were solved, with their point."
    )


def moving_data(model: Any, path: Any) -> Callable[[float], object]:
    """What puts the data of a position between 0 and 1 on a model.

    Parameters
    ----------
    model : Block
    path : mapping, iterable or callable
        As `homotopy` takes it.

    Raises
    ------
    ModelError
        If a component cannot move, or an end of a line is no number.
    """
    if callable(path):
        return path
    lines = [line for component, ends in by_component(path, model) for line in _lines(component, ends)]
    if not lines:
        raise ModelError(f"'{model.name}': no parameters were given that could move.")

    def put(position: float) -> None:
        for member, first, last in lines:
            # Both ends exactly, whatever rounding does in between.
            member.set_value(last if position == 1.0 else first + position * (last - first))

    return put


def _lines(component: Any, ends: Any) -> Iterator[tuple[Any, float, float]]:
    """Members of a component, where each starts and where it ends."""
    fixed_members(component)  # refuses what is part of the solution
    first, last = ends if isinstance(ends, (tuple, list)) and len(ends) == 2 else (None, ends)
    starts = {} if first is None else {id(of): start for of, start in member_values(component, first, _PATH)}
    for member, end in member_values(component, last, _PATH):
        start = starts.get(id(member), value(member, exception=False))
        yield member, finite_number(start, member.name, _PATH), end
