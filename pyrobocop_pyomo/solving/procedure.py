"""`solve`: from a model with complementarity to a verified point, in one call."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.transformation import TransformationFactory

from pyrobocop_pyomo.complementarity import FollowBarrier, Schedule
from pyrobocop_pyomo.complementarity.pairs import active_sources
from pyrobocop_pyomo.errors import ComplementarityError, SolverNotFoundError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.ipopt.routes import Route, available_routes, best_route
from pyrobocop_pyomo.phases import PhaseBlockData

from .assessment import PointJudge
from .attempt import Attempt
from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .progress import Progress
from .session import Session
from .solve_result import STEP_HEADER, SolveResult

logger = logging.getLogger(__name__)

DEFAULT_OPTIONS = {"max_iter": 3000}
# Ipopt loosens all bounds a little by default, and the two sides of a pair could both become slightly negative.
DEFAULT_PAIR_OPTIONS = {"bound_relax_factor": 0.0}


def solve(
    model: Any,
    *,
    relaxation: Any = "scholtes",
    grouping: Any = "pair",
    schedule: Schedule | None = None,
    route: Route | str | None = None,
    options: Mapping[str, Any] | None = None,
    tee: bool = False,
    time_limit: float | None = None,
    feasibility_tolerance: float = 1e-6,
    complementarity_tolerance: float = 1e-7,
    progress: bool | None = None,
) -> SolveResult:
    """Relax the model's complementarity pairs, drive the relaxation to zero, and report.

    The model is checked first, then relaxed, solved by one or more runs of Ipopt, and taken back: afterwards it
    holds the best point found and is otherwise as it was. A relaxation that the user has applied is used and kept.
    Models without pairs are solved by one run.

    Parameters
    ----------
    model : ConcreteModel or Block
        Any Pyomo model, with phases or without.
    relaxation, grouping : str or object
        As for ``pyrobocop.relax_complementarity``.
    schedule : Schedule, optional
        How delta shrinks. By default it follows Ipopt's barrier parameter, ``FollowBarrier(factor=2)``, with a
        geometric continuation from the same guess if that ends without an acceptable point.
    route : Route or str, optional
        Which Ipopt: ``"in process"`` (the best derivatives present), ``"asl"``, ``"casadi"``, ``"mapped"`` or
        ``"executable"``.
    options : mapping, optional
        Ipopt's options; they win over those that are set here.
    tee : bool
        Show Ipopt's log.
    time_limit : float, optional
        Seconds, for all runs together.
    feasibility_tolerance : float
        Largest violation of a constraint or bound in an acceptable point.
    complementarity_tolerance : float
        Largest product ``a b`` in an acceptable point.
    progress : bool, optional
        Show a line per step; by default only on a terminal.

    Returns
    -------
    SolveResult
        Also after a failure, a limit or Ctrl-C.

    Raises
    ------
    ModelError
        When the model makes no sense; nothing was solved then.
    SolverNotFoundError
        When there is no Ipopt; the message lists the remedies.

    References
    ----------
    Raghunathan & Biegler, An interior point method for mathematical programs with complementarity constraints,
    SIAM J. Optim. 15 (2005), doi:10.1137/S1052623403429081;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. III-B, doi:10.1109/ICRA46639.2022.9812069
    """
    started = time.perf_counter()
    chosen_route = _find_route(route)
    _check_phases(model)
    judge = PointJudge(model)
    bar = Progress(progress)
    with _relaxed(model, relaxation, grouping, _first_delta(schedule)) as (block, rows):
        pairs = [] if block is None else TransformationFactory("pyrobocop.relax_complementarity").get_pairs(model)
        if pairs and isinstance(schedule, FollowBarrier) and not rows:
            raise ComplementarityError(
                f"'{model.name}': delta cannot follow the barrier parameter with the relaxation {relaxation!r}, "
                "which bounds no row by it. Use schedule=Geometric(...) or Fixed(...)."
            )
        wanted = {**DEFAULT_OPTIONS, **(DEFAULT_PAIR_OPTIONS if pairs else {}), **(options or {})}
        session = _open_session(model, block, rows, chosen_route, wanted, tee, _live_line(bar, model, tee))
        logger.info("'%s': %s, derivatives by %s", model.name, session.solver, session.derivatives)
        bar.line(f"{model.name}: {session.solver}, derivatives by {session.derivatives}")
        bar.line(STEP_HEADER)
        try:
            attempt = Attempt(model, judge, pairs, session, bar, feasibility_tolerance, complementarity_tolerance)
            attempt.go(schedule, bool(rows), started, time_limit)
            attempt.restore_best()
        finally:
            session.close()
        if attempt.best_is_last:
            session.load_suffixes()
            _forget_generated(model, block)
    best = attempt.steps[attempt.best]
    return SolveResult(
        name=model.name,
        stop_reason=attempt.stop_reason,
        quality=attempt.quality(),
        objective=best.objective,
        constraint_violation=best.constraint_violation,
        stationarity=attempt.stationarity,
        residuals=attempt.residuals(),
        steps=attempt.steps,
        best_step=attempt.best,
        solver=session.solver,
        derivatives=session.derivatives,
        judging_seconds=attempt.judging_seconds,
        seconds=time.perf_counter() - started,
    )


def _find_route(route: Route | str | None) -> Route:
    words = {
        "asl": Route.IN_PROCESS_ASL,
        "casadi": Route.IN_PROCESS_CASADI,
        "mapped": Route.IN_PROCESS_MAPPED,
        "executable": Route.EXECUTABLE,
    }
    if route is None:
        return best_route()
    present = available_routes()
    if route == "in process":
        wanted = Route.IN_PROCESS_ASL if Route.IN_PROCESS_ASL in present else Route.IN_PROCESS_CASADI
    elif isinstance(route, Route):
        wanted = route
    elif route in words:
        wanted = words[route]
    else:
        raise ValueError(f"route = {route!r}; choose 'in process', {', '.join(map(repr, words))} or a Route.")
    if wanted not in present:
        found = "; ".join(each.value for each in present) or "none"
        raise SolverNotFoundError(
            f"{wanted.value}: not found on this machine; found: {found}. "
            "'python -m pyrobocop_pyomo doctor' shows what is missing."
        )
    return wanted


def _check_phases(model: Any) -> None:
    for block in model.block_data_objects(active=True, descend_into=Block):
        if isinstance(block, PhaseBlockData):
            block.check()


def _first_delta(schedule: Schedule | None) -> float:
    return 1e-2 if schedule is None or isinstance(schedule, FollowBarrier) else next(iter(schedule.steps()))


@contextmanager
def _relaxed(model: Any, relaxation: Any, grouping: Any, delta: float) -> Iterator[tuple[Any, list[Any]]]:
    """Relax what is not relaxed yet; yields the generated block and the rows that a shift moves; reverts."""
    relax = TransformationFactory("pyrobocop.relax_complementarity")
    if active_sources(model):
        token = relax.apply_to(model, relaxation=relaxation, grouping=grouping, delta=delta)
        try:
            yield token.block, relax.relaxed_rows(model)
        finally:
            relax.revert(model, token)
    elif relax.get_pairs(model):
        own = relax.get_delta(model)
        before = own.value
        try:
            yield own.parent_block(), relax.relaxed_rows(model)
        finally:
            own.set_value(before)
    else:
        yield None, []


def _open_session(
    model: Any, block: Any, rows: list[Any], route: Route, options: Mapping[str, Any], tee: bool, on_iteration: Any
) -> Session:
    delta = None if block is None else block.delta
    if route is Route.EXECUTABLE:
        return ExecutableSession(model, delta, options, tee)
    return InProcessSession(model, delta, rows, route.derivatives, options, tee, on_iteration)


def _live_line(bar: Progress, model: Any, tee: bool) -> Any:
    if tee:
        return None  # Ipopt's own log says more

    def show(record: IterationRecord) -> None:
        if record.iteration % 10 == 0:
            bar.live(
                f"{model.name}: iteration {record.iteration}, mu {record.mu:.1e}, objective {record.objective:.6g}, "
                f"infeasibility {record.primal_infeasibility:.1e}"
            )

    return show


def _forget_generated(model: Any, block: Any) -> None:
    """Multipliers of generated rows must not stay in the user's suffixes when the rows go."""
    if block is None:
        return
    for suffix in model.component_objects(Suffix, active=True):
        for component in [each for each in suffix if each is not None and each.parent_block() is block]:
            del suffix[component]
