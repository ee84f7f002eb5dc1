"""`solve`: from a model with complementarity to a certified point, in one call."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from pyrobocop_pyomo.complementarity import Schedule
from pyrobocop_pyomo.errors import ModelError, SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import Backend, available_backends, best_backend
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.phases import phases_of

from .assessment import PointJudge
from .attempt import StepRecorder
from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .ladder import Ladder
from .progress import Progress
from .relaxed_model import RelaxedModel
from .session import Session
from .settings import Settings
from .solve_result import SolveResult
from .step import STEP_HEADER
from .strategies import Strategy, as_strategies

logger = logging.getLogger(__name__)

DEFAULT_OPTIONS = {"max_iter": 3000}
# Ipopt loosens all bounds a little by default, and the two sides of a pair could both become slightly negative.
DEFAULT_PAIR_OPTIONS = {"bound_relax_factor": 0.0}


def climb(
    model: Any,
    settings: Settings,
    strategies: Sequence[Strategy] | None,
    bar: Progress,
    left: Callable[[], float | None],
) -> SolveResult:
    """Climb the ladder on a model as it stands, and judge the best point of it.

    Parameters
    ----------
    model : Block
    settings : Settings
    strategies : sequence of Strategy, optional
        By default the whole ladder.
    bar : Progress
    left : callable
        Seconds that are left, or None.
    """
    started = time.perf_counter()
    judge = PointJudge(model)
    recorder = StepRecorder(judge, bar)
    ladder = Ladder(model, judge, settings, recorder, partial(_open_session, settings, bar), left)
    best = ladder.climb(strategies)
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
        strategy=best.strategy,
        decided_pairs=ladder.decided,
        solver=ladder.solver,
        derivatives=ladder.derivatives,
        judging_seconds=recorder.seconds,
        seconds=time.perf_counter() - started,
    )


def _chosen_strategies(
    schedule: Schedule | None, strategies: str | Strategy | Iterable[str | Strategy] | None
) -> tuple[Strategy, ...] | None:
    if schedule is not None and strategies is not None:
        raise ValueError("schedule= is a strategy of its own; give it or strategies=, not both.")
    if schedule is not None:
        return (Strategy("schedule", schedule),)
    return None if strategies is None else as_strategies(strategies)


def _find_backend(backend: Backend | str | None) -> Backend:
    words = {
        "asl": Backend.IN_PROCESS_ASL,
        "casadi": Backend.IN_PROCESS_CASADI,
        "vectorised": Backend.IN_PROCESS_VECTORISED,
        "executable": Backend.EXECUTABLE,
    }
    if backend is None:
        return best_backend()
    present = available_backends()
    if backend == "in process":
        wanted = Backend.IN_PROCESS_ASL if Backend.IN_PROCESS_ASL in present else Backend.IN_PROCESS_CASADI
    elif isinstance(backend, Backend):
        wanted = backend
    elif backend in words:
        wanted = words[backend]
    else:
        raise ValueError(f"backend = {backend!r}; choose 'in process', {', '.join(map(repr, words))} or a Backend.")
    if wanted not in present:
        found = "; ".join(each.value for each in present) or "none"
        raise SolverNotFoundError(
            f"{wanted.value}: not found on this machine; found: {found}. "
            "'python -m pyrobocop_pyomo doctor' shows what is missing."
        )
    return wanted


def _check_phases(model: Any) -> None:
    for phase in phases_of(model):
        phase.check()


def _open_session(settings: Settings, bar: Progress, relaxed: RelaxedModel, options: Mapping[str, Any]) -> Session:
    name, output = relaxed.model.name, settings.output
    session: Session
    if settings.backend is Backend.EXECUTABLE:
        session = ExecutableSession(relaxed, options, output)
    else:
        live = None if output else _live_line(bar, name)
        try:
            session = InProcessSession(relaxed, settings.backend.derivatives, options, output, live)
        except ModelError as error:
            if settings.otherwise is None:
                raise
            logger.info("'%s': %s is not taken: %s", name, settings.backend.value, error)
            return _open_session(replace(settings, backend=settings.otherwise, otherwise=None), bar, relaxed, options)
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
