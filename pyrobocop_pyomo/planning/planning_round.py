"""One round of planning around obstacles: what was done, what came out, how safe it is, and the way back to it."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.solving.iterates import Quality, Standing
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .planning_point import PlanningPoint

logger = logging.getLogger(__name__)


def _cannot_restore() -> None:
    raise RuntimeError("only rounds of a plan that is being made can be gone back to")


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
        As `SafetyReport.safe`; False as well where nobody looked.
    seconds : float
        Of the solve.
    result : SolveResult
        Of the solve, with its safety; None in the list that a result keeps.
    restore : callable
        Puts the point back, with the margins and norms of this round.
    """

    purpose: str
    quality: Quality
    objective: float
    iterations: int
    shortfall: float
    worst: str
    safe: bool | None
    seconds: float
    result: Any = field(default=None, repr=False)
    restore: Callable[[], None] = field(default=_cannot_restore, repr=False)

    HEADER: ClassVar[str] = (
        f"{'quality':<10} {'objective':>13} {'iter':>6} {'shortfall':>10} {'safe':>5} {'seconds':>8}  "
        f"{'worst pair':<28} round"
    )

    @classmethod
    def now(
        cls,
        purpose: str,
        model: Any,
        blocks: list[ObstacleAvoidanceBlockData],
        regions: list[ContainmentData],
        result: SolveResult,
        report: SafetyReport | None,
    ) -> PlanningRound:
        """The round that has just been solved, and verified unless there is no report."""
        safe, worst = (False, None) if report is None else (report.safe, report.worst)
        shortfall = worst.shortfall if worst is not None else 0.0
        # A motion that is not proven stands behind every one that is, also where no instant of it is too close, and one
        # that is clear but not replayed behind those that are.
        unproven = max(shortfall, worst.tolerance) if worst is not None and safe is False else 0.0
        lacking = math.ulp(0.0) if safe is None else unproven
        standing = replace(result.standing, shortfall=lacking)
        return cls(
            purpose=purpose,
            quality=result.quality,
            objective=result.objective,
            iterations=result.iterations,
            shortfall=shortfall,
            worst=f"{worst.first} - {worst.second}" if worst is not None else "",
            safe=safe,
            seconds=result.seconds,
            result=replace(result, safety=report, standing=standing),
            restore=way_back(model, blocks, regions),
        )

    @property
    def standing(self) -> Standing:
        """What decides between this round and another one."""
        return self.result.standing

    @property
    def is_settled(self) -> bool:
        """Whether it is a plan to go by, as far as can be known."""
        safety = self.result.safety
        return safety is not None and safety.safe is not False and self.quality is not Quality.INFEASIBLE

    @property
    def is_nearly_safe(self) -> bool:
        """Whether it is feasible, and too close by its clearance at most: what margins or a finer mesh make safe.

        What was not verified is taken to be: a plan on a finer mesh starts from there.
        """
        safety = self.result.safety
        worst = None if safety is None else safety.worst
        is_near = safety is None or (worst is not None and worst.shortfall <= worst.clearance)
        return is_near and self.quality is not Quality.INFEASIBLE

    def record(self) -> PlanningRound:
        """The same without its result and the way back: what a result keeps, and a pickle can hold."""
        return replace(self, result=None, restore=_cannot_restore)

    def __str__(self) -> str:
        # What was done takes as much room as it needs, at the end.
        safe = "clear" if self.safe is None else "yes" if self.safe else "no"
        return (
            f"{self.quality.name:<10} {self.objective:>13.6g} {self.iterations:>6} {self.shortfall:>10.2e} "
            f"{safe:>5} {self.seconds:>8.2f}  {self.worst:<28} {self.purpose}"
        )


def _start_at_point(block: ObstacleAvoidanceBlockData) -> None:
    """Start values of separations that are new since the round; the point itself counts without them."""
    try:
        block.initialize()
    except ObstacleError as error:
        logger.warning("the separations of '%s' have no start values at the best point: %s", block.name, error)


def way_back(
    model: Any, blocks: list[ObstacleAvoidanceBlockData], regions: list[ContainmentData]
) -> Callable[[], None]:
    """What puts back the point, meshes, margins and norms of now; planes that are new by then start at the point."""
    point = PlanningPoint(model)
    margins = [{index: value(block.margin[index]) for index in block.separations} for block in blocks]
    norms = [block.record.norm_now for block in blocks]
    room = [{time: value(region.margin[time]) for time in region.times} for region in regions]

    def restore() -> None:
        moved = point.restore()
        for block, own_margins, norm in zip(blocks, margins, norms, strict=True):
            for index in block.separations:
                block.margin[index] = own_margins.get(index, 0.0)
            if set(block.separations) == set(own_margins) and not moved:
                if block.record.norm_now != norm:
                    block.set_norm(norm)
            else:
                _start_at_point(block)
        for region, own_room in zip(regions, room, strict=True):
            region.margin.store_values(own_room)

    return restore
