"""What every part of an avoidance block goes by: its record, its motion, its name."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.motion.motion import Motion, motion_of

from .avoidance_record import AvoidanceRecord
from .building import BuiltWhole


class AvoidanceCore(BuiltWhole):
    """Access to the facts behind an avoidance block."""

    def __init__(self, component: Any) -> None:
        super().__init__(component)
        self._record: AvoidanceRecord | None = None

    @property
    def record(self) -> AvoidanceRecord:
        """Scene, pieces of motion and poses behind this block."""
        if self._record is None:
            raise ObstacleError(
                f"{self._what} is not built yet: add it to a ConcreteModel; a rule= has to call block.build(...)."
            )
        return self._record

    @property
    def motion(self) -> Motion:
        """What happens at the points and between them."""
        return motion_of(self.record.points, self.parent_block())

    @property
    def axes(self) -> range:
        """0, 1 in the plane and 0, 1, 2 in space."""
        return range(self.record.dimension)

    @property
    def _what(self) -> str:
        return f"obstacle avoidance '{self.name}'"

    @property
    def is_built(self) -> bool:
        """True once certificates are there."""
        return self._record is not None

    def _forget(self) -> None:
        self._record = None
