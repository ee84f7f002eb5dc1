"""`solve`: from a model with complementarity to a certified point, in one call."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TextIO

from pyomo.core.base.block import Block
from pyomo.core.base.transformation import TransformationFactory

from pyrobocop_pyomo.complementarity import Schedule
from pyrobocop_pyomo.errors import ModelError, SolverNotFoundError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.ipopt.routes import Route, available_routes, best_route
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.obstacles.initial_checks import (
    check_clearances,
    check_contained_motion,
    check_fixed_inside,
    check_motion,
)
from pyrobocop_pyomo.phases import PhaseBlockData

from .assessment import PointJudge
from .attempt import StepRecorder
from .avoidance import SafePlanning, avoidance_blocks, containments
from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .ladder import Ladder
from .progress import Progress
from .relaxed_model import RelaxedModel
from .rungs import Rung, as_rungs
from .session import Session
from .settings import Settings
from .solve_result import SolveResult
from .step import STEP_HEADER
from .tolerances import Tolerances

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
    rungs: str | Rung | Iterable[str | Rung] | None = None,
    polish: bool = True,
    route: Route | str | None = None,
    options: Mapping[str, Any] | None = None,
    tee: bool | Sequence[TextIO] = False,
    time_limit: float | None = None,
    feasibility_tolerance: float = 1e-6,
    complementarity_tolerance: float = 1e-7,
    progress: bool | None = None,
) -> SolveResult:
    """Solve a model with complementarity pairs: relax, continue, polish, certify, and report.

    The model is checked first, then relaxed, solved by runs of Ipopt, and taken back: afterwards it holds the best
    point found and is otherwise as it was. A relaxation that the user has applied is used and kept, without polish
    where it is not lifted. Models without pairs are solved by one run.

    The rungs of the ladder are climbed until one gives a certain point, and the best point of all wins:

    * "barrier": delta follows Ipopt's barrier parameter in one solve, ``FollowBarrier(factor=2)``;
    * "tight": one solve at delta = 1e-8 from the user's guess, as a cross-check of up to 100 pairs;
    * "continuation": delta from 1 to 1e-8 by factors of 0.1, warm in primal and dual values; also a second opinion
      on certain points where there are more than 100 pairs, or where solutions found so far differ;
    * "elastic": the products below a variable that is charged in the objective;
    * "projection": the branch that the linearised constraints can be met in, from the best point so far.

    Every rung is finished by a *polish*: the nonlinear program of the nearest branch is solved, so that each pair is
    met exactly; other branches through the point are followed as long as they descend; and the multipliers that are
    left, or a linear program with complementarity constraints, certify that none does. Up to 100 pairs, branches that
    the same linear program names from farther away are tried as well (steps "explore"). Where no branch can be solved,
    delta goes down to 1e-12 instead.

    Parameters
    ----------
    model : ConcreteModel or Block
        Any Pyomo model, with phases or without.
    relaxation, grouping : str or object
        As for ``pyrobocop.relax_complementarity``.
    schedule : Schedule, optional
        How delta shrinks, in a single rung of its own instead of the ladder.
    rungs : str, Rung or several of them, optional
        Which rungs to climb; by default the whole ladder.
    polish : bool
        Finish each rung as described; without it, a point is as complementary as its relaxation.
    route : Route or str, optional
        Which Ipopt: ``"in process"`` (the best derivatives present), ``"asl"``, ``"casadi"``, ``"mapped"`` or
        ``"executable"``. By default the best that is present; for models with obstacles ``"mapped"``, which is faster
        there.
    options : mapping, optional
        Ipopt's options; they win over those that are set here.
    tee : bool or sequence of text streams
        Show Ipopt's log, on standard output or on these streams.
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
    Raghunathan, Jha & Romeres, ICRA 2022, sec. III-B, doi:10.1109/ICRA46639.2022.9812069;
    Nurkanovic & Leyffer (2025), A globally convergent method for computing B-stationary points of mathematical
    programs with equilibrium constraints, doi:10.48550/arXiv.2501.13835
    """
    started = time.perf_counter()
    blocks, regions = avoidance_blocks(model), containments(model)
    chosen_route, otherwise = _find_route(route), None
    # Each turned normal is part of the rows of many corners. ASL differentiates such shared parts anew for each row,
    # which takes several times as long; mapped expressions do not know all functions, though.
    if blocks and route is None and Route.IN_PROCESS_MAPPED in available_routes():
        chosen_route, otherwise = Route.IN_PROCESS_MAPPED, chosen_route
    chosen_rungs = _chosen_rungs(schedule, rungs)
    _check_phases(model)
    for block in blocks:
        check_clearances(block, feasibility_tolerance)
        check_motion(block)
    for region in regions:
        check_fixed_inside(region, feasibility_tolerance)
        check_contained_motion(region)
    bar = Progress(progress)
    tolerances = Tolerances(feasibility=feasibility_tolerance, product=complementarity_tolerance)
    has_pairs = bool(TransformationFactory("pyrobocop.relax_complementarity").get_pairs(model))
    wanted = {**DEFAULT_OPTIONS, **(DEFAULT_PAIR_OPTIONS if has_pairs else {}), **(options or {})}
    output = tuple(tee) if isinstance(tee, Sequence) else ((sys.stdout,) if tee else ())
    settings = Settings(relaxation, grouping, chosen_route, wanted, output, tolerances, polish, otherwise)

    def left() -> float | None:
        return None if time_limit is None else time_limit - (time.perf_counter() - started)

    if blocks or regions:
        result = SafePlanning(model, blocks, regions, partial(climb, model), settings, chosen_rungs, bar, left).plan()
    else:
        result = climb(model, settings, chosen_rungs, bar, left)
    return replace(result, seconds=time.perf_counter() - started)


def climb(
    model: Any, settings: Settings, rungs: Sequence[Rung] | None, bar: Progress, left: Callable[[], float | None]
) -> SolveResult:
    """Climb the ladder on a model as it stands, and judge the best point of it.

    Parameters
    ----------
    model : Block
    settings : Settings
    rungs : sequence of Rung, optional
        By default the whole ladder.
    bar : Progress
    left : callable
        Seconds that are left, or None.
    """
    started = time.perf_counter()
    judge = PointJudge(model)
    recorder = StepRecorder(judge, bar)
    ladder = Ladder(model, judge, settings, recorder, partial(_open_session, settings, bar), left)
    best = ladder.climb(rungs)
    quality, multipliers = best.quality(settings.tolerances), best.explain()
    if multipliers is not None and multipliers.kind is Stationarity.S:
        best.certificate = Certificate.PROVEN
    return SolveResult(
        name=model.name,
        stop_reason=best.reason,
        quality=quality,
        objective=best.step.objective,
        constraint_violation=best.step.constraint_violation,
        stationarity=best.stationarity,
        certificate=best.certificate,
        multipliers=multipliers,
        residuals=recorder.residuals(),
        steps=recorder.steps,
        best_step=recorder.steps.index(best.step),
        rung=best.rung,
        decided_pairs=ladder.decided,
        solver=ladder.solver,
        derivatives=ladder.derivatives,
        judging_seconds=recorder.seconds,
        seconds=time.perf_counter() - started,
    )


def _chosen_rungs(
    schedule: Schedule | None, rungs: str | Rung | Iterable[str | Rung] | None
) -> tuple[Rung, ...] | None:
    if schedule is not None and rungs is not None:
        raise ValueError("schedule= is a rung of its own; give it or rungs=, not both.")
    if schedule is not None:
        return (Rung("schedule", schedule),)
    return None if rungs is None else as_rungs(rungs)


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


def _open_session(settings: Settings, bar: Progress, relaxed: RelaxedModel, options: Mapping[str, Any]) -> Session:
    name, output = relaxed.model.name, settings.output
    session: Session
    if settings.route is Route.EXECUTABLE:
        session = ExecutableSession(relaxed, options, output)
    else:
        live = None if output else _live_line(bar, name)
        try:
            session = InProcessSession(relaxed, settings.route.derivatives, options, output, live)
        except ModelError as error:
            if settings.otherwise is None:
                raise
            logger.info("'%s': %s is not taken: %s", name, settings.route.value, error)
            return _open_session(replace(settings, route=settings.otherwise, otherwise=None), bar, relaxed, options)
    logger.info("'%s': %s, derivatives by %s", name, session.solver, session.derivatives)
    bar.line_once(f"{name}: {session.solver}, derivatives by {session.derivatives}")
    bar.line(STEP_HEADER)
    return session


def _live_line(bar: Progress, name: str) -> Any:
    def show(record: IterationRecord) -> None:
        if record.iteration % 10 == 0:
            bar.live(
                f"{name}: iteration {record.iteration}, mu {record.mu:.1e}, objective {record.objective:.6g}, "
                f"infeasibility {record.primal_infeasibility:.1e}"
            )

    return show
