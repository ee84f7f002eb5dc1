"""`Body`: one shape or several that move together, and their pose over time."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.templates.template import templated

PoseRule = Callable[[Any, Any], Any]


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

    Raises
    ------
    ObstacleError
        When the shape is not a polytope, its parts have different dimensions, or the rule is no function.
    """

    shape: Any
    pose: PoseRule | None = None

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
        object.__setattr__(self, "pose", templated(self.pose))

    def __deepcopy__(self, memo: dict[int, Any]) -> Body:
        return self if self.pose is None else Body(self.shape, copy.deepcopy(self.pose, memo))

    def of_one_model(self) -> Body:
        """The same body for a block of a model: what its rule says of that is no part of the user's body."""
        template: Any = self.pose
        return self if template is None else Body(self.shape, template.rule)

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
