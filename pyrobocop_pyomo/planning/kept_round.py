"""A round of planning around obstacles that can be gone back to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.solving.point import Point
from pyrobocop_pyomo.solving.quality import Quality
from pyrobocop_pyomo.solving.solve_result import SolveResult


@dataclass(frozen=True, eq=False)
class KeptRound:
    """What came out of a round, the point, and the margins and norms that it was solved with.

    Attributes
    ----------
    result : SolveResult
    report : SafetyReport
    point : Point
    margins : list of dict of index to float
        For each avoidance block, of the planes that it had.
    norms : list of str
        For each avoidance block.
    room : list of dict of time to float
        For each containment, its margins.
    """

    result: SolveResult
    report: SafetyReport
    point: Point
    margins: list[dict[Any, float]]
    norms: list[str]
    room: list[dict[Any, float]]

    @classmethod
    def now(
        cls,
        model: Any,
        blocks: list[ObstacleAvoidanceBlockData],
        regions: list[ContainmentData],
        result: SolveResult,
        report: SafetyReport,
    ) -> KeptRound:
        """The round that has just been judged."""
        margins = [{index: value(block.margin[index]) for index in block.separations} for block in blocks]
        room = [{time: value(region.margin[time]) for time in region.times} for region in regions]
        return cls(result, report, Point(model), margins, [block.record.norm_now for block in blocks], room)

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Larger is better: feasible, then safe, then as near to it as can be."""
        worst = self.report.worst
        missing = 0.0 if self.report.safe or worst is None else worst.clearance - worst.distance
        return (self.result.quality is not Quality.INFEASIBLE, self.report.safe, -missing)

    @property
    def is_safe(self) -> bool:
        """Whether it is a plan to go by."""
        return self.report.safe and self.result.quality is not Quality.INFEASIBLE

    def restore(self, blocks: list[ObstacleAvoidanceBlockData], regions: list[ContainmentData]) -> None:
        """Put the point back, with the margins and norms of its round; planes that are new since start at the point."""
        self.point.restore()
        for block, margins, norm in zip(blocks, self.margins, self.norms, strict=True):
            for index in block.separations:
                block.margin[index] = margins.get(index, 0.0)
            if set(block.separations) == set(margins):
                if block.record.norm_now != norm:
                    block.set_norm(norm)
            else:
                block.initialize()
        for region, room in zip(regions, self.room, strict=True):
            region.margin.store_values(room)
