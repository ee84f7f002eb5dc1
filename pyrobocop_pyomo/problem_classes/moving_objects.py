"""Objects given by their corners, as shapes and poses.

``get_object_vertices`` says where the corners of an object are, as functions of the states. It is evaluated at a few
random states: the distances of the corners tell whether the object is rigid, and its corners there are its shape. A
pose of the plane whose position and angle are affine in the states is written so; any other is put together of the
corners' own formulas.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.geometry import Polytope, Pose, planar_pose
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, array
from pyrobocop_pyomo.motion import Body
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlock

from .methods import Methods
from .problem_arrays import ArrayToFill, LazyEntry, column_array
from .stated_problem import StatedProblem

# PyRoboCOP's rows mean sqrt(d'd + tol) >= sqrt(5 tol) with tol = 1e-4 for the distance vector d.
CLEARANCE = 2.0 * math.sqrt(1e-4)

_SAMPLES = 7
_RIGID = 1e-7  # relative to the size of the object


def add_objects(b: Any, stated: StatedProblem, methods: Methods) -> None:
    """Add ``avoid`` to a phase: every pair of objects of which one is dynamic keeps its distance.

    Raises
    ------
    ProblemClassError
        When the information contradicts itself, or an object is not rigid or moves with more than the states.
    """
    dynamic, counts = _info(methods)
    objects = [Corners(stated, methods, k, count) for k, count in enumerate(counts)]
    names = [f"object{k}" for k in range(len(objects))]
    pairs = [(names[i], names[j]) for i, j in combinations(range(len(objects)), 2) if dynamic[i] or dynamic[j]]
    if not pairs:
        return
    flat = all(corners.is_planar for corners in objects)
    made = dict(zip(names, (corners.body(2 if flat else 3) for corners in objects), strict=True))
    b.avoid = ObstacleAvoidanceBlock(
        b.time,
        bodies={name: body for name, body in made.items() if body.moves},
        obstacles={name: body.shape for name, body in made.items() if not body.moves},
        body_pairs=[pair for pair in pairs if made[pair[0]].moves or made[pair[1]].moves],
        clearance=CLEARANCE,
    )


def _info(methods: Methods) -> tuple[list[bool], list[int]]:
    info = methods.call("get_objects_info")
    what = f"{methods.class_name}.get_objects_info()"
    try:
        count, dynamic, vertices = info
        count = int(np.asarray(count).item())
        flags = [bool(flag) for flag in np.asarray(dynamic).ravel()]
        counts = [int(number) for number in np.asarray(vertices).ravel()]
    except (TypeError, ValueError) as error:
        raise ProblemClassError(
            f"{what} returned {info!r}; expected (number of objects, dynamic flags, numbers of vertices) ({error})."
        ) from None
    if len(flags) != count or len(counts) != count or min(counts, default=1) < 1:
        raise ProblemClassError(f"{what}: {count} objects, but {len(flags)} flags and the vertex counts {counts}.")
    return flags, counts


class Corners:
    """The corners of one object.

    Parameters
    ----------
    stated : StatedProblem
    methods : Methods
    index, count : int
        Which object, and how many corners it has.

    Raises
    ------
    ProblemClassError
        When the corners depend on anything but the states.
    """

    def __init__(self, stated: StatedProblem, methods: Methods, index: int, count: int) -> None:
        self.stated, self.index, self.count = stated, index, count
        self._methods = methods
        self.what = f"{methods.class_name}.get_object_vertices: object {index} (counted from 0)"
        self._samples = [self._numbers(sample) for sample in self._random_states()]
        self.moves = any(np.abs(corners - self._samples[0]).max() > 1e-12 for corners in self._samples)
        self.is_planar = float(np.ptp([corners[2] for corners in self._samples])) == 0.0

    def _random_states(self) -> Array:
        """States to ask at: small ones, so that angles do not wind up."""
        generator = np.random.default_rng(self.index)
        samples: Array = generator.uniform(-0.4, 0.4, size=(_SAMPLES, self.stated.data.sizes.states))
        return samples

    def at(self, x: Any) -> Any:
        """The corners at states that are entries or numbers, shape ``(3, count)``."""
        sizes = self.stated.data.sizes

        def refuse(kind: str, j: int) -> Any:
            raise ProblemClassError(
                f"{self.what} reads {kind}[{j}]. An object moves with states, which are continuous; declare what it "
                "moves with as a state."
            )

        others = [
            column_array([LazyEntry(partial(refuse, kind, j)) for j in range(count)])
            for kind, count in (("xdot", sizes.states), ("y", sizes.algebraics), ("u", sizes.controls))
        ]
        corners = ArrayToFill.zeros((3, self.count))
        shown = f"V, {self.index}, ..."
        returned = self._methods.call("get_object_vertices", corners, self.index, column_array(x), *others, shown=shown)
        if returned is None:
            return np.asarray(corners)
        given = np.asarray(array(returned))
        if given.shape != corners.shape:
            raise ProblemClassError(f"{self.what}: an array of shape {given.shape}; expected {corners.shape}.")
        return given

    def _numbers(self, x: Array) -> Array:
        # Wrapped numbers: the method sees what it will see of variables.
        corners = self.at([ArrayEntry(number) for number in x.tolist()])
        numbers = np.array([[float(entry) for entry in row] for row in corners])
        if not np.isfinite(numbers).all():
            raise ProblemClassError(f"{self.what}: has corners that are not finite at x = {x}.")
        return numbers

    def body(self, dimension: int) -> Body:
        """Shape, and pose where it moves.

        Raises
        ------
        ProblemClassError
            When the distances between its corners change.
        """
        corners = [sample[:dimension] for sample in self._samples]
        name = f"object{self.index}"
        if not self.moves:
            return Body(Polytope.hull(corners[0].T, name=name, allow_flat=True))
        origin = corners[0][:, :1]
        shape = corners[0] - corners[0].mean(axis=1, keepdims=True)
        size = max(float(np.abs(shape).max()), 1e-9)
        for moved in corners[1:]:
            turned = moved - moved.mean(axis=1, keepdims=True)
            change = np.abs(turned.T @ turned - shape.T @ shape).max()
            if change > _RIGID * size**2:
                raise ProblemClassError(
                    f"{self.what}: the distances between its corners change with the states. Only rigid objects are "
                    "supported: give each rigid part as an object of its own."
                )
        if dimension == 2:
            planar = self._planar(corners, name)
            if planar is not None:
                return planar
        frame = corners[0] - origin
        rank = int(np.linalg.matrix_rank(frame, tol=1e-9 * size))
        if rank < dimension - 1 and not self._only_shifts(corners):
            raise ProblemClassError(
                f"{self.what}: its corners lie on a line or a point, which leaves the turn about it open. Give "
                "it a width."
            )
        hull = Polytope.hull(frame.T, name=name, allow_flat=True)
        constant = np.eye(dimension) if self._only_shifts(corners) else None
        return Body(hull, pose=PoseOfCorners(self, frame, dimension, constant))

    @staticmethod
    def _only_shifts(corners: list[Array]) -> bool:
        first = corners[0] - corners[0][:, :1]
        return all(np.abs(moved - moved[:, :1] - first).max() < 1e-12 for moved in corners)

    def _planar(self, corners: list[Array], name: str) -> Body | None:
        """A body whose centre and angle are affine in the states; None where they are not."""
        states = np.column_stack([self._random_states(), np.ones(_SAMPLES)])
        extra = self._more_states(states.shape[1] + 3)
        states = np.vstack([states, np.column_stack([extra, np.ones(len(extra))])])
        corners = [*corners, *(self._numbers(x)[:2] for x in extra)]
        centres = np.array([sample.mean(axis=1) for sample in corners])
        shape = corners[0] - centres[0][:, None]
        angles = np.unwrap(
            [_angle(shape, sample - centre[:, None]) for sample, centre in zip(corners, centres, strict=True)]
        )
        angle, *_ = np.linalg.lstsq(states, angles, rcond=None)
        # The author's point of reference is some point of the body, which moves in an affine way.
        cosine, sine = np.cos(angles), np.sin(angles)
        nothing = np.zeros_like(states)
        unknowns = np.vstack(
            [
                np.column_stack([states, nothing, -cosine, sine]),
                np.column_stack([nothing, states, -sine, -cosine]),
            ]
        )
        place, *_ = np.linalg.lstsq(unknowns, centres.T.ravel(), rcond=None)
        left = max(np.abs(states @ angle - angles).max(), np.abs(unknowns @ place - centres.T.ravel()).max())
        if left > 1e-9:
            return None
        count = states.shape[1]
        shape = shape - place[2 * count :, None]
        # The shape at angle zero, so that numbers are the author's.
        start = float(angle[-1])
        turn = np.array([[math.cos(start), -math.sin(start)], [math.sin(start), math.cos(start)]])
        coefficients = _tidy(np.column_stack([place[:count], place[count : 2 * count], angle]))
        coefficients[-1, 2] = 0.0
        hull = Polytope.hull(_tidy(turn @ shape).T, name=name, allow_flat=True)
        return Body(hull, pose=AffinePose(self.stated, coefficients))

    def _more_states(self, count: int) -> Array:
        generator = np.random.default_rng(1000 + self.index)
        samples: Array = generator.uniform(-0.2, 0.2, size=(count, self.stated.data.sizes.states))
        return samples


def _angle(shape: Array, turned: Array) -> float:
    """By which angle corners around the origin are turned."""
    cosine = float((shape * turned).sum())
    sine = float((shape[0] * turned[1] - shape[1] * turned[0]).sum())
    return math.atan2(sine, cosine)


def _tidy(coefficients: Array) -> Array:
    """Rounding taken off numbers that are nearly short decimals."""
    rounded = np.round(coefficients, 10)
    return np.where(np.abs(rounded - coefficients) < 1e-12, rounded, coefficients)


class AffinePose:
    """A pose in the plane, position and angle affine in the states: a pose rule.

    Parameters
    ----------
    stated : StatedProblem
    coefficients : array, shape (states + 1, 3)
        Of x, y and the angle; the last row is constant.
    """

    def __init__(self, stated: StatedProblem, coefficients: Array) -> None:
        self._names = stated.names("x")
        self._coefficients = coefficients

    def __call__(self, block: Any, t: Any) -> Pose:
        """The pose at an index of time."""
        entries = []
        for column in self._coefficients.T.tolist():
            entry: Any = column[-1]
            for name, a in zip(self._names, column, strict=False):
                if a:
                    entry = entry + (getattr(block, name)[t] if a == 1.0 else a * getattr(block, name)[t])
            entries.append(entry)
        return planar_pose(*entries)


class PoseOfCorners:
    """A pose put together of the formulas of corners: a pose rule.

    The first corner is the origin of the body's frame. With edges ``E`` of the body as columns, which are ``R E`` in
    the world, the rotation is ``R = (R E) E^-1``; in space the cross product of two edges takes the place of a third
    where all corners lie in a plane.

    Parameters
    ----------
    corners : Corners
    frame : array, shape (dimension, count)
        Corners of the body in its own frame, the first at the origin.
    dimension : int
    constant : array or None
        The rotation, where it does not change.
    """

    def __init__(self, corners: Corners, frame: Array, dimension: int, constant: Array | None) -> None:
        self._corners, self._dimension, self._constant = corners, dimension, constant
        self._edges = _spanning(frame, dimension) if constant is None else []
        edges = frame[:, self._edges]
        if constant is None and len(self._edges) < dimension:
            third = np.cross(edges.T[0], edges.T[1]) if dimension == 3 else np.array([-edges[1, 0], edges[0, 0]])
            edges = np.column_stack([edges, third])
        self._inverse = np.linalg.inv(edges) if constant is None else np.eye(dimension)

    def __call__(self, block: Any, t: Any) -> Pose:
        """The pose at an index of time."""
        x = [ArrayEntry(getattr(block, name)[t]) for name in self._corners.stated.names("x")]
        corners = array(self._corners.at(x))[: self._dimension]
        position = corners[:, 0]
        if self._constant is not None:
            return Pose(tuple(map(tuple, self._constant.tolist())), tuple(position))
        edges = [corners[:, k] - position for k in self._edges]
        if len(edges) < self._dimension:
            first = edges[0]
            edges.append(np.cross(first, edges[1]) if self._dimension == 3 else array([-first[1], first[0]]))
        rotation = np.stack(edges, axis=1) @ np.where(np.abs(self._inverse) < 1e-12, 0.0, self._inverse)
        return Pose(tuple(map(tuple, rotation)), tuple(position))


def _spanning(frame: Array, dimension: int) -> list[int]:
    """The corners whose edges from the first one span most."""
    chosen: list[int] = []
    rest = frame.copy()
    for _ in range(dimension):
        lengths = np.linalg.norm(rest, axis=0)
        best = int(np.argmax(lengths))
        if lengths[best] < 1e-9 * max(float(np.abs(frame).max()), 1e-9):
            break
        chosen.append(best)
        direction = rest[:, best] / lengths[best]
        rest = rest - np.outer(direction, direction @ rest)
    return chosen
