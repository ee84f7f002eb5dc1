"""The nearest points of two shapes, by the optimality conditions of the distance between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set_types import NonNegativeIntegers
from pyomo.core.base.var import Var
from pyomo.core.expr import sqrt

from pyrobocop_pyomo.complementarity import Complementarity, complements
from pyrobocop_pyomo.geometry import distance_of_points
from pyrobocop_pyomo.optional_imports import scipy

from .protocol import PlacedShape, PosedShape, SeparationIndex
from .rows import add_components, dot, empty_expressions, empty_rows


@dataclass(frozen=True)
class Optimality:
    """Nearest points ``p = sum a_i V_i``, ``q = sum c_j W_j`` as complementarity: for comparison with PyRoboCOP only.

    With ``v = p - q`` and the corners ``V_i``, ``W_j`` in the world::

        V_i.v - nu_i + lam = 0     -W_j.v - mu_j + kap = 0     sum a = sum c = 1
        0 <= a_i _|_ nu_i >= 0     0 <= c_j _|_ mu_j >= 0
        sqrt(v.v + s**2) >= sqrt(required**2 + s**2),  s = required / 2

    With a clearance of 0.02 and no radii, the last row is the one that PyRoboCOP has built in. Where a solver meets the
    complementarity pairs only approximately, ``|v|`` may exceed the distance: unlike with every other formulation the
    error is on the unsafe side, and ``normal = v`` proves a gap only when the gap is recomputed from it.

    Attributes
    ----------
    cold : bool
        Start all unknowns at zero, as PyRoboCOP does, instead of at the nearest points.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
    ICRA 2022, doi:10.1109/ICRA46639.2022.9812069
    """

    cold: bool = False
    name: str = "optimality"
    covers_intervals: bool = False
    signed: bool = False
    norms: tuple[str, ...] = ()
    halfspaces: tuple[bool, bool] = (False, False)
    rays: tuple[bool, bool] = (False, False)

    def declare(self, block: Any, axes: range) -> None:
        """Unknowns, rows and complementarity pairs, still empty."""
        corners = (block.separations, ["first", "second"], NonNegativeIntegers)
        add_components(
            block,
            corner_weight=Var(*corners, bounds=(0, None), dense=False, doc="shares of corners in the nearest point"),
            corner_multiplier=Var(*corners, bounds=(0, None), dense=False, doc="multipliers of the shares' bounds"),
            sum_multiplier=Var(*corners[:2], dense=False, doc="multipliers of the shares' sums"),
            normal=empty_expressions("from the nearest point of the second shape to that of the first"),
            shares=empty_rows("shares of corners add up to one"),
            stationarity=empty_rows("no other point is nearer"),
            gap=empty_rows("distance of the nearest points"),
            nearest=Complementarity(AnyIndex, doc="a corner has no share, or is one of the nearest"),
        )

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Unknowns, rows and complementarity pairs of one separation."""
        corners = {name: _corners(posed) for name, posed in (("first", first), ("second", second))}
        weights = {
            name: [block.corner_weight.add((*index, name, i)) for i in range(len(points))]
            for name, points in corners.items()
        }
        nearest = {
            name: [dot(column, weights[name]) for column in zip(*points, strict=True)]
            for name, points in corners.items()
        }
        between = [
            block.normal.add((*index, axis), here - there)
            for axis, (here, there) in enumerate(zip(nearest["first"], nearest["second"], strict=True))
        ]
        for name, sign in (("first", 1), ("second", -1)):
            total = block.sum_multiplier.add((*index, name))
            block.shares.add((*index, name), sum(weights[name]) == 1)
            for i, (corner, weight) in enumerate(zip(corners[name], weights[name], strict=True)):
                place = (*index, name, i)
                multiplier = block.corner_multiplier.add(place)
                block.stationarity.add(place, sign * dot(corner, between) - multiplier + total == 0)
                block.nearest[place] = complements(weight >= 0, multiplier >= 0)
        required = block.required[index]
        smooth = sqrt(sum(entry**2 for entry in between) + required**2 / 4)
        block.gap.add(index, (0.0, smooth - required * 5**0.5 / 2, None))

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """Shares, multipliers and sums at the nearest points; all zero if cold."""
        near = distance_of_points(first.vertices, second.vertices)
        between = near.first_point - near.second_point
        for name, placed, point, sign in (
            ("first", first, near.first_point, 1),
            ("second", second, near.second_point, -1),
        ):
            heights = sign * placed.vertices @ between
            starts = (_shares(placed.vertices, point), heights - heights.min(), -heights.min())
            shares, multipliers, total = (0 * start if self.cold else start for start in starts)
            block.sum_multiplier[(*index, name)].set_value(float(total))
            for i, (share, multiplier) in enumerate(zip(shares.tolist(), multipliers.tolist(), strict=True)):
                block.corner_weight[(*index, name, i)].set_value(share, skip_validation=True)
                block.corner_multiplier[(*index, name, i)].set_value(multiplier, skip_validation=True)

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Do nothing: the normal has no norm of its own."""


def _shares(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Shares (k,) of corners (k, d) that add up to one and whose mean is a point."""
    size = max(float(np.abs(corners).max()), 1e-12)
    rows = np.vstack([corners.T / size, np.ones(len(corners))])
    return np.asarray(scipy.optimize.nnls(rows, np.append(point / size, 1.0))[0])


def _corners(posed: PosedShape) -> list[tuple[Any, ...]]:
    (_, pose) = posed.poses[0]
    return [pose.apply(corner) for corner in posed.shape.vertices.tolist()]
