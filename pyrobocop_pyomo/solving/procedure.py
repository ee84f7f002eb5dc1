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
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import (
    FollowBarrier,
    Geometric,
    PairResidual,
    Schedule,
    active_pairs,
    pair_residuals,
)
from pyrobocop_pyomo.errors import ComplementarityError, SolverNotFoundError
from pyrobocop_pyomo.phases import PhaseBlockData

from .assessment import PointJudge
from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .ipopt_outcome import IpoptStatus, IterationRecord
from .progress import Progress
from .routes import Route, available_routes, best_route
from .session import Run, Session
from .solve_result import STEP_HEADER, Quality, SolveResult, Step, StopReason

logger = logging.getLogger(__name__)

# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
DEFAULT_SCHEDULE = FollowBarrier(factor=2.0)
FALLBACK_SCHEDULE = Geometric(first=1.0, factor=0.1, last=1e-8)

DEFAULT_OPTIONS = {"max_iter": 3000}
# Ipopt loosens all bounds a little by default, and the two sides of a pair could both become slightly negative.
DEFAULT_PAIR_OPTIONS = {"bound_relax_factor": 0.0}

_STOP_REASONS = {
    IpoptStatus.INTERRUPTED: StopReason.INTERRUPTED,
    IpoptStatus.STOPPED: StopReason.INTERRUPTED,
    IpoptStatus.ITERATION_LIMIT: StopReason.ITERATION_LIMIT,
    IpoptStatus.TIME_LIMIT: StopReason.TIME_LIMIT,
    IpoptStatus.INFEASIBLE: StopReason.INFEASIBLE,
}
_FINAL = (StopReason.INTERRUPTED, StopReason.TIME_LIMIT)


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
        if block is not None and isinstance(schedule, FollowBarrier) and not rows:
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
            attempt = _Attempt(model, judge, pairs, session, bar, feasibility_tolerance, complementarity_tolerance)
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


class _Attempt:
    """Runs a schedule, judges each step by its own residuals, and remembers the best point."""

    def __init__(
        self,
        model: Any,
        judge: PointJudge,
        pairs: list[Any],
        session: Session,
        bar: Progress,
        feasibility_tolerance: float,
        complementarity_tolerance: float,
    ) -> None:
        self._variables = [v for v in model.component_data_objects(Var, active=True) if not v.fixed]
        self._start = [v.value for v in self._variables]
        self._judge, self._pairs, self._session, self._bar = judge, pairs, session, bar
        self._tolerances = feasibility_tolerance, complementarity_tolerance
        self.steps: list[Step] = []
        self.best = -1
        self._best_values: list[float | None] = self._start
        self.stop_reason = StopReason.FINISHED
        self.stationarity: float | None = None
        self.judging_seconds = 0.0

    def go(self, schedule: Schedule | None, shiftable: bool, started: float, time_limit: float | None) -> None:
        def left() -> float | None:
            return None if time_limit is None else time_limit - (time.perf_counter() - started)

        if not self._pairs:
            self._take(self._session.run(None, time_limit=left()))
            return
        if schedule is None:
            first = DEFAULT_SCHEDULE if shiftable else FALLBACK_SCHEDULE
            self._follow(first, left)
            if shiftable and not self._acceptable(self.steps[self.best]) and self.stop_reason not in _FINAL:
                logger.info(
                    "no acceptable point with delta following mu; continuing from the guess with %s", FALLBACK_SCHEDULE
                )
                self._put(self._start)
                self._follow(FALLBACK_SCHEDULE, left)
        else:
            self._follow(schedule, left)

    def _follow(self, schedule: Schedule, left: Any) -> None:
        if isinstance(schedule, FollowBarrier):
            for run in self._session.follow(schedule, time_limit=left()):
                self._take(run)
            step = self.steps[-1]
            # The rows may have moved in the very last iterations; products above their final bound say so.
            if step.status.solved and step.largest_product > 10 * schedule.floor:
                self._take(self._session.run(schedule.floor, warm=True, time_limit=left()))
            return
        warm = False
        for delta in schedule.steps():
            step = self._take(self._session.run(delta, warm=warm, time_limit=left()))
            if self.stop_reason in _FINAL:
                return
            # A failed run leaves multipliers that are worth nothing, and often a point that is.
            warm = step.status.solved or step.status is IpoptStatus.TINY_STEP
            if not warm:
                self.restore_best()
            if step.status.solved and step.largest_natural_residual <= 1e-9:
                return

    def _take(self, run: Run) -> Step:
        started = time.perf_counter()
        residuals = self.residuals()
        step = Step(
            label=run.label,
            delta=run.delta,
            mu=run.mu,
            status=run.status,
            iterations=run.iterations,
            seconds=run.seconds,
            objective=self._judge.objective(),
            constraint_violation=max(self._judge.violation(), *(each.infeasibility for each in residuals), 0.0),
            largest_product=max((abs(each.product) for each in residuals), default=0.0),
            largest_natural_residual=max((abs(each.natural) for each in residuals), default=0.0),
            path=run.path,
        )
        self.judging_seconds += time.perf_counter() - started
        self.steps.append(step)
        self._bar.line(str(step))
        logger.info("%s", step)
        self.stop_reason = _stop_reason(step)
        if self.best < 0 or self._rank(step) <= self._rank(self.steps[self.best]):
            self.best = len(self.steps) - 1
            self._best_values = [v.value for v in self._variables]
            self.stationarity = self._session.stationarity()
        return step

    def _rank(self, step: Step) -> tuple[float, bool]:
        """Smaller is better: how far the residuals exceed the tolerances (1 if not at all), then convergence."""
        feasibility, complementarity = self._tolerances
        excess = max(step.constraint_violation / feasibility, step.largest_product / complementarity, 1.0)
        return (excess if excess == excess else float("inf"), not step.status.solved)

    def _acceptable(self, step: Step) -> bool:
        return self._rank(step) == (1.0, False)

    @property
    def best_is_last(self) -> bool:
        return self.best == len(self.steps) - 1

    def residuals(self) -> list[PairResidual]:
        return pair_residuals(self._pairs)

    def restore_best(self) -> None:
        self._put(self._best_values)

    def _put(self, values: list[float | None]) -> None:
        for variable, number in zip(self._variables, values, strict=True):
            variable.set_value(number, skip_validation=True)

    def quality(self) -> Quality:
        step = self.steps[self.best]
        if self._rank(step)[0] > 1.0:
            return Quality.INFEASIBLE
        shown = step.status.solved or step.status is IpoptStatus.TINY_STEP
        if self.stationarity is not None:
            shown = shown and self.stationarity <= 1e-5
        return Quality.OPTIMAL if shown else Quality.FEASIBLE


def _stop_reason(step: Step) -> StopReason:
    if step.status.solved or step.status is IpoptStatus.TINY_STEP:
        return StopReason.FINISHED
    return _STOP_REASONS.get(step.status, StopReason.FAILED)


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
    if active_pairs(model):
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
