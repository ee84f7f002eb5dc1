"""Who keeps clear of whom: bodies and obstacles by name, their parts, the pairs that are watched, the clearances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.motion.bodies import Body

Pair = tuple[str, str]


@dataclass(frozen=True)
class Part:
    """One convex part of a body; a body of a single polytope is its own part.

    Attributes
    ----------
    name : str
        ``"car"``, or ``"car[1]"`` where the body is a union.
    body : str
    shape : Polytope
    """

    name: str
    body: str
    shape: Polytope


@dataclass(frozen=True)
class Scene:
    """Bodies, obstacles and the pairs among them.

    Attributes
    ----------
    bodies : dict of name to Body
        Bodies first, then obstacles.
    obstacles : frozenset of str
        Names of those that the plan cannot move.
    parts : dict of name of a part to Part
    graph : networkx.Graph
        Names of bodies, an edge for each pair that is watched, with its ``clearance``.
    """

    bodies: Mapping[str, Body]
    obstacles: frozenset[str]
    parts: Mapping[str, Part]
    graph: Any

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        return self

    def is_static(self, name: str) -> bool:
        """True where a body has no pose rule."""
        return not self.bodies[name].moves

    def parts_of(self, body: str) -> list[Part]:
        """The convex parts of a body."""
        return [part for part in self.parts.values() if part.body == body]

    @property
    def pairs(self) -> list[Pair]:
        """Watched pairs; bodies before obstacles, otherwise in the order given."""
        order = {name: position for position, name in enumerate(self.bodies)}
        return sorted((_ordered(edge, order) for edge in self.graph.edges), key=lambda p: (order[p[0]], order[p[1]]))

    @property
    def clearances(self) -> dict[Pair, float]:
        """Clearance asked of each pair."""
        return {pair: self.graph.edges[pair]["clearance"] for pair in self.pairs}

    def pair(self, what: str, first: str, second: str) -> Pair:
        """The watched pair of two bodies given in either order.

        Raises
        ------
        ObstacleError
            When they are not watched.
        """
        if not self.graph.has_edge(first, second):
            raise ObstacleError(
                f"{what}: '{first}' and '{second}' are no pair of it. Its pairs: {', '.join(map(str, self.pairs))}."
            )
        return (first, second) if (first, second) in self.pairs else (second, first)

    def directions(self, what: str, sides: Mapping[Pair, Any]) -> dict[Pair, np.ndarray]:
        """Unit vectors from ``{pair: direction}``, each from the second body of its pair to the first.

        Raises
        ------
        ObstacleError
            When a pair is not watched, or a direction is none.
        """
        dimension = next(iter(self.parts.values())).shape.dimension
        found = {}
        for given, direction in sides.items():
            pair = self.pair(what, *checked_pair(what, "sides", given, self.bodies))
            vector = np.asarray(direction, dtype=float)
            if vector.shape != (dimension,) or not np.isfinite(vector).all() or not vector.any():
                raise ObstacleError(
                    f"{what}: sides= gives {given} the direction {direction!r}; expected {dimension} numbers, not all "
                    f"zero, that point from '{given[1]}' to where '{given[0]}' is to pass."
                )
            found[pair] = (vector if pair == given else -vector) / np.linalg.norm(vector)
        return found

    def pairs_of_parts(self) -> list[tuple[Part, Part]]:
        """All pairs of convex parts to be separated."""
        return [(a, b) for first, second in self.pairs for a in self.parts_of(first) for b in self.parts_of(second)]


def checked_pair(what: str, where: str, given: Any, bodies: Mapping[str, Body]) -> Pair:
    """A pair of names that the user gave.

    Raises
    ------
    ObstacleError
        When it is none, or names what is not there.
    """
    if not (isinstance(given, tuple) and len(given) == 2 and given[0] != given[1]):
        raise ObstacleError(f"{what}: {where}= holds {given!r}; expected a pair of two different names.")
    for name in given:
        if name not in bodies:
            raise ObstacleError(f"{what}: {where}= names {name!r}, which is not among {listed(bodies)}.")
    return given


def _ordered(edge: Pair, order: Mapping[str, int]) -> Pair:
    return edge if order[edge[0]] < order[edge[1]] else (edge[1], edge[0])


def listed(names: Iterable[str]) -> str:
    """Names for a message."""
    return ", ".join(f"'{name}'" for name in names)
