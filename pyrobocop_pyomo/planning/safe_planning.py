"""Plans that keep clear of obstacles all along: solve, verify the continuous motion, tighten where it fails.

The rows of an `ObstacleAvoidanceBlock` say something about single times. What counts is what `verify` proves of the
motion in between, so a solved model is only the first round: planes that the motion crosses between the nodes get a
margin, those where a margin does not help are split in two, and pairs that were left out come back. Where Ipopt finds
no feasible point at all, see `recovery`.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from pyrobocop_pyomo.errors import ModelError, ObstacleError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.motion.safety_report import joined_report
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.broad_phase import ran_through_what_was_left_out
from pyrobocop_pyomo.obstacles.pictures import scene_of
from pyrobocop_pyomo.obstacles.tightening import tighten
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.programs.compiled_model import KeptProgram
from pyrobocop_pyomo.solving.ipopt_options import NEARLY_SAFE, NEARLY_THERE, SIDE_ITERATIONS
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.starts import elements_of
from pyrobocop_pyomo.solving.strategies import Settings

from .mesh_loop import MeshLoop, plan_for_safety
from .recovery import PlanningPoint, PlanStart, Recovery

logger = logging.getLogger(__name__)

# From one start. A motion that is not safe by then passes through an obstacle between the nodes, and stays there.
MOST_ROUNDS = 7
# Rounds without a feasible point, one after the other, until another start is tried; and rounds until planes of which
# margins alone did not make a safe plan are split.
MOST_IN_VAIN = 3


@dataclass(frozen=True, eq=False)
class PlanningRound:
    """One solve with the verification of the motion that came out.

    Attributes
    ----------
    purpose : str
        What was changed before it.
    quality : Quality
    objective : float
    iterations : int
        Of Ipopt, in all steps of the solve.
    shortfall : float
        By how much the motion comes closer than its clearance, at worst, that of the equations included; negative where
        there is room left.
    worst : str
        The two bodies for which that is so.
    safe : bool or None
        As `SafetyReport.safe`.
    seconds : float
        Of the solve.
    """

    purpose: str
    quality: Quality
    objective: float
    iterations: int
    shortfall: float
    worst: str
    safe: bool | None
    seconds: float

    HEADER: ClassVar[str] = (
        f"{'quality':<10} {'objective':>13} {'iter':>6} {'shortfall':>10} {'safe':>5} {'seconds':>8}  "
        f"{'worst pair':<28} round"
    )

    @classmethod
    def of(cls, purpose: str, result: SolveResult, report: SafetyReport) -> PlanningRound:
        """The round that ended with a result, and the report on its motion."""
        worst = report.worst
        return cls(
            purpose,
            result.quality,
            result.objective,
            result.iterations,
            0.0 if worst is None else worst.shortfall,
            "" if worst is None else f"{worst.first} - {worst.second}",
            report.safe,
            result.seconds,
        )

    def __str__(self) -> str:
        # What was done takes as much room as it needs, at the end.
        safe = "clear" if self.safe is None else "yes" if self.safe else "no"
        return (
            f"{self.quality.name:<10} {self.objective:>13.6g} {self.iterations:>6} {self.shortfall:>10.2e} "
            f"{safe:>5} {self.seconds:>8.2f}  {self.worst:<28} {self.purpose}"
        )


def _with_safety(result: SolveResult, report: SafetyReport) -> SolveResult:
    """A result with the report on its motion, and what the motion lacks in its standing."""
    safe, worst = report.safe, report.worst
    # A motion that is not proven stands behind every one that is, also where no instant of it is too close, and one
    # that is clear but not replayed behind those that are.
    unproven = max(worst.shortfall, worst.tolerance) if worst is not None and safe is False else 0.0
    lacking = math.ulp(0.0) if safe is None else unproven
    return replace(result, safety=report, standing=replace(result.standing, shortfall=lacking))


def _is_settled(result: SolveResult) -> bool:
    """Whether it is a plan to go by, as far as can be known."""
    return result.safety is not None and result.was_safe is not False


class SafePlanning:
    """Rounds of solving and verifying on one model.

    Parameters
    ----------
    model : Block
    settings : Settings
    """

    def __init__(self, model: Any, settings: Settings) -> None:
        self._model, self._blocks, self._regions = model, avoidance_blocks(model), containments(model)
        # Rounds in which margins alone have changed have the same program.
        self._settings = replace(settings, program=KeptProgram())
        self.rounds: list[PlanningRound] = []
        self.results: list[SolveResult] = []  # of the rounds
        self._reports: dict[Any, SafetyReport]  # of each block and region
        self._best: tuple[SolveResult, PlanningPoint] | None = None
        self._seconds_per_element = 0.0  # of the longest verification so far
        self._interrupted = False
        self._meshes = MeshLoop(model)
        self._began = VariableValues.of_free(model)
        self._recovery = Recovery(model, self)

    def plan(self) -> SolveResult:
        """Solve from one start after the other until the motion is proven to be safe; the best point is kept.

        Raises
        ------
        KeyboardInterrupt
            Only before a first round was verified; later ones end with the best round.
        """
        try:
            with undone_on_failure(self._restore_best):
                self._plan()
        except KeyboardInterrupt:
            if self._best is None:
                raise
            self._interrupted = True
        except ObstacleError as error:
            if self._best is None:
                raise
            logger.warning(
                "'%s': no further start can be made (%s); the best round so far is kept.", self._model.name, error
            )
        return self._best_of_all()

    def _restore_best(self) -> None:
        if self._best is not None:
            self._best[1].restore()

    def _plan(self) -> None:
        for start in self._recovery.starts():
            result = self.solve(start)
            if result.quality is not Quality.INFEASIBLE:
                result = self._made_safe(result)
            if self._is_good_enough or not self.may_go_on(result):
                break

    # ---------------------------------------------------------------- one round

    def solve(self, start: PlanStart) -> SolveResult:
        """Solve the model as it stands, verify what comes out, and remember both."""
        limit = {} if start.most_iterations is None else {"max_iter": start.most_iterations}
        near = (NEARLY_SAFE if self._is_nearly_safe else NEARLY_THERE) if start.is_near else {}
        options = self._settings.options.with_default({**near, **limit})
        self._began = VariableValues.of_free(self._model)
        result = solve_model(self._model, replace(self._settings, options=options, deadline=self.deadline))
        # A plan that is not feasible is not integrated: its equations do not hold.
        equations = result.quality is not Quality.INFEASIBLE
        started = time.perf_counter()
        self._reports = {block: block.verify(equations=equations) for block in (*self._blocks, *self._regions)}
        spent = time.perf_counter() - started
        self._seconds_per_element = max(self._seconds_per_element, spent / max(elements_of(self._model), 1))
        report = joined_report(self._reports.values())
        result = _with_safety(result, report)
        made = PlanningRound.of(start.purpose, result, report)
        self.rounds.append(made)
        self.results.append(result)
        if len(self.rounds) == 1:
            self._settings.progress.line(made.HEADER)
        self._settings.progress.line(str(made))
        logger.info("'%s': %s", self._model.name, made)
        if self._best is None or result.standing.is_better_than(self._best[0].standing):
            self._best = result, PlanningPoint(self._model)
        return result

    @property
    def _is_nearly_safe(self) -> bool:
        """Whether the last plan is too close by its clearance at most: what margins or a finer mesh make safe."""
        last = self.results[-1] if self.results else None
        if last is None or last.quality is Quality.INFEASIBLE or last.safety is None:
            return False
        worst = last.safety.worst
        return worst is not None and worst.shortfall <= worst.clearance

    def put_motion_without_obstacles(self) -> None:
        """Put the best motion without obstacles on the model, where it is found at once; else nothing changes."""
        # A clearance that the optimiser chooses has no meaning without obstacles.
        if any(block.record.depends_on_what_is_far for block in self._blocks):
            return
        guess, found = VariableValues.of_free(self._model), False
        # It is only a start: what does not converge quickly is not worth waiting for.
        options = self._settings.options.with_default({"max_iter": SIDE_ITERATIONS})
        for block in self._blocks:
            block.deactivate()
        try:
            settings = replace(self._settings, options=options, exploration=0.0, progress=Progress(False))
            result = solve_model(self._model, settings)
            # For a start it is enough that the run came to its end.
            found = result.quality is not Quality.INFEASIBLE and result.stop_reason is StopReason.FINISHED
        except PyRobocopError as error:
            logger.info("'%s': no motion without obstacles: %s", self._model.name, error)
        finally:
            for block in self._blocks:
                block.activate()
            if not found:
                guess.restore()

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""
        return not result.stop_reason.is_final and not self.deadline.has_passed

    @property
    def deadline(self) -> Deadline:
        """Until when solving may take, so that a verification on the mesh as it is ends by the time limit."""
        return self._settings.deadline.earlier_by(self._seconds_per_element * elements_of(self._model))

    # ---------------------------------------------------------------- from feasible to safe

    def _made_safe(self, result: SolveResult) -> SolveResult:
        """Tighten and solve again until the motion is safe, or it does not seem to become so."""
        start, can_go_back, in_vain = self._began, True, 0
        point, reports = VariableValues.of_free(self._model), self._reports
        for number in range(1, MOST_ROUNDS):
            report = joined_report(reports.values())
            if report.safe is not False or not self.may_go_on(result):
                break
            finer = self._on_a_finer_mesh(result, reports)
            if finer is not None:
                # The start stands on another mesh than the plan now.
                result, can_go_back = finer, False
            else:
                if not self.may_go_on(result):
                    break  # finer meshes took what was left
                goes_back = can_go_back and any(ran_through_what_was_left_out(of, reports[of]) for of in self._blocks)
                split = number >= MOST_IN_VAIN or result.quality is Quality.INFEASIBLE
                done = [what for block, of in reports.items() for what in tighten(block, of, split=split)]
                purpose = ", ".join(dict.fromkeys(done))
                if not purpose:
                    break
                if goes_back:
                    # The way out of an obstacle may be on its wrong side; the start was far from it.
                    start.restore()
                    self._recovery.initialize_separations()
                result = self.solve(PlanStart(purpose, is_near=True))
            if result.quality is Quality.INFEASIBLE:
                in_vain += 1
                if in_vain == MOST_IN_VAIN:
                    break
                # Margins may ask too much of a plane that a whole interval shares: its halves get planes of their own.
                point.restore()
                continue
            in_vain, point, reports = 0, VariableValues.of_free(self._model), self._reports
            if self._is_nearly_safe:
                # Where the next round leaves what is nearly safe, it starts again from there.
                start, can_go_back = point, True
        return result

    def _on_a_finer_mesh(self, result: SolveResult, reports: Mapping[Any, SafetyReport]) -> SolveResult | None:
        """Solve again on a finer mesh where the plan is clear and its equations are not; or None."""
        is_clear = not any(pair.violated for pair in joined_report(reports.values()).body_pairs)
        if self._meshes.has_ended or result.quality is Quality.INFEASIBLE or not is_clear:
            return None
        try:
            plan = plan_for_safety(reports)
        except PyRobocopError as error:
            self._meshes.keep_meshes(error)
            return None
        purpose = str(plan)

        def solve() -> SolveResult | None:
            return self.solve(PlanStart(purpose, None, is_near=True)) if self.may_go_on(result) else None

        def is_feasible(finer: SolveResult) -> bool:
            self._meshes.has_ended = finer.quality is Quality.INFEASIBLE
            return not self._meshes.has_ended

        return self._meshes.solve_on(plan, solve, is_feasible) if plan.meshes else None

    @property
    def _is_good_enough(self) -> bool:
        """As safe as is known; or feasible, where only points were asked for."""
        assert self._best is not None
        best = self._best[0]
        if _is_settled(best) or best.quality is Quality.INFEASIBLE:
            return _is_settled(best)
        asked = bool(self._regions) or any(block.record.per_interval for block in self._blocks)
        return not asked

    def _best_of_all(self) -> SolveResult:
        """The best round, its point on the model, with the steps of all."""
        assert self._best is not None
        self._restore_best()
        best = with_steps_of_all(self._best[0], self.results)
        why_no_path = "" if _is_settled(best) else self._recovery.why_no_path
        return replace(
            best,
            stop_reason=self._stop_reason(best),
            remarks=(*filter(None, [why_no_path]), *best.remarks, *filter(None, [self._meshes.remark])),
            checking_seconds=sum(result.checking_seconds for result in self.results),
            rounds=tuple(self.rounds),
            scenes=self._scenes(),
        )

    def _scenes(self) -> tuple[Any, ...]:
        """What pictures show of the point on the model; without it where a pose has no value."""
        try:
            return tuple(scene_of(block) for block in self._blocks)
        except ModelError:
            return ()

    def _stop_reason(self, best: SolveResult) -> StopReason:
        """What ended the rounds: a limit, where it did; else what the best round says."""
        last = self.results[-1].stop_reason
        if self._interrupted:
            return StopReason.INTERRUPTED
        if _is_settled(best):
            return best.stop_reason
        if last.is_final:
            return last
        return StopReason.TIME_LIMIT if self.deadline.has_passed else best.stop_reason
