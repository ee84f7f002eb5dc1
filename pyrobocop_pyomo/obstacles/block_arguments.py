"""What both blocks of this folder are: built on a set of points, whose motion they read; indexed ones by a rule."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any

from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, BuiltBlockData, Rule
from pyrobocop_pyomo.motion import Motion, SafetyReport, motion_of, verify_clearance


class MotionBlockData(BuiltBlockData):
    """One block about the motion over a set of points."""

    equations = True

    _error = ObstacleError

    def build(self, points: Any, **options: Any) -> None:
        """Build the block; for rules of indexed blocks, with the arguments of the class.

        Raises
        ------
        ObstacleError
            When the arguments contradict themselves; nothing is then left on the block.
        """
        self._build_once(points, **options)

    def _build(self, points: Any, *, equations: bool = True, **options: Any) -> None:
        self.equations = equations
        self._state(self._set_of_points(points), **options)

    def _state(self, *points: Any, **options: Any) -> None:
        """State everything over the set of points."""
        raise NotImplementedError

    @property
    def record(self) -> Any:
        """The facts behind this block: its points, bodies and poses."""
        return self._record_if_built()

    @property
    def motion(self) -> Motion:
        """The motion over the set of points."""
        return motion_of(self.record.points, self.parent_block())

    @property
    def can_follow_times(self) -> bool:
        """Whether rows can be made for other times: no pose or clearance was asked for at each point."""
        return all(rule.is_template(self.motion.block) for rule in self.record.rules)

    def stands_on(self, sets: Container[int]) -> bool:
        """True where the motion is over one of the sets, which are given by their identities."""
        return id(self.record.points) in sets

    def _proven(self, tolerance: float | None, equations: bool) -> SafetyReport:
        """The proof for the bodies and clearances of the record along the motion of the current values."""
        bodies, clearances, followed = self.record.scene.bodies, self.record.clearances, equations and self.equations
        return verify_clearance(self.motion, bodies, clearances, tolerance=tolerance, equations=followed)

    def _set_of_points(self, points: Any) -> Any:
        """The set of points; where the user gave plain numbers, a new set on the block.

        Raises
        ------
        ObstacleError
            When it is neither a set nor numbers.
        """
        if hasattr(points, "time_at") and hasattr(points, "time"):
            raise ObstacleError(
                f"{self._what}: its points are the phase '{points.name}'; give its times, '{points.name}.time'."
            )
        if hasattr(points, "ctype"):
            return points
        if not isinstance(points, Iterable):
            raise ObstacleError(
                f"{self._what}: its points are {points!r}; expected a set of times, such as phase.time."
            )
        points = list(points)
        if any(hasattr(point, "ctype") for point in points):
            raise ObstacleError(
                f"{self._what}: its points are a list of sets, {', '.join(point.name for point in points)}. A block "
                "covers one set of times: add one block for each phase."
            )
        self.points = Set(initialize=list(points), ordered=True, doc="times that were given")
        return self.points


class MotionBlock(BuiltBlock):
    """A block, or blocks by index sets and a rule.

    Parameters
    ----------
    label : str
        What messages call it.
    *points : object
        One set of points, or with a rule index sets.
    options : dict
        Arguments of ``build``.
    rule : callable or None
    **block_options
        Of every block.

    Raises
    ------
    ObstacleError
        When both a rule and arguments are given, or not one set of points.
    """

    def __init__(
        self, label: str, *points: Any, options: dict[str, Any], rule: Rule | None, **block_options: Any
    ) -> None:
        if rule is None and len(points) != 1:
            raise ObstacleError(
                f"{label} takes one set of points, such as phase.time, and was given {len(points)}. "
                "An indexed one takes index sets and rule=."
            )
        shapes = ("bodies", "body", "pose", "obstacles", "region")
        given = [name for name in shapes if rule is not None and options.get(name) is not None]
        if given:
            raise ObstacleError(
                f"{label} with rule= takes index sets only, and was given {', '.join(given)}. The rule gives the rest: "
                "block.build(points, ...)."
            )
        if rule is None:
            super().__init__(arguments=points, options=options, **block_options)
        else:
            super().__init__(*points, rule=rule, **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        return keywords.get("rule") is None or not args
