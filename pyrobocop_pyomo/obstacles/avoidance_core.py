"""What every part of an avoidance block goes by: its record, its motion, its name."""

from __future__ import annotations

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.motion.motion import Motion, motion_of

from .avoidance_record import AvoidanceRecord


class AvoidanceCore(BuiltBlockData):
    """Access to the facts behind an avoidance block."""

    _kind = "obstacle avoidance"
    _error = ObstacleError

    @property
    def record(self) -> AvoidanceRecord:
        """Scene, pieces of motion and poses behind this block."""
        return self._record_if_built()

    @property
    def motion(self) -> Motion:
        """What happens at the points and between them."""
        return motion_of(self.record.points, self.parent_block())

    @property
    def axes(self) -> range:
        """0, 1 in the plane and 0, 1, 2 in space."""
        return range(self.record.dimension)
