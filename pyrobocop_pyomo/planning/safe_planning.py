"""Plans that keep clear of obstacles all along: solve, verify the continuous motion, tighten where it fails.

The rows of an `ObstacleAvoidanceBlock` say something about single times. What counts is what `verify` proves of the
motion in between, so a solved model is only the first round: planes that the motion bulges beyond get a margin, those
where a margin does not help are split in two, and pairs that were left out come back. Where Ipopt finds no feasible
point at all, see `recovery`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.motion.safety_report import joined_report
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.tightening import tighten, tighten_containment
from pyrobocop_pyomo.solving.attempt import FINAL_REASONS
from pyrobocop_pyomo.solving.planning_round import ROUND_HEADER, PlanningRound
from pyrobocop_pyomo.solving.point import Point
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.quality import Quality
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult, StopReason
from pyrobocop_pyomo.solving.strategies import Strategy

from .kept_round import KeptRound
from .recovery import Recovery

logger = logging.getLogger(__name__)

Climb = Callable[[Settings, Sequence[Strategy] | None, Progress, Callable[[], float | None]], SolveResult]

# From one start. A motion that is not safe by then passes through an obstacle between the nodes, and stays there.
MOST_ROUNDS = 7
# From this round on, planes of which margins alone did not make a safe plan are split.
FIRST_SPLIT = 3
# The last point is nearly the next one: start near it, and do not go back to the middle of the bounds.
AGAIN = {"mu_init": 1e-3, "bound_push": 1e-4, "bound_frac": 1e-4}


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
    climb : callable
        Solves the model as it stands.
    settings : Settings
    strategies : sequence of Strategy or None
        What the caller asked for.
    bar : Progress
    left : callable
        Seconds that are left, or None.
    """

    def __init__(
        self,
        model: Any,
        blocks: list[ObstacleAvoidanceBlockData],
        regions: list[ContainmentData],
        climb: Climb,
        settings: Settings,
        strategies: Sequence[Strategy] | None,
        bar: Progress,
        left: Callable[[], float | None],
    ) -> None:
        self._model, self._blocks, self._regions = model, blocks, regions
        self._climb, self._settings, self._rungs = climb, settings, strategies
        self._bar, self._left = bar, left
        self.rounds: list[PlanningRound] = []
        self._results: list[SolveResult] = []
        self._reports: list[SafetyReport]  # of each block, then of each region
        self._best: KeptRound | None = None
        self._interrupted = False

    def plan(self) -> SolveResult:
        """Solve from one start after the other until the motion is proven to be safe; the best point is kept.

        Raises
        ------
        KeyboardInterrupt
            Only before a first round was judged; later ones end with the best round.
        """
        try:
            self._plan()
        except KeyboardInterrupt:
            if self._best is None:
                raise
            self._interrupted = True
        except BaseException:
            if self._best is not None:
                self._best.restore(self._blocks, self._regions)
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
        settings = replace(self._settings, options={**AGAIN, **self._settings.options}) if again else self._settings
        result = self._climb(settings, self._rungs, self._bar, self._left)
        self._results.append(result)
        self._reports = [each.verify() for each in (*self._blocks, *self._regions)]
        report = joined_report(self._reports)
        self.rounds.append(PlanningRound.of(purpose, result, report))
        if len(self.rounds) == 1:
            self._bar.line(ROUND_HEADER)
        self._bar.line(str(self.rounds[-1]))
        logger.info("'%s': %s", self._model.name, self.rounds[-1])
        if not relaxed:
            kept = KeptRound.now(self._model, self._blocks, self._regions, result, report)
            if self._best is None or kept.rank > self._best.rank:
                self._best = kept
        return result

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""
        left = self._left()
        return result.stop_reason not in FINAL_REASONS and (left is None or left > 0.0)

    # ---------------------------------------------------------------- from feasible to safe

    def _made_safe(self, result: SolveResult) -> SolveResult:
        """Tighten and solve again until the motion is safe, or it does not seem to become so."""
        point = Point(self._model)
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
                point, reports = Point(self._model), self._reports
        return result

    @property
    def _is_good_enough(self) -> bool:
        """Safe; or feasible, where nobody asked for more than the points."""
        assert self._best is not None
        asked = bool(self._regions) or any(block.record.per_interval for block in self._blocks)
        return self._best.is_safe or (self._best.result.quality is not Quality.INFEASIBLE and not asked)

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
        best = self._best.result
        self._best.restore(self._blocks, self._regions)
        # By identity: two results may be equal in what can be compared, and hold arrays, which cannot.
        before = self._results[: next(i for i, each in enumerate(self._results) if each is best)]
        return replace(
            best,
            stop_reason=self._stop_reason(),
            steps=[step for result in self._results for step in result.steps],
            best_step=best.best_step + sum(len(result.steps) for result in before),
            judging_seconds=sum(result.judging_seconds for result in self._results),
            safety=self._best.report,
            rounds=tuple(self.rounds),
        )

    def _stop_reason(self) -> StopReason:
        """What ended the rounds: a limit, where it did; else what the best round says."""
        assert self._best is not None
        last, left = self._results[-1].stop_reason, self._left()
        if self._interrupted:
            return StopReason.INTERRUPTED
        if self._best.is_safe:
            return self._best.result.stop_reason
        if last in FINAL_REASONS:
            return last
        return StopReason.TIME_LIMIT if left is not None and left <= 0.0 else self._best.result.stop_reason
