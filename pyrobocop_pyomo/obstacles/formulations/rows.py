"""Terms of rows that formulations share; kept small, since they are built for every body pair, time and vertex."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.expr.numeric_expr import MonomialTermExpression, ProductExpression, SumExpression
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import InequalityExpression

from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.bulk_parts import new_row
from pyrobocop_pyomo.optional_imports import scipy

from .protocol import SeparationIndex


def add_components(block: Any, **components: Any) -> None:
    """Add components by name, in the order given."""
    for name, component in components.items():
        block.add_component(name, component)


def empty_rows(doc: str) -> Constraint:
    """A constraint to which rows are added one by one."""
    return Constraint(AnyIndex, doc=doc)


def empty_expressions(doc: str) -> Expression:
    """An expression to which members are added one by one."""
    return Expression(AnyIndex, doc=doc)


def is_number(entry: Any) -> bool:
    """True for plain numbers, False for expressions."""
    return entry.__class__ in native_numeric_types


def dot(coefficients: Sequence[Any], entries: Sequence[Any]) -> Any:
    """Sum of products, without the terms that are zero."""
    total: Any = 0.0
    for coefficient, entry in zip(coefficients, entries, strict=True):
        if is_number(coefficient) and coefficient == 0:
            continue
        if is_number(entry) and entry == 0:
            continue
        total = total + coefficient * entry
    return total


def has_constant_rotation(pose: Pose) -> bool:
    """True where the orientation holds numbers only."""
    return all(is_number(entry) for row in pose.rotation for entry in row)


def rotation_of(pose: Pose) -> np.ndarray:
    """Rotation (d, d) of a pose whose orientation holds numbers only."""
    return np.array(pose.rotation, dtype=float)


def turned(normal: Sequence[Any], pose: Pose) -> list[Any]:
    """``R'n``: a direction of the world in the frame of a body."""
    dimension = len(pose.translation)
    return [dot([pose.rotation[row][column] for row in range(dimension)], normal) for column in range(dimension)]


def state_side(
    rows: Constraint,
    place: tuple[Any, ...],
    corners: np.ndarray,
    rays: np.ndarray,
    direction: Sequence[Any],
    level: Any,
    *,
    upward: bool,
) -> None:
    """Rows that keep corners, and rays from them, on one side of a plane at a height over a body's origin.

    The direction consists of variables and named expressions, and the level is one. Pyomo's operators and `add` take
    nearly twice as long, and these rows much of the time of a scene.
    """
    products = [MonomialTermExpression if entry.is_variable_type() else ProductExpression for entry in direction]
    heights: list[Any] = [
        SumExpression([*(of((c, e)) for of, c, e in zip(products, corner, direction, strict=True) if c), level])
        for corner in corners.tolist()
    ]
    heights += [dot(ray, direction) for ray in rays.tolist()]
    for number, height in enumerate(heights):
        sides = (0.0, height) if upward else (height, 0.0)
        new_row(rows, (*place, number), InequalityExpression(sides, False))


def norm_relation(normal: Sequence[Any], norm: str) -> tuple[Any, Any, Any]:
    """The relation that bounds ("ball") or fixes ("sphere") the length of the normal."""
    square = sum(entry**2 for entry in normal)
    return (1.0, square, 1.0) if norm == "sphere" else (None, square, 1.0)


def set_norm(block: Any, index: SeparationIndex, norm: str) -> None:
    """Bound the length of the normal of one separation, or fix it."""
    block.unit[index].set_value(norm_relation([block.normal[(*index, axis)] for axis in block.axes], norm))


def facet_weights(shape: Polytope, direction: np.ndarray) -> np.ndarray:
    """Weights (m,) >= 0 of the half-spaces that give a direction: ``A'l = direction`` with least ``b'l``.

    By duality they sit on the facets that meet where the shape reaches farthest along the direction, so that a
    least-squares problem in a few unknowns replaces the linear program.
    """
    normals, offsets = shape.halfspaces
    scale = max(1.0, float(np.abs(offsets).max()))
    reached = shape.vertices[np.argmax(shape.vertices @ direction)]
    active = np.flatnonzero(offsets - normals @ reached <= 1e-9 * scale)
    weights = np.zeros(len(offsets))
    weights[active] = scipy.optimize.nnls(normals[active].T, direction)[0]
    return weights
