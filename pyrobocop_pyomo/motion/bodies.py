"""`Body`: one shape or several that move together, and their pose over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.pictured_outlines import pictured_outlines
from pyrobocop_pyomo.modeling.copied_rules import copied_rule
from pyrobocop_pyomo.modeling.pickling import picklable_or_none
from pyrobocop_pyomo.presentation import Presented, outline_picture
from pyrobocop_pyomo.rules.rule_template import templated

PoseRule = Callable[[Any, Any], Any]
PoseBetweenPoints = Callable[[Any, Any, Any], Any]


def _lost_pose(block: Any, t: Any, fraction: Any = None) -> Any:
    """Replaces a rule that a pickle cannot hold; with no rule at all the body would rest."""
    raise ObstacleError("the rule for a body's pose did not survive pickling. Define it at the top level of a module.")


@dataclass(frozen=True, eq=False)
class Body(Presented):
    """One rigid body: its shape and its pose.

    Attributes
    ----------
    shape : Polytope, or sequence of Polytope
        In the body's own frame. The body is the union of several shapes.
    pose : callable or None
        ``pose(block, t)`` returns the `Pose` at an index ``t`` of the set of points. ``block`` is the parent of the
        avoidance block or, between the nodes, a proxy of it: the rule must read all variables through it. None for a
        body that rests: its shape is given in the world.
    between_points : callable or None
        For points that are plain numbers, and for finite differences of ``pyomo.dae``: ``between_points(block, t,
        fraction)`` returns the `Pose` at a fraction (0 to 1) of the interval from the point ``t`` to the next one, in
        expressions of the model's variables and of ``fraction``. None: everything that the pose reads changes linearly
        from point to point.

    Raises
    ------
    ObstacleError
        When the shape is not a polytope, its parts have different dimensions, or a rule is no function.
    """

    shape: Any
    pose: PoseRule | None = None
    between_points: PoseBetweenPoints | None = None

    def __post_init__(self) -> None:
        parts = self.parts
        if not parts or not all(isinstance(part, Polytope) for part in parts):
            raise ObstacleError(
                f"a body of shape {self.shape!r}: expected a Polytope or a list of them. "
                "Make one by Polytope.box, from_vertices or from_halfspaces; decompose makes convex parts of others."
            )
        dimensions = sorted({part.dimension for part in parts})
        if len(dimensions) > 1:
            names = ", ".join(f"'{part.name}' ({part.dimension})" for part in parts)
            raise ObstacleError(f"a body with parts of dimensions {dimensions}: {names}. All must be the same.")
        if self.pose is not None and not callable(self.pose):
            raise ObstacleError(
                f"'{parts[0].name}': its pose is {self.pose!r}; expected a function of (block, t), or None for a body "
                "that rests. A body at a constant pose is shape.placed(pose)."
            )
        if self.between_points is not None and not (callable(self.between_points) and self.moves):
            raise ObstacleError(
                f"'{parts[0].name}': between_points is {self.between_points!r}; expected a function of (block, t, "
                "fraction), beside pose=, which gives the pose at the points themselves."
            )
        object.__setattr__(self, "pose", templated(self.pose))

    def __deepcopy__(self, memo: dict[int, Any]) -> Body:
        rules = [copied_rule(rule, memo) for rule in (self.pose, self.between_points)]
        same = rules[0] is self.pose and rules[1] is self.between_points
        return self if same else Body(self.shape, *rules)  # immutable: cloned models share it

    def __getstate__(self) -> dict[str, Any]:
        rules = {"pose": self.pose, "between_points": self.between_points}
        kept = {name: None if rule is None else picklable_or_none(rule) or _lost_pose for name, rule in rules.items()}
        return {"shape": self.shape, **kept}

    @property
    def parts(self) -> tuple[Polytope, ...]:
        """The convex shapes of the body."""
        return (self.shape,) if isinstance(self.shape, Polytope) else tuple(self.shape)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.parts[0].dimension

    @property
    def moves(self) -> bool:
        """Whether the body has a pose rule."""
        return self.pose is not None

    def named_parts(self, name: str) -> Iterator[tuple[str, Polytope]]:
        """Parts and their names: ``name`` of a single part, ``name[1]``, ``name[2]``, ... of several."""
        parts = self.parts
        for i, part in enumerate(parts, start=1):
            label = name if len(parts) == 1 else f"{name}[{i}]"
            yield label, part.named(label)

    def _summary(self) -> str:
        return f"{', '.join(str(part) for part in self.parts)}; {'moves' if self.moves else 'rests'}"

    def _html_parts(self) -> list[str]:
        pictures = [pictured_outlines(part) for part in self.parts]
        outlines = [outline for found, _ in pictures for outline in found]
        return [outline_picture(outlines, [radius for _, radii in pictures for radius in radii])]
