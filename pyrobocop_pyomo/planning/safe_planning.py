"""Plans that keep clear of obstacles all along: solve, verify the continuous motion, tighten where it fails.

The rows of an `ObstacleAvoidanceBlock` say something about single times. What counts is what `verify` proves of the
motion in between, so a solved model is only the first round: planes that the motion crosses between the nodes get a
margin, those where a margin does not help are split in two, and pairs that were left out come back. Where Ipopt finds
no feasible point at all, see `recovery`.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.motion.safety_report import joined_report
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.tightening import tighten, tighten_containment
from pyrobocop_pyomo.solving.ipopt_options import SOLVE_AGAIN
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .planning_round import PlanningRound
from .recovery import Recovery

logger = logging.getLogger(__name__)

# From one start. A motion that is not safe by then passes through an obstacle between the nodes, and stays there.
MOST_ROUNDS = 7
# From this round on, planes of which margins alone did not make a safe plan are split.
FIRST_SPLIT = 3


def avoidance_blocks(model: Any) -> list[ObstacleAvoidanceBlockData]:
    """The active `ObstacleAvoidanceBlock` of a model, wherever they are."""
    return blocks_of_kind(model, ObstacleAvoidanceBlockData)


def containments(model: Any) -> list[ContainmentData]:
    """The active `Containment` of a model, wherever they are."""
    return blocks_of_kind(model, ContainmentData)


class SafePlanning:
    """Rounds of solving and verifying on one model.

    Parameters
    ----------
    model : Block
    blocks : list of ObstacleAvoidanceBlockData
        Its active ones.
    regions : list of ContainmentData
        Its active ones.
    settings : Settings
    """

    def __init__(
        self,
        model: Any,
        blocks: list[ObstacleAvoidanceBlockData],
        regions: list[ContainmentData],
        settings: Settings,
    ) -> None:
        self._model, self._blocks, self._regions, self._settings = model, blocks, regions, settings
        self.rounds: list[PlanningRound] = []
        self._reports: list[SafetyReport]  # of each block, then of each region
        self._best: PlanningRound | None = None
        self._interrupted = False

    def plan(self) -> SolveResult:
        """Solve from one start after the other until the motion is proven to be safe; the best point is kept.

        Raises
        ------
        KeyboardInterrupt
            Only before a first round was verified; later ones end with the best round.
        """
        try:
            self._plan()
        except KeyboardInterrupt:
            if self._best is None:
                raise
            self._interrupted = True
        except BaseException:
            if self._best is not None:
                self._best.restore()
            raise
        return self._best_of_all()

    def _plan(self) -> None:
        recovery = Recovery(self._model, self._blocks, self._regions, self)
        for step in recovery.steps():
            result = step()
            if result.quality is not Quality.INFEASIBLE:
                result = self._made_safe(result)
            if self._is_good_enough or not self.may_go_on(result):
                break

    # ---------------------------------------------------------------- one round

    def solve(self, purpose: str, *, again: bool = False, relaxed: bool = False) -> SolveResult:
        """Solve the model as it stands, verify what comes out, and remember both.

        Parameters
        ----------
        purpose : str
            For the log.
        again : bool
            Whether the point on the model is nearly a solution already.
        relaxed : bool
            Whether less is asked than the user did: such a round leads on, and is no answer itself.
        """
        settings = self._settings
        if again:
            settings = replace(settings, options=settings.options.with_default(SOLVE_AGAIN))
        result = solve_model(self._model, settings)
        self._reports = [block.verify() for block in (*self._blocks, *self._regions)]
        report = joined_report(self._reports)
        made = PlanningRound.now(purpose, self._model, self._blocks, self._regions, result, report)
        self.rounds.append(made)
        if len(self.rounds) == 1:
            settings.progress.line(made.HEADER)
        settings.progress.line(str(made))
        logger.info("'%s': %s", self._model.name, made)
        if not relaxed and (self._best is None or made.standing.is_better_than(self._best.standing)):
            self._best = made
        return result

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""
        return not result.stop_reason.is_final and not self._settings.deadline.has_passed

    # ---------------------------------------------------------------- from feasible to safe

    def _made_safe(self, result: SolveResult) -> SolveResult:
        """Tighten and solve again until the motion is safe, or it does not seem to become so."""
        point = VariableValues.of_free(self._model)
        reports = self._reports
        for number in range(1, MOST_ROUNDS):
            if joined_report(reports).safe or not self.may_go_on(result):
                break
            purpose = self._tightened(reports, split=number >= FIRST_SPLIT or result.quality is Quality.INFEASIBLE)
            if not purpose:
                break
            result = self.solve(purpose, again=True)
            if result.quality is Quality.INFEASIBLE:
                # Margins may ask too much of a plane that a whole interval shares: its halves get planes of their own.
                point.restore()
            else:
                point, reports = VariableValues.of_free(self._model), self._reports
        return result

    @property
    def _is_good_enough(self) -> bool:
        """Safe; or feasible, where nobody asked for more than the points."""
        assert self._best is not None
        asked = bool(self._regions) or any(block.record.per_interval for block in self._blocks)
        return self._best.is_safe or (self._best.quality is not Quality.INFEASIBLE and not asked)

    def _tightened(self, reports: Sequence[SafetyReport], *, split: bool) -> str:
        """Ask for more where the motion was not safe; returns what was done, or nothing if nothing can be."""
        count = len(self._blocks)
        pairs = zip(self._blocks, reports[:count], strict=True)
        done = [what for block, report in pairs for what in tighten(block, report, split=split)]
        inside = zip(self._regions, reports[count:], strict=True)
        done += [what for region, report in inside for what in tighten_containment(region, report)]
        return ", ".join(dict.fromkeys(done))

    def _best_of_all(self) -> SolveResult:
        """The best round, its point on the model, with the steps of all."""
        assert self._best is not None
        self._best.restore()
        before = sum(len(made.result.steps) for made in self.rounds[: self.rounds.index(self._best)])
        best = self._best.result
        return replace(
            best,
            stop_reason=self._stop_reason(),
            best=replace(best.best, number=best.best.number + before),
            steps=[step for made in self.rounds for step in made.result.steps],
            checking_seconds=sum(made.result.checking_seconds for made in self.rounds),
            rounds=tuple(made.record() for made in self.rounds),
        )

    def _stop_reason(self) -> StopReason:
        """What ended the rounds: a limit, where it did; else what the best round says."""
        assert self._best is not None
        last = self.rounds[-1].result.stop_reason
        if self._interrupted:
            return StopReason.INTERRUPTED
        if self._best.is_safe:
            return self._best.result.stop_reason
        if last.is_final:
            return last
        return StopReason.TIME_LIMIT if self._settings.deadline.has_passed else self._best.result.stop_reason
