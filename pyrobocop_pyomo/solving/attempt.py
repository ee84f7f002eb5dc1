"""One attempt at a solution: a schedule of runs, each judged by its own residuals, the best one remembered."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity import BarrierSchedule, CanonicalPair, PairResidual, Schedule, pair_residuals
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .assessment import PointJudge
from .progress import Progress
from .session import Run, Session
from .solve_result import StopReason
from .step import Step
from .tolerances import Tolerances
from .variable_values import Values, VariableValues

logger = logging.getLogger(__name__)

_STOP_REASONS = {
    IpoptStatus.INTERRUPTED: StopReason.INTERRUPTED,
    IpoptStatus.STOPPED: StopReason.INTERRUPTED,
    IpoptStatus.ITERATION_LIMIT: StopReason.ITERATION_LIMIT,
    IpoptStatus.TIME_LIMIT: StopReason.TIME_LIMIT,
    IpoptStatus.INFEASIBLE: StopReason.INFEASIBLE,
}
# So often on the way down is a step halved, in powers of ten, before the next one is taken without multipliers.
SHORTENED_STEPS = 4
FINAL_REASONS = (StopReason.INTERRUPTED, StopReason.TIME_LIMIT)


class StepRecorder:
    """Judges the point on the model after each run and writes the log.

    Parameters
    ----------
    judge : PointJudge
    bar : Progress

    Attributes
    ----------
    pairs : sequence of CanonicalPair
        To be judged.
    steps : list of Step
    seconds : float
        Elapsed in judging.
    """

    def __init__(self, judge: PointJudge, bar: Progress) -> None:
        self._judge, self._bar = judge, bar
        self.pairs: Sequence[CanonicalPair] = ()
        self.steps: list[Step] = []
        self.seconds = 0.0

    def record(self, run: Run) -> Step:
        """Judge the point on the model and remember the run."""
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
        self.seconds += time.perf_counter() - started
        self.steps.append(step)
        self._bar.line(str(step))
        logger.info("%s", step)
        return step

    def residuals(self) -> list[PairResidual]:
        """The pairs at the model's current values."""
        return pair_residuals(self.pairs)


@dataclass(eq=False)
class AttemptedPoint:
    """A point after a run, while its session is open."""

    step: Step
    values: Values
    stationarity: float | None
    load_suffixes: Callable[[], None]
    multipliers: Callable[[CompiledModel], tuple[FloatArray, FloatArray, FloatArray]]
    rewind: Callable[[], None]


@dataclass(frozen=True, eq=False)
class _Solved:
    """Where a schedule got to, and how to be there again."""

    delta: float
    values: Values
    rewind: Callable[[], None]


class Attempt:
    """Runs a schedule, and remembers the best point.

    Parameters
    ----------
    session : Session
    recorder : StepRecorder
    values : VariableValues
        What a point is made of.
    tolerances : Tolerances
    left : callable
        Seconds that are left, or None.
    inexact : bool
        Whether the runs before the last may stop early: not where multipliers decide how the relaxation goes on.

    Attributes
    ----------
    stop_reason : StopReason
        Of the last run.
    """

    def __init__(
        self,
        session: Session,
        recorder: StepRecorder,
        values: VariableValues,
        tolerances: Tolerances,
        left: Callable[[], float | None],
        *,
        inexact: bool = False,
    ) -> None:
        self._inexact = inexact
        self._session, self._recorder, self._values = session, recorder, values
        self._tolerances, self._left = tolerances, left
        self._best: AttemptedPoint | None = None
        self.stop_reason = StopReason.FINISHED

    def go(self, schedule: Schedule | None, options: Mapping[str, Any], *, warm: bool = False) -> AttemptedPoint:
        """Run the schedule; None stands for one run of a model without pairs.

        With ``warm`` a shrinking schedule starts with the point on the model and the session's last multipliers.
        """
        if schedule is None:
            self._take(self._session.run(None, time_limit=self._left(), options=options))
        elif isinstance(schedule, BarrierSchedule):
            self._follow(schedule, options)
        else:
            self._shrink(schedule, options, warm)
        assert self._best is not None
        return self._best

    def _follow(self, schedule: BarrierSchedule, options: Mapping[str, Any]) -> None:
        step = None
        last = list(schedule.steps())[-1]
        for run in self._session.follow(schedule, time_limit=self._left(), options=options):
            step = self._take(run)
        # The rows may have moved in the very last iterations; products above their final bound say so.
        if step is not None and step.status.solved and step.largest_product > 10 * last:
            self._take(self._session.run(last, warm=True, time_limit=self._left(), options=options))

    def _shrink(self, schedule: Schedule, options: Mapping[str, Any], warm: bool) -> None:
        """Solve for one delta after the other; where a step is too long, take a shorter one from the last solution."""
        wanted = list(schedule.steps())[::-1]
        last = wanted[0]
        solved: _Solved | None = None
        if warm:
            solved = _Solved(wanted[-1], self._values.read(), self._session.rewinder())
        shortened = 0
        while wanted:
            delta = wanted.pop()
            # Exact at the end only: before, the next run takes on what is left.
            loose = {} if delta == last or not self._inexact else {"tol": 1e-4}
            step = self._take(
                self._session.run(delta, warm=solved is not None, time_limit=self._left(), options={**loose, **options})
            )
            if self.stop_reason in FINAL_REASONS:
                return
            if step.status.solved and step.largest_natural_residual <= 1e-9:
                return
            if step.status.solved or step.status is IpoptStatus.TINY_STEP:
                solved = _Solved(delta, self._values.read(), self._session.rewinder())
            elif solved is not None and shortened < SHORTENED_STEPS:
                self._values.write(solved.values)
                solved.rewind()
                wanted += [delta, (delta * solved.delta) ** 0.5]
                shortened += 1
            else:
                # A failed run leaves multipliers that are worth nothing, and often a point that is.
                solved = None
                if self._best is not None:
                    self._values.write(self._best.values)

    def _take(self, run: Run) -> Step:
        step = self._recorder.record(run)
        self.stop_reason = stop_reason(step)
        if self._best is None or self._rank(step) <= self._rank(self._best.step):
            session = self._session
            self._best = AttemptedPoint(
                step,
                self._values.read(),
                session.stationarity(),
                session.suffix_loader(),
                session.multipliers,
                session.rewinder(),
            )
        return step

    def _rank(self, step: Step) -> tuple[float, bool]:
        """Smaller is better: how far the residuals exceed the tolerances, then convergence."""
        return (step.excess(self._tolerances), not step.status.solved)


def stop_reason(step: Step) -> StopReason:
    """Why a run ended, as a reason for the procedure to end."""
    if step.status.solved or step.status is IpoptStatus.TINY_STEP:
        return StopReason.FINISHED
    return _STOP_REASONS.get(step.status, StopReason.FAILED)
