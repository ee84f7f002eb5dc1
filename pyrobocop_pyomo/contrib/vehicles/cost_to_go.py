"""Heuristics of a search: the cost to go of a disc among obstacles, and of a car without obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array, BoolArray
from pyrobocop_pyomo.obstacles.rerouting import grid_distances

from .free_space import FreeSpace
from .motion_primitives import COARSE_HEADINGS, MotionPrimitives

Bounds = tuple[tuple[float, float], tuple[float, float]]

# The table for the car needs no finer cells than this many turning radii.
TABLE_CELL = 0.15


@dataclass(frozen=True, eq=False)
class CostToGo:
    """Estimated cost to one target: the larger one of two tables.

    Attributes
    ----------
    target : (3,) array
    origin : (2,) array
        Where both tables begin.
    disc_cell, car_cell : float
    disc : (nx, ny) array
        Length of the shortest path of a disc inside the car; infinite where there is none.
    car : (mx, my, headings) array
        Cost of the cheapest Reeds-Shepp path of the car; NaN where it was not asked for yet.
    primitives : MotionPrimitives
    """

    target: Array
    origin: Array
    disc_cell: float
    car_cell: float
    disc: Array
    car: Array
    primitives: MotionPrimitives

    @classmethod
    def to(
        cls, target: Array, bounds: Bounds, body: Polytope, obstacles: list[Polytope], clearance: float,
        primitives: MotionPrimitives, scene: float,
    ) -> CostToGo:  # fmt: skip
        """Tables for a target within bounds."""
        origin = np.array([bounds[0][0], bounds[1][0]])
        size = np.array([bounds[0][1], bounds[1][1]]) - origin
        cell = max(primitives.cell, float(size.max()) / 400)
        free = free_cells_of_disc(bounds, cell, body, obstacles, clearance, scene)
        goal_cell = np.minimum(np.floor((target[:2] - origin) / cell).astype(int), np.array(free.shape) - 1)
        disc = grid_distances(np.where(free, 1.0, np.inf), np.full(2, cell), tuple(goal_cell.tolist()))
        car_cell = max(TABLE_CELL * primitives.turning_radius, float(size.max()) / 60)
        counts = np.ceil(size / car_cell).astype(int) + 1
        car = np.full((int(counts[0]), int(counts[1]), COARSE_HEADINGS), np.nan)
        return cls(target, origin, cell, car_cell, disc, car, primitives)

    def disc_path_length(self, poses: Array) -> Array:
        """Length of the path of the disc, ``(n,)``; infinite proves that there is no path for the car."""
        i = np.floor((poses[:, :2] - self.origin) / self.disc_cell).astype(int)
        i = np.clip(i, 0, np.array(self.disc.shape) - 1)
        return np.asarray(self.disc[i[:, 0], i[:, 1]])

    def __call__(self, poses: Array) -> Array:
        """Estimated cost from each pose, ``(n,)``."""
        i = np.rint((poses[:, :2] - self.origin) / self.car_cell).astype(int)
        i = np.clip(i, 0, np.array(self.car.shape[:2]) - 1)
        turn = np.rint(poses[:, 2] * (COARSE_HEADINGS / (2.0 * np.pi))).astype(int) % COARSE_HEADINGS
        new = np.unique(i[np.isnan(self.car[i[:, 0], i[:, 1], turn])], axis=0)
        if len(new):
            # Other headings will be asked for soon: long arrays cost little more than short ones.
            places = np.repeat(self.origin + new * self.car_cell, COARSE_HEADINGS, axis=0)
            headings = np.tile(np.arange(COARSE_HEADINGS) * (2.0 * np.pi / COARSE_HEADINGS), len(new))
            costs = self.primitives.reeds_shepp_cost(np.column_stack([places, headings]), self.target)
            self.car[new[:, 0], new[:, 1]] = costs.reshape(len(new), COARSE_HEADINGS)
        return np.asarray(np.maximum(self.car[i[:, 0], i[:, 1], turn], self.disc_path_length(poses)))


def bounds_around(points: Array, beyond: float) -> Bounds:
    """The box around points ``(n, 2)``, and so much more to all sides."""
    low, high = (points.min(axis=0) - beyond).tolist(), (points.max(axis=0) + beyond).tolist()
    return (low[0], high[0]), (low[1], high[1])


def free_cells_of_disc(
    bounds: Bounds, cell: float, body: Polytope, obstacles: list[Polytope], clearance: float, scene: float
) -> BoolArray:
    """Square cells in bounds in which a disc inside the body can be, ``(nx, ny)``.

    The disc is the largest one about the reference point that the body covers, whatever its heading: a point where the
    reference point is outside of it. Where the disc has no way, the body has none.
    """
    low, high = np.array(bounds).T
    # Cells overlap the bounds; each stands for all points of its square.
    counts = np.floor((high - low) / cell).astype(int) + 1
    inner = 0.0 if body.is_flat else max(0.0, float(body.halfspaces[1].min()))
    point = FreeSpace.around(Polytope.point((0.0, 0.0)), obstacles, clearance + inner + body.radius, scene)
    return point.cells_free_of_point(low, cell, counts)
