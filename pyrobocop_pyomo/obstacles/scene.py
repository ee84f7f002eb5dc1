"""Bodies and obstacles by name, their convex parts, the body pairs that keep clear of each other, and by how much."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Hashable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.expr.numvalue import NumericValue, is_fixed, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.modeling.expressions import ExpressionBounds
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.rules_along_motion import clearance_text, is_clearance_rule
from pyrobocop_pyomo.templates.template import templated

BodyPair = tuple[str, str]
# Two convex parts, and where their segment of motion starts.
SeparationIndex = tuple[str, str, Hashable]


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

    def walls_of(self, body: str) -> list[tuple[BodyPair, ConvexPart]]:
        """All parts that rest and that a body keeps clear of, each with its body pair."""
        others = ((pair, pair[pair[0] == body]) for pair in self.clearances if body in pair)
        return [(pair, part) for pair, other in others if self.is_static(other) for part in self.parts_of(other)]

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
            first, second = checked_pair(label, "directions", given, self.bodies)
            pair = next((pair for pair in (given, (second, first)) if pair in self.clearances), None)
            if pair is None:
                raise ObstacleError(
                    f"{label}: '{first}' and '{second}' are no body pair of it. Its body pairs: "
                    f"{', '.join(map(str, self.clearances))}."
                )
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
            (a, b) for first, second in self.clearances for a in self.parts_of(first) for b in self.parts_of(second)
        ]


# -------------------------------------------------------------------------------- scenes from arguments of the block


def make_scene(where: str, *, bodies: Any, obstacles: Any, body_pairs: Any, exclude: Iterable[BodyPair]) -> Scene:
    """Make a scene from arguments of `ObstacleAvoidanceBlock`, and check them.

    Parameters
    ----------
    where : str
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
    moving = named_bodies(where, "bodies", "body", bodies)
    fixed = named_bodies(where, "obstacles", "obstacle", obstacles)
    if not moving:
        raise ObstacleError(f"{where}: there is no body. Give bodies={{name: Body(shape, pose)}}, or body= and pose=.")
    twice = sorted(set(moving) & set(fixed))
    if twice:
        raise ObstacleError(f"{where}: {_listed(twice)} is the name of a body and of an obstacle. Rename one of them.")
    everybody = {**moving, **fixed}
    parts: dict[str, ConvexPart] = {}
    for name, body in everybody.items():
        for part in (ConvexPart(label, name, shape) for label, shape in body.named_parts(name)):
            if part.name in parts or (part.name != name and part.name in everybody):
                raise ObstacleError(
                    f"{where}: '{part.name}' is the name of a body and of a part of '{name}'. Rename one."
                )
            parts[part.name] = part
    first = next(iter(parts.values()))
    for part in parts.values():
        if part.shape.dimension != first.shape.dimension:
            raise ObstacleError(
                f"{where}: '{first.name}' has dimension {first.shape.dimension}, '{part.name}' has dimension "
                f"{part.shape.dimension}. All shapes of a scene must be in the plane, or all in space."
            )
    pairs = _watched_pairs(where, everybody, frozenset(fixed), body_pairs, exclude)
    return Scene(everybody, frozenset(fixed), parts, dict.fromkeys(pairs, 0.0))


def named_bodies(label: str, plural: str, singular: str, given: Any) -> dict[str, Body]:
    """Bodies by name; bodies of a list are numbered.

    Raises
    ------
    ObstacleError
        Naming the body that is none.
    """
    if given is None:
        return {}
    if isinstance(given, (Polytope, Body)):
        raise ObstacleError(f"{label}: {plural}= takes a dict of names; write {plural}={{'{singular}': ...}}.")
    if not isinstance(given, Mapping):
        if not isinstance(given, Iterable) or isinstance(given, str):
            raise ObstacleError(f"{label}: {plural}= is {given!r}; expected a dict of names, or a list of shapes.")
        given = {f"{singular} {number}": shape for number, shape in enumerate(given, start=1)}
    for name in given:
        if not isinstance(name, str) or not name:
            raise ObstacleError(f"{label}: {plural}= has the name {name!r}; names are non-empty strings.")
    return {name: _body(label, name, each) for name, each in given.items()}


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


