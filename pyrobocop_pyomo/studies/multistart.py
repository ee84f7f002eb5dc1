"""`multistart`: solve from many starting points, rank what comes out, and leave the best on the model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.solving.starts import RandomStarts

from .outcomes import StudyResult, ranked
from .sweep import sweep
from .sweep_cases import by_component


@dataclass(frozen=True, eq=False, kw_only=True)
class MultistartResult(StudyResult):
    """Outcomes, the best first: feasible ones by objective, then infeasible ones by violation, then errors.

    Where there are obstacles, plans that are proven safe come before others that are feasible. The point of the
    best outcome is on the model. The number of a start is ``outcome.case.number``, 0 for the initial guess that was on
    the model; starts that a time limit or Ctrl-C left undone are in `remaining`.
    """

    @property
    def reached(self) -> bool:
        """Whether the best point is optimal and, where there are obstacles, safe."""
        return bool(self.outcomes) and self.outcomes[0].solved


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
        model that can be pickled. A script has to keep its work under ``if __name__ == "__main__":``, since each
        process imports it.
    engine : str or Engine, optional
        Where the starts are solved instead: ``"process"``, ``"dask"``, ``"mpi"`` or an object of `rcp.teams`, as for
        teams.
    time_limit : float, optional
        Seconds, for all starts together.
    progress : bool, optional
        Show how far it is; by default only on a terminal.
    **options
        Passed to `solve`.

    Returns
    -------
    MultistartResult
        Also when no start succeeds, and after Ctrl-C.

    Raises
    ------
    ModelError
        When the arguments make no sense, or the model cannot be sent to another process.
    EngineError
        When the engine is not installed, or none of its workers starts.
    SolverNotFoundError
        When there is no Ipopt.
    """
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise ModelError(f"starts = {starts!r}; expected a number of starting points of at least 1.")
    if starts > 1:
        put_random_start(seed, spread, model, {"start": 0})  # refuses what makes no sense
    put = partial(put_random_start, seed, spread if starts > 1 else None)
    cases = {str(number): {"start": number} for number in range(starts)}
    found = sweep(
        model, cases, put=put, start_from=None, workers=workers, engine=engine, time_limit=time_limit,
        progress=progress, **options,
    )  # fmt: skip
    several = MultistartResult(
        name=model.name, outcomes=ranked(found), remaining=tuple(map(int, found.remaining)), seconds=found.seconds,
        _solver=found._solver,
    )  # fmt: skip
    if not several.outcomes or several.outcomes[0].standing is None:
        return several
    best, *others = several.outcomes
    return replace(several, outcomes=(replace(best, result=several.load(0)), *others))


def put_random_start(seed: int, spread: Any, model: Any, data: Mapping[str, int]) -> None:
    """Put a start on a model that has the initial guess, which is start 0."""
    if spread is not None:
        starts = RandomStarts(model, seed, spreads(model, spread))
        if data["start"]:
            starts.put(data["start"])


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
