"""Objects given by their corners, as shapes and poses.

``get_object_vertices`` says where the corners of an object are, as functions of the states. It is evaluated at a few
random states: the products of edges tell whether the object is rigid, and its corners there are its shape. The formulas
of some corners make its pose.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from scipy.linalg import qr

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.expression_arrays import array
from pyrobocop_pyomo.motion import Body
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlock

from .problem_class import ArrayToFill, ProblemClass, column_array

# PyRoboCOP's rows mean sqrt(d'd + tol) >= sqrt(5 tol) with tol = 1e-4 for the distance vector d.
CLEARANCE = 2.0 * math.sqrt(1e-4)

_SAMPLES = 7
_ROUNDING = 1e-7  # relative to the size of the object


def add_objects(b: Any, methods: ProblemClass) -> None:
    """Add ``avoid`` to a phase: every pair of objects of which one is dynamic keeps its distance.

    Raises
    ------
    ModelError
        When the information contradicts itself, or an object is not rigid or moves with more than the states.
    """
    count, dynamic, of_corners = methods.call("get_objects_info")
    flags, counts = np.ravel(dynamic).astype(bool), np.ravel(of_corners).astype(int)
    if not int(np.asarray(count).item()) == len(flags) == len(counts):
        raise ModelError(
            f"{methods.name}.get_objects_info(): {count} objects, {len(flags)} flags, {len(counts)} numbers of corners."
        )
    objects = [Corners(methods, index, int(corners)) for index, corners in enumerate(counts)]
    dimension = 2 if all(np.ptp(each.samples[:, 2]) == 0.0 for each in objects) else 3
    bodies = {f"object{k}": each.body(dimension) for k, each in enumerate(objects)}
    moves = [each.moves for each in bodies.values()]
    stated = [(i, j) for i, j in combinations(range(len(objects)), 2) if flags[i] or flags[j]]
    pairs = [(f"object{i}", f"object{j}") for i, j in stated if moves[i] or moves[j]]
    if pairs:
        b.avoid = ObstacleAvoidanceBlock(
            b.time,
            bodies={name: body for name, body in bodies.items() if body.moves},
            obstacles={name: body.shape for name, body in bodies.items() if not body.moves},
            body_pairs=pairs,
            clearance=CLEARANCE,
        )


class Corners:
    """The corners of one object.

    Parameters
    ----------
    methods : ProblemClass
    index, count : int
        Which object, and how many corners it has.

    Raises
    ------
    ModelError
        When the corners depend on anything but the states.
    """

    def __init__(self, methods: ProblemClass, index: int, count: int) -> None:
        self._methods, self._index, self._count = methods, index, count
        # Small states, so that angles do not wind up.
        states = np.random.default_rng(index).uniform(-0.4, 0.4, (_SAMPLES, methods.counts["x"]))
        corners = [self._at(x) for x in states.tolist()]
        self.samples = np.array([[[float(entry) for entry in row] for row in each] for each in corners])
        if not np.isfinite(self.samples).all():
            raise self._error(
                "has corners that are no numbers. An object moves with states, which are continuous; declare what it "
                "moves with as a state"
            )

    def _error(self, text: str) -> ModelError:
        return ModelError(f"{self._methods.name}.get_object_vertices: object {self._index} {text}.")

    def _at(self, x: list[Any]) -> Any:
        """The corners at states, shape ``(3, count)``."""
        corners = ArrayToFill.zeros(3, self._count)
        others = [column_array([math.nan] * self._methods.counts[kind]) for kind in ("xdot", "y", "u")]
        returned = self._methods.call("get_object_vertices", corners, self._index, column_array(x), *others)
        return np.asarray(corners if returned is None else array(returned)).reshape(3, self._count)

    def body(self, dimension: int) -> Body:
        """Shape, and pose where it moves.

        Raises
        ------
        ModelError
            When the object changes its shape, or its turn is left open.
        """
        corners, name = self.samples[:, :dimension], f"object{self._index}"
        if (np.abs(corners - corners[0]) < 1e-12).all():
            return Body(Polytope.hull(corners[0].T, name=name, allow_flat=True))
        edges = corners - corners[:, :, :1]
        products = edges.transpose(0, 2, 1) @ edges
        if np.abs(products - products[0]).max() > _ROUNDING * products[0].max():
            raise self._error(
                "has corners whose distances change with the states. Only rigid objects are supported: give "
                "each rigid part as an object of its own"
            )
        frame, chosen, inverse = edges[0], [], np.eye(dimension)
        if not (np.abs(edges - frame) < 1e-12).all():
            _, triangle, order = qr(frame, pivoting=True)
            spans, chosen = np.abs(np.diag(triangle))[: dimension - 1], order[: dimension - 1].tolist()
            if spans.min() <= _ROUNDING * spans.max():
                raise self._error("has its corners on a line, which leaves the turn about it open. Give it a width")
            axes, upper = np.linalg.qr(_with_perpendicular(frame[:, chosen]))
            frame = (axes * np.sign(np.diag(upper))).T @ frame  # the first edge along the first axis
            inverse = np.linalg.inv(_with_perpendicular(frame[:, chosen]))
            inverse[np.abs(inverse) < _ROUNDING * np.abs(inverse).max()] = 0.0
        hull = Polytope.hull(frame.T, name=name, allow_flat=True)
        return Body(hull, pose=partial(self._pose, chosen, inverse))

    def _pose(self, chosen: list[int], inverse: Array, block: Any, t: Any) -> Pose:
        """The pose at a point: of the edges `chosen`, from the first corner; of none where the object does not turn."""
        dimension = len(inverse)
        corners = array(self._at([getattr(block, name)[t] for name in self._methods.names("x")]))[:dimension]
        position = corners[:, 0]
        rotation = _with_perpendicular((corners - corners[:, :1])[:, chosen]) @ inverse if chosen else inverse
        return Pose(tuple(map(tuple, rotation)), tuple(position))


def _with_perpendicular(edges: Any) -> Any:
    """One edge in the plane or two in space, as columns, and what is perpendicular to them."""
    last = np.array([-edges[1, 0], edges[0, 0]]) if len(edges) == 2 else np.cross(edges[:, 0], edges[:, 1])
    return np.column_stack([edges, last])
