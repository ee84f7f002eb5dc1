"""Weights of facets: common parts of the formulations that describe a shape by its half-spaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.base.set_types import NonNegativeIntegers
from pyomo.core.base.var import Var

from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import add_components, dot, empty_expressions, empty_rows, facet_weights


def weights_component(block: Any, doc: str) -> Var:
    """Weights >= 0 of facets, by separation and facet; added one by one."""
    return Var(block.separations, NonNegativeIntegers, bounds=(0, None), dense=False, doc=doc)


def declare_both_shapes(block: Any, **measure: Any) -> None:
    """Components of a formulation with weights for the facets of both shapes; `measure` is the row that normalises."""
    add_components(
        block,
        first_weight=weights_component(block, "weights of the facets of the first shape"),
        second_weight=weights_component(block, "weights of the facets of the second shape"),
        normal=empty_expressions("normal of each separation"),
        balance=empty_rows("both shapes have the same normal, with opposite signs"),
        gap=empty_rows("the gap that is proven"),
        **measure,
    )


def add_both_shapes(
    block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape
) -> tuple[list[Any], list[Any]]:
    """Weights of both shapes with ``R1 G'm + n = 0`` and ``n.(t1 - t2) - b'l - g'm >= required``.

    Returns
    -------
    tuple of list
        All weights, those of the first shape before the others, and the normal.
    """
    first_weights = add_weights(block.first_weight, index, first)
    second_weights = add_weights(block.second_weight, index, second)
    normal, second_offset = add_normal(block, index, second_weights, second)
    direction, first_offset = combination(first_weights, first)
    for axis, (entry, opposite) in enumerate(zip(turned_out(direction, first), normal, strict=True)):
        block.balance.add((*index, axis), entry + opposite == 0)
    proven = between_origins(normal, first, second) - second_offset - first_offset
    block.gap.add(index, (0.0, proven - block.required[index], None))
    return first_weights + second_weights, normal


def start_both_shapes(
    block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
) -> None:
    """Weights of both shapes that give the normal."""
    start_weights(block.second_weight, index, second, normal)
    start_weights(block.first_weight, index, first, -normal)


def add_weights(component: Var, index: SeparationIndex, posed: PosedShape) -> list[Any]:
    """One weight per facet of a shape."""
    return [component.add((*index, facet)) for facet in range(len(posed.shape.halfspaces[1]))]


def combination(weights: list[Any], posed: PosedShape) -> tuple[list[Any], Any]:
    """``A'l`` in the frame of the shape, and ``b'l``."""
    normals, offsets = posed.shape.halfspaces
    return [dot(column, weights) for column in normals.T.tolist()], dot(offsets.tolist(), weights)


def turned_out(direction: list[Any], posed: PosedShape) -> list[Any]:
    """``R v``: a direction of the shape's frame in the world, at its only pose."""
    (_, pose) = posed.poses[0]
    return [dot(row, direction) for row in pose.rotation]


def add_normal(
    block: Any, index: SeparationIndex, second_weights: list[Any], second: PosedShape
) -> tuple[list[Any], Any]:
    """The normal as an expression of the weights of the second shape, and ``b'l``."""
    direction, offset = combination(second_weights, second)
    normal = turned_out(direction, second)
    return [block.normal.add((*index, axis), entry) for axis, entry in enumerate(normal)], offset


def between_origins(normal: list[Any], first: PosedShape, second: PosedShape) -> Any:
    """``n.(t1 - t2)``."""
    here, there = first.poses[0][1].translation, second.poses[0][1].translation
    return dot(here, normal) - dot(there, normal)


def start_weights(
    component: Var, index: SeparationIndex, placed: PlacedShape, outwards: np.ndarray, scale: float = 1.0
) -> None:
    """Weights that give a direction of the world."""
    for facet, weight in enumerate(scale * facet_weights(placed.shape, placed.rotation.T @ outwards)):
        component[(*index, facet)].set_value(float(weight), skip_validation=True)