def checked_pair(label: str, where: str, given: Any, bodies: Collection[str]) -> BodyPair:
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
    excluded = {frozenset(checked_pair(label, "exclude", pair, bodies)) for pair in exclude}
    if body_pairs is None:
        candidates = [pair for pair in combinations(bodies, 2) if not obstacles.issuperset(pair)]
        candidates = [pair for pair in candidates if any(bodies[name].moves for name in pair)]
    else:
        given = getattr(body_pairs, "edges", body_pairs)  # of a graph of networkx, which takes long to import
        candidates = [checked_pair(label, "body_pairs", pair, bodies) for pair in given]
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
    place = {name: position for position, name in enumerate(bodies)}.__getitem__
    ordered = [(a, b) if place(a) < place(b) else (b, a) for a, b in candidates]
    watched = {pair for pair in ordered if frozenset(pair) not in excluded}
    if not watched:
        raise ObstacleError(
            f"{label}: no body pair is left to keep apart among {_listed(bodies)}. Give obstacles, a second body, or "
            "fewer exclusions."
        )
    return sorted(watched, key=lambda pair: (place(pair[0]), place(pair[1])))


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)


# -------------------------------------------------------------------------------------------------------- clearances


def is_length(number: Any) -> bool:
    """Whether something is a finite number above zero."""
    return isinstance(number, Real) and not isinstance(number, bool) and 0.0 < float(number) < math.inf


def required_clearances(
    label: str, body_pairs: Iterable[BodyPair], bodies: Collection[str], clearance: Any
) -> dict[BodyPair, Any]:
    """The clearance of each watched body pair: a float, an expression or a `Template`.

    Raises
    ------
    ObstacleError
        Naming the body pair, where it is no length, or is missing.
    """
    pairs = list(body_pairs)
    if isinstance(clearance, IndexedComponent) and clearance.is_indexed():
        clearance = {key: clearance[key] for key in clearance}
    if isinstance(clearance, Mapping):
        required = {frozenset(checked_pair(label, "clearance", key, bodies)): given for key, given in clearance.items()}
        missing = [pair for pair in pairs if frozenset(pair) not in required]
        if missing:
            raise ObstacleError(
                f"{label}: clearance= says nothing about {', '.join(map(str, missing))}. Add them, or leave these body "
                "pairs out by exclude=."
            )
        watched = {frozenset(pair) for pair in pairs}
        unwatched = [tuple(sorted(pair)) for pair in required if pair not in watched]
        if unwatched:
            raise ObstacleError(
                f"{label}: clearance= is given for {', '.join(map(str, unwatched))}, which is not watched. "
                "Add the pair to body_pairs=, or leave it out of clearance=."
            )
    else:
        required = {frozenset(pair): clearance for pair in pairs}
    return {pair: _checked_clearance(label, pair, required[frozenset(pair)]) for pair in pairs}


def _checked_clearance(label: str, pair: BodyPair, given: Any) -> Any:
    if is_clearance_rule(given):
        return templated(given)
    if isinstance(given, NumericValue):
        known = value(given, exception=False) if is_fixed(given) else None
        if known is not None and not is_length(float(known)):
            raise ObstacleError(
                f"{label}: {clearance_text(pair)} is '{given}' = {float(known):g}; it must be a length > 0. "
                "Give the parameter another value."
            )
        # An immutable Param is a number.
        return given if not given.is_constant() else float(value(given))
    if not is_length(given):
        raise ObstacleError(
            f"{label}: {clearance_text(pair)} is {given!r}; it must be a length > 0: a number, a Param, a Var or an "
            "expression of the model, or a rule(block, t). Without clearance nothing tells touching "
            "from overlapping; choose well above the solver's tolerance."
        )
    return float(given)


def lower_bound_of_clearance(expression: Any) -> float:
    """The least value of a clearance, whatever its variables become; 0 where it is not known."""
    if isinstance(expression, Real) or not expression.is_potentially_variable():
        return float(value(expression))
    lower, _ = ExpressionBounds(use_fixed_var_values_as_bounds=True).walk_expression(expression)
    return max(float(lower), 0.0) if lower is not None and math.isfinite(lower) else 0.0
