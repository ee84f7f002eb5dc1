"""Bodies and obstacles by name, their convex parts, the body pairs that keep clear of each other."""

from __future__ import annotations

import copy
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, distance_of_points
from pyrobocop_pyomo.motion.bodies import Body

LOGGER = logging.getLogger(__name__)

LARGEST_RATIO_OF_SIZES = 1e3

BodyPair = tuple[str, str]


@dataclass(frozen=True)
class ConvexPart:
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
    """Bodies, obstacles and the watched body pairs; made by `make_scene`.

    Attributes
    ----------
    bodies : dict of name to Body
        Bodies first, then obstacles.
    obstacles : frozenset of str
        Names of the bodies that the plan cannot move.
    parts : dict of name of a part to ConvexPart
    clearances : dict of body pair to float
        Watched body pairs, bodies before obstacles and otherwise in the order given, with about the clearance of each
        as a number; what is required is on the block.
    """

    bodies: Mapping[str, Body]
    obstacles: frozenset[str]
    parts: Mapping[str, ConvexPart]
    clearances: dict[BodyPair, float]

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        bodies = {name: copy.deepcopy(body, memo) for name, body in self.bodies.items()}
        same = all(body is self.bodies[name] for name, body in bodies.items())
        return self if same else replace(self, bodies=bodies)

    def is_static(self, name: str) -> bool:
        """True where a body has no pose rule."""
        return not self.bodies[name].moves

    def parts_of(self, body: str) -> list[ConvexPart]:
        """The convex parts of a body."""
        return [part for part in self.parts.values() if part.body == body]

    @property
    def body_pairs(self) -> list[BodyPair]:
        """Watched body pairs."""
        return list(self.clearances)

    def body_pair(self, label: str, first: str, second: str) -> BodyPair:
        """The watched body pair of two bodies given in either order.

        Raises
        ------
        ObstacleError
            When they are not watched.
        """
        for pair in ((first, second), (second, first)):
            if pair in self.clearances:
                return pair
        raise ObstacleError(
            f"{label}: '{first}' and '{second}' are no body pair of it. Its body pairs: "
            f"{', '.join(map(str, self.body_pairs))}."
        )

    def unit_directions(self, label: str, directions: Mapping[BodyPair, Any]) -> dict[BodyPair, np.ndarray]:
        """Unit vectors from ``{body pair: direction}``, each from the second body of its pair to the first.

        Raises
        ------
        ObstacleError
            When a body pair is not watched, or a direction is no vector.
        """
        dimension = next(iter(self.parts.values())).shape.dimension
        units = {}
        for given, direction in directions.items():
            pair = self.body_pair(label, *_checked_pair(label, "directions", given, self.bodies))
            vector = np.asarray(direction, dtype=float)
            if vector.shape != (dimension,) or not np.isfinite(vector).all() or not vector.any():
                raise ObstacleError(
                    f"{label}: directions= gives {given} the direction {direction!r}; expected {dimension} numbers, "
                    f"not all zero, that point from '{given[1]}' to where '{given[0]}' is to pass."
                )
            units[pair] = (vector if pair == given else -vector) / np.linalg.norm(vector)
        return units

    def part_pairs(self) -> list[tuple[ConvexPart, ConvexPart]]:
        """All pairs of convex parts to be separated."""
        return [
            (a, b) for first, second in self.body_pairs for a in self.parts_of(first) for b in self.parts_of(second)
        ]


# -------------------------------------------------------------------------------- scenes from arguments of the block


