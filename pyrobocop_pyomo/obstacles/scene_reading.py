"""From what the user says about bodies, obstacles, pairs and clearances to a `Scene`, checked."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping
from itertools import combinations
from numbers import Real
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, distance_of_points
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.optional_imports import networkx

from .scene import Pair, Part, Scene, checked_pair, listed

LOGGER = logging.getLogger(__name__)

LARGEST_RATIO_OF_SIZES = 1e3


def make_scene(
    what: str,
    *,
    bodies: Any,
    obstacles: Any,
    clearance: Any,
    pairs: Any,
    exclude: Iterable[Pair],
) -> Scene:
    """Check what the user said about the scene.

    Parameters
    ----------
    what : str
        How messages call the block.
    bodies : mapping of name to Body or Polytope
    obstacles : mapping of name to Polytope, list of Polytope or Body; or a sequence of such
    clearance : float or mapping of pair to float
    pairs : None, networkx.Graph or iterable of pairs
    exclude : iterable of pairs

    Raises
    ------
    ObstacleError
        Naming the body or the pair.
    """
    moving = {name: _body(what, name, given) for name, given in _named(what, "bodies", "body", bodies).items()}
    fixed = {name: _body(what, name, given) for name, given in _named(what, "obstacles", "obstacle", obstacles).items()}
    if not moving:
        raise ObstacleError(f"{what}: there is no body. Give bodies={{name: Body(shape, pose)}}, or body= and pose=.")
    twice = sorted(set(moving) & set(fixed))
    if twice:
        raise ObstacleError(f"{what}: {listed(twice)} is the name of a body and of an obstacle. Rename one of them.")
    everybody = {**moving, **fixed}
    parts: dict[str, Part] = {}
    for name, body in everybody.items():
        for part in (Part(label, name, shape) for label, shape in body.named_parts(name)):
            if part.name in parts or (part.name != name and part.name in everybody):
                raise ObstacleError(
                    f"{what}: '{part.name}' is the name of a body and of a part of '{name}'. Rename one."
                )
            parts[part.name] = part
    _check_dimensions(what, parts)
    graph = _graph(what, everybody, frozenset(fixed), pairs, exclude)
    _set_clearances(what, graph, everybody, clearance)
    scene = Scene(everybody, frozenset(fixed), parts, graph)
    _mention(what, scene)
    return scene


def _named(what: str, plural: str, singular: str, given: Any) -> dict[str, Any]:
    if given is None:
        return {}
    if isinstance(given, (Polytope, Body)):
        raise ObstacleError(f"{what}: {plural}= takes a dict of names; write {plural}={{'{singular}': ...}}.")
    if not isinstance(given, Mapping):
        return {f"{singular} {number}": each for number, each in enumerate(given, start=1)}
    for name in given:
        if not isinstance(name, str) or not name:
            raise ObstacleError(f"{what}: {plural}= has the name {name!r}; names are non-empty strings.")
    return dict(given)


def _body(what: str, name: str, given: Any) -> Body:
    if isinstance(given, Body):
        return given
    if isinstance(given, Polytope) or (
        isinstance(given, (list, tuple)) and given and all(isinstance(each, Polytope) for each in given)
    ):
        return Body(given)
    raise ObstacleError(
        f"{what}: '{name}' is {given!r}; expected a Polytope, a list of Polytopes, or Body(shape, pose=rule)."
    )


def _check_dimensions(what: str, parts: Mapping[str, Part]) -> None:
    first = next(iter(parts.values()))
    for part in parts.values():
        if part.shape.dimension != first.shape.dimension:
            raise ObstacleError(
                f"{what}: '{first.name}' has dimension {first.shape.dimension}, '{part.name}' has dimension "
                f"{part.shape.dimension}. All shapes of a scene live in the plane, or all in space."
            )


def _graph(
    what: str, bodies: Mapping[str, Body], obstacles: frozenset[str], pairs: Any, exclude: Iterable[Pair]
) -> Any:
    graph = networkx.Graph()
    graph.add_nodes_from(bodies)
    if not any(body.moves for body in bodies.values()):
        raise ObstacleError(
            f"{what}: nothing moves: none of {listed(bodies)} has a pose rule. Give Body(shape, pose=rule), with "
            "rule(block, t) -> Pose."
        )
    excluded = {frozenset(checked_pair(what, "exclude", each, bodies)) for each in exclude}
    if pairs is None:
        candidates = [each for each in combinations(bodies, 2) if not obstacles.issuperset(each)]
        candidates = [each for each in candidates if any(bodies[name].moves for name in each)]
    else:
        given = pairs.edges if isinstance(pairs, networkx.Graph) else pairs
        candidates = [checked_pair(what, "pairs", each, bodies) for each in given]
        for first, second in candidates:
            if obstacles.issuperset((first, second)):
                raise ObstacleError(
                    f"{what}: pairs= names '{first}' and '{second}', two obstacles, which no plan can move. "
                    "Name at least one body in each pair."
                )
            if not (bodies[first].moves or bodies[second].moves):
                raise ObstacleError(
                    f"{what}: pairs= names '{first}' and '{second}', which both stand still: neither has a pose rule."
                )
    graph.add_edges_from(each for each in candidates if frozenset(each) not in excluded)
    if not graph.edges:
        raise ObstacleError(
            f"{what}: no pair is left to keep apart among {listed(bodies)}. Give obstacles, a second body, or fewer "
            "exclusions."
        )
    return graph


def _set_clearances(what: str, graph: Any, bodies: Mapping[str, Body], clearance: Any) -> None:
    if isinstance(clearance, Mapping):
        asked = {frozenset(checked_pair(what, "clearance", pair, bodies)): number for pair, number in clearance.items()}
        missing = [edge for edge in graph.edges if frozenset(edge) not in asked]
        if missing:
            raise ObstacleError(
                f"{what}: clearance= says nothing about {', '.join(map(str, missing))}. Add them, or leave these pairs "
                "out by exclude=."
            )
        unwatched = [tuple(sorted(pair)) for pair in asked if not graph.has_edge(*pair)]
        if unwatched:
            raise ObstacleError(
                f"{what}: clearance= is given for {', '.join(map(str, unwatched))}, which is not watched. "
                "Add the pair to pairs=, or leave it out of clearance=."
            )
    else:
        asked = {frozenset(edge): clearance for edge in graph.edges}
    for first, second in graph.edges:
        number = asked[frozenset((first, second))]
        if not isinstance(number, Real) or isinstance(number, bool) or not math.isfinite(number) or number <= 0:
            raise ObstacleError(
                f"{what}: the clearance between '{first}' and '{second}' is {number!r}; it must be a length > 0. "
                "Without clearance nothing tells touching from overlapping; choose well above the solver's tolerance."
            )
        graph.edges[first, second]["clearance"] = float(number)


def _mention(what: str, scene: Scene) -> None:
    """Say what is no error but seldom meant."""
    still = [part for part in scene.parts.values() if scene.is_static(part.body)]
    for first, second in combinations(still, 2):
        if first.body != second.body and _overlap(first.shape, second.shape):
            LOGGER.info("%s: '%s' and '%s' stand still and overlap; nothing is asked.", what, first.name, second.name)
    for first, second in scene.pairs_of_parts():
        extents = [_extent(first.shape), _extent(second.shape)]
        if min(extents) > 0 and max(extents) > LARGEST_RATIO_OF_SIZES * min(extents):
            larger, smaller = (first, second) if extents[0] > extents[1] else (second, first)
            LOGGER.warning(
                "%s: '%s' is %.3g times as large as '%s', which costs digits. Cut it to what can be reached.",
                what,
                larger.name,
                max(extents) / min(extents),
                smaller.name,
            )


def _overlap(first: Polytope, second: Polytope) -> bool:
    # Also without end, as two walls that meet in a corner do: minus infinity then, which `signed_distance` refuses.
    core = distance_of_points(first.vertices, second.vertices, first.rays, second.rays)
    return core.distance < first.radius + second.radius


def _extent(shape: Polytope) -> float:
    return float((shape.vertices.max(axis=0) - shape.vertices.min(axis=0)).max()) + 2 * shape.radius
