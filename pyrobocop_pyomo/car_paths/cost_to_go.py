"""Heuristics of a search: the cost to go of a disc among obstacles, and of a car without obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.geometry.grid_path_search import grid_distances
from pyrobocop_pyomo.numerics import Array

from .free_space import FreeSpace
from .motion_primitives import MotionPrimitives

Bounds = tuple[tuple[float, float], tuple[float, float]]

# The table for the car needs no finer cells than this many turning radii, and divisions of a turn.
TABLE_CELL = 0.15
TABLE_HEADINGS = 36


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
        Cost of the cheapest Reeds-Shepp path of the car.
    """

    target: Array
    origin: Array
    disc_cell: float
    car_cell: float
    disc: Array
    car: Array

    @classmethod
    def to(
        cls, target: Array, bounds: Bounds, body: Polytope, obstacles: list[Polytope], clearance: float,
        primitives: MotionPrimitives, scene: float,
    ) -> CostToGo:  # fmt: skip
        """Tables for a target within bounds."""
        origin = np.array([bounds[0][0], bounds[1][0]])
        size = np.array([bounds[0][1], bounds[1][1]]) - origin
        # Cells overlap the bounds; each stands for all points of its square.
        cell = max(primitives.cell, float(size.max()) / 400)
        shape = np.floor(size / cell).astype(int) + 1
        middles = np.stack(np.meshgrid(*((np.arange(n) + 0.5) * cell for n in shape), indexing="ij"), -1) + origin
        poses = np.concatenate([middles.reshape(-1, 2), np.zeros((middles.shape[0] * middles.shape[1], 1))], 1)
        # The largest disc about the reference point that the body covers, whatever its heading: nothing where the
        # reference point is outside of it.
        inner = 0.0 if body.is_flat else max(0.0, float(body.halfspaces[1].min()))
        point = FreeSpace.around(Polytope.point((0.0, 0.0)), obstacles, clearance + inner + body.radius, scene)
        free = (point.distances(poses) >= -np.sqrt(0.5) * cell).all(axis=1).reshape(*shape)
        goal_cell = np.minimum(np.floor((target[:2] - origin) / cell).astype(int), shape - 1)
        disc = grid_distances(np.where(free, 1.0, np.inf), np.full(2, cell), tuple(goal_cell.tolist()))
        car_cell = max(TABLE_CELL * primitives.turning_radius, float(size.max()) / 60)
        counts = np.ceil(size / car_cell).astype(int) + 1
        angles = np.arange(TABLE_HEADINGS) * 2.0 * np.pi / TABLE_HEADINGS
        axes = [origin[0] + np.arange(counts[0]) * car_cell, origin[1] + np.arange(counts[1]) * car_cell, angles]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        car = primitives.reeds_shepp_cost(grid, target).reshape(*counts, TABLE_HEADINGS)
        return cls(target, origin, cell, car_cell, disc, car)

    def disc_path_length(self, poses: Array) -> Array:
        """Length of the path of the disc, ``(n,)``; infinite proves that there is no path for the car."""
        i = np.floor((poses[:, :2] - self.origin) / self.disc_cell).astype(int)
        i = np.clip(i, 0, np.array(self.disc.shape) - 1)
        return np.asarray(self.disc[i[:, 0], i[:, 1]])

    def __call__(self, poses: Array) -> Array:
        """Estimated cost from each pose, ``(n,)``."""
        i = np.rint((poses[:, :2] - self.origin) / self.car_cell).astype(int)
        i = np.clip(i, 0, np.array(self.car.shape[:2]) - 1)
        turn = np.rint(poses[:, 2] * (TABLE_HEADINGS / (2.0 * np.pi))).astype(int) % TABLE_HEADINGS
        return np.asarray(np.maximum(self.car[i[:, 0], i[:, 1], turn], self.disc_path_length(poses)))