def make_scene(what: str, *, bodies: Any, obstacles: Any, body_pairs: Any, exclude: Iterable[BodyPair]) -> Scene:
    """Make a scene from arguments of `ObstacleAvoidanceBlock`, and check them.

    Parameters
    ----------
    what : str
        Name of the block in messages.
    bodies : mapping of name to Body or Polytope
    obstacles : mapping of name to Polytope, list of Polytope or Body; or a sequence of such
    body_pairs : None, networkx.Graph or iterable of body pairs
    exclude : iterable of body pairs

    Raises
    ------
    ObstacleError
        Naming the body or the body pair.
    """
    moving = {name: _body(what, name, given) for name, given in _named(what, "bodies", "body", bodies).items()}
    fixed = {name: _body(what, name, given) for name, given in _named(what, "obstacles", "obstacle", obstacles).items()}
    if not moving:
        raise ObstacleError(f"{what}: there is no body. Give bodies={{name: Body(shape, pose)}}, or body= and pose=.")
    twice = sorted(set(moving) & set(fixed))
    if twice:
        raise ObstacleError(f"{what}: {_listed(twice)} is the name of a body and of an obstacle. Rename one of them.")
    everybody = {**moving, **fixed}
    parts: dict[str, ConvexPart] = {}
    for name, body in everybody.items():
        for part in (ConvexPart(label, name, shape) for label, shape in body.named_parts(name)):
            if part.name in parts or (part.name != name and part.name in everybody):
                raise ObstacleError(
                    f"{what}: '{part.name}' is the name of a body and of a part of '{name}'. Rename one."
                )
            parts[part.name] = part
    _check_dimensions(what, parts)
    pairs = _watched_pairs(what, everybody, frozenset(fixed), body_pairs, exclude)
    scene = Scene(everybody, frozenset(fixed), parts, dict.fromkeys(pairs, 0.0))
    _log_oddities(what, scene)
    return scene


def _named(label: str, plural: str, singular: str, given: Any) -> dict[str, Any]:
    if given is None:
        return {}
    if isinstance(given, (Polytope, Body)):
        raise ObstacleError(f"{label}: {plural}= takes a dict of names; write {plural}={{'{singular}': ...}}.")
    if not isinstance(given, Mapping):
        if not isinstance(given, Iterable) or isinstance(given, str):
            raise ObstacleError(f"{label}: {plural}= is {given!r}; expected a dict of names, or a list of shapes.")
        return {f"{singular} {number}": shape for number, shape in enumerate(given, start=1)}
    for name in given:
        if not isinstance(name, str) or not name:
            raise ObstacleError(f"{label}: {plural}= has the name {name!r}; names are non-empty strings.")
    return dict(given)


def _body(label: str, name: str, given: Any) -> Body:
    if isinstance(given, Body):
        return given.of_one_model()
    if isinstance(given, Polytope) or (
        isinstance(given, (list, tuple)) and given and all(isinstance(shape, Polytope) for shape in given)
    ):
        return Body(given)
    remedy = ""
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], Polytope):
        remedy = " Write Body(shape, pose=rule)."
    elif isinstance(given, (np.ndarray, list, tuple)):
        remedy = " Corners make a shape by rcp.Polytope.from_vertices(corners)."
    raise ObstacleError(
        f"{label}: '{name}' is {given!r}; expected a Polytope, a list of Polytopes, or Body(shape, pose=rule).{remedy}"
    )


def _check_dimensions(label: str, parts: Mapping[str, ConvexPart]) -> None:
    first = next(iter(parts.values()))
    for part in parts.values():
        if part.shape.dimension != first.shape.dimension:
            raise ObstacleError(
                f"{label}: '{first.name}' has dimension {first.shape.dimension}, '{part.name}' has dimension "
                f"{part.shape.dimension}. All shapes of a scene must be in the plane, or all in space."
            )


def _checked_pair(label: str, where: str, given: Any, bodies: Mapping[str, Body]) -> BodyPair:
    """A pair of names that the user gave.

    Raises
    ------
    ObstacleError
        When it is not a pair of two different names, or a body does not exist.
    """
    if not (isinstance(given, tuple) and len(given) == 2 and given[0] != given[1]):
        raise ObstacleError(f"{label}: {where}= holds {given!r}; expected a pair of two different names.")
    for name in given:
        if name not in bodies:
            raise ObstacleError(f"{label}: {where}= names {name!r}, which is not among {_listed(bodies)}.")
    return given


def _watched_pairs(
    label: str, bodies: Mapping[str, Body], obstacles: frozenset[str], body_pairs: Any, exclude: Iterable[BodyPair]
) -> list[BodyPair]:
    if not any(body.moves for body in bodies.values()):
        raise ObstacleError(
            f"{label}: nothing moves: none of {_listed(bodies)} has a pose rule. Give Body(shape, pose=rule), with "
            "rule(block, t) -> Pose."
        )
    excluded = {frozenset(_checked_pair(label, "exclude", pair, bodies)) for pair in exclude}
    if body_pairs is None:
        candidates = [pair for pair in combinations(bodies, 2) if not obstacles.issuperset(pair)]
        candidates = [pair for pair in candidates if any(bodies[name].moves for name in pair)]
    else:
        given = getattr(body_pairs, "edges", body_pairs)  # of a graph of networkx, which takes long to import
        candidates = [_checked_pair(label, "body_pairs", pair, bodies) for pair in given]
        for first, second in candidates:
            if obstacles.issuperset((first, second)):
                raise ObstacleError(
                    f"{label}: body_pairs= names '{first}' and '{second}', two obstacles, which no plan can move. "
                    "Name at least one body in each pair."
                )
            if not (bodies[first].moves or bodies[second].moves):
                raise ObstacleError(
                    f"{label}: body_pairs= names '{first}' and '{second}', which both stand still, without pose rule."
                )
    order = {name: position for position, name in enumerate(bodies)}
    watched = [(order[a], order[b]) for a, b in candidates if frozenset((a, b)) not in excluded]
    if not watched:
        raise ObstacleError(
            f"{label}: no body pair is left to keep apart among {_listed(bodies)}. Give obstacles, a second body, or "
            "fewer exclusions."
        )
    names = list(bodies)
    return [(names[i], names[j]) for i, j in sorted({(min(places), max(places)) for places in watched})]


def _log_oddities(label: str, scene: Scene) -> None:
    """Log what is no error but seldom intended."""
    static = [part for part in scene.parts.values() if scene.is_static(part.body)]
    for first, second in _whose_boxes_meet(static):
        if first.body != second.body and _overlap(first.shape, second.shape):
            LOGGER.info(
                "%s: '%s' and '%s' stand still and overlap; no row holds them apart.", label, first.name, second.name
            )
    for first, second in scene.part_pairs():
        extents = [_extent(first.shape), _extent(second.shape)]
        if min(extents) > 0 and max(extents) > LARGEST_RATIO_OF_SIZES * min(extents):
            larger, smaller = (first, second) if extents[0] > extents[1] else (second, first)
            LOGGER.warning(
                "%s: '%s' is %.3g times as large as '%s', which costs digits. Cut it to what can be reached.",
                label,
                larger.name,
                max(extents) / min(extents),
                smaller.name,
            )


def _whose_boxes_meet(parts: list[ConvexPart]) -> list[tuple[ConvexPart, ConvexPart]]:
    """Pairs of parts whose axis-aligned boxes meet: all others are apart."""
    if not parts:
        return []
    low = np.array([part.shape.vertices.min(axis=0) - part.shape.radius for part in parts])
    high = np.array([part.shape.vertices.max(axis=0) + part.shape.radius for part in parts])
    unbounded = [not part.shape.is_bounded for part in parts]
    low[unbounded], high[unbounded] = -np.inf, np.inf
    meet = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    return [(parts[i], parts[j]) for i, j in np.argwhere(np.triu(meet, 1)).tolist()]


def _overlap(first: Polytope, second: Polytope) -> bool:
    # Two unbounded walls that meet have the distance minus infinity, which `signed_distance` refuses.
    core = distance_of_points(first.vertices, second.vertices, first.rays, second.rays)
    return core.distance < first.radius + second.radius


def _extent(shape: Polytope) -> float:
    return float((shape.vertices.max(axis=0) - shape.vertices.min(axis=0)).max()) + 2 * shape.radius


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
