"""Cases with several vehicles: where each starts and parks, and what all keep clear of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented

from .parking_case import ParkingCase

# Of an obstacle that a map gives as a point: what its benchmark takes.
DISC_RADIUS = 0.8
_LIST = re.compile(r"\[([^\][]*)\]")


@dataclass(frozen=True, eq=False)
class VehiclesCase(Presented):
    """Several vehicles of one kind among obstacles that rest.

    Attributes
    ----------
    name : str
    starts, goals : (n, 3) arrays
        x, y and heading of the middle of each rear axle.
    obstacles : dict of str to list of Polytope
        The convex parts of each.
    """

    name: str
    starts: Array
    goals: Array
    obstacles: Mapping[str, list[Polytope]]

    def __post_init__(self) -> None:
        for which in ("starts", "goals"):
            numbers = np.array(getattr(self, which), dtype=float)
            if numbers.ndim != 2 or numbers.shape[1] != 3 or not len(numbers) or not np.isfinite(numbers).all():
                raise ObstacleError(
                    f"vehicles '{self.name}': the {which} have shape {numbers.shape}; expected a row of finite x, y "
                    "and heading for each vehicle."
                )
            object.__setattr__(self, which, numbers)
        if len(self.starts) != len(self.goals):
            raise ObstacleError(f"vehicles '{self.name}': {len(self.starts)} starts, but {len(self.goals)} goals.")

    @classmethod
    def read(cls, path: str | Path, *, disc_radius: float = DISC_RADIUS) -> VehiclesCase:
        """Read a map of several vehicles, or a line of numbers.

        Parameters
        ----------
        path : str or Path
            ``.yaml``: the maps of the benchmark for CL-CBS, with ``start: [x, y, heading]`` and ``goal: [...]`` of
            each of the agents, and obstacles as points. Their headings count clockwise, as these maps have them.
            Anything else: numbers as `ParkingCase` has them, with the number of vehicles before and the poses of
            start and goal of each: ``n, x, y, heading, x, y, heading, ..., obstacles, corners of each, corners``.
        disc_radius : float, optional
            Of the obstacles of a map, which are discs; metres.

        Raises
        ------
        ObstacleError
            When something is missing or no number.
        OSError
            When the file cannot be read.
        """
        text, name = Path(path).read_text(encoding="utf-8-sig"), Path(path).stem
        if Path(path).suffix in (".yaml", ".yml"):
            return cls._from_map(text, name, disc_radius)
        words = [word for word in re.split(r"[\s,;]+", text) if word]
        count = int(words[0]) if words and words[0].isdigit() else 0
        poses = _numbers(words[1 : 1 + 6 * count], name)
        if not count or len(poses) != 6 * count:
            raise ObstacleError(
                f"vehicles '{name}': {len(words)} numbers; expected the number of vehicles, x, y and heading of start "
                "and goal of each, and the obstacles as for ParkingCase.read."
            )
        first = ParkingCase.from_numbers([*words[1:7], *words[1 + 6 * count :]], name=name)
        # Everything relative to the origin of the file again: vehicles have no common start.
        ends = np.array(poses).reshape(count, 2, 3)
        ends[:, :, :2] -= first.origin
        return cls(name, ends[:, 0], ends[:, 1], first.obstacles)

    @classmethod
    def _from_map(cls, text: str, name: str, disc_radius: float) -> VehiclesCase:
        poses = {
            which: [_numbers(row.split(","), name) for row in re.findall(rf"{which}:\s*\[([^\]]*)\]", text)]
            for which in ("start", "goal")
        }
        points = [_numbers(row.split(","), name) for row in _LIST.findall(text.partition("obstacles:")[2])]
        rows = [point for point in points if len(point) == 2]
        starts, goals = (np.array(poses[which]).reshape(-1, 3) for which in ("start", "goal"))
        turned = np.array([1.0, 1.0, -1.0])
        obstacles = {
            f"obstacle {k}": [Polytope.ball(disc_radius, point, name=f"obstacle {k}")]
            for k, point in enumerate(rows, 1)
        }
        return cls(name, starts * turned, goals * turned, obstacles)

    def __len__(self) -> int:
        return len(self.starts)

    def alone(self, vehicle: int, others: Sequence[tuple[str, Polytope]]) -> ParkingCase:
        """The case of one vehicle while others stand somewhere.

        Parameters
        ----------
        vehicle : int
        others : sequence of (name, Polytope)
        """
        standing: dict[str, list[Polytope]] = {name: [shape.named(name)] for name, shape in others}
        goal = self.goals[vehicle].copy()
        turn = goal[2] - self.starts[vehicle, 2]
        goal[2] = self.starts[vehicle, 2] + float(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi)
        obstacles: dict[str, Any] = {**self.obstacles, **standing}
        return ParkingCase(f"{self.name}, vehicle {vehicle + 1}", (0.0, 0.0), self.starts[vehicle], goal, obstacles)

    def __str__(self) -> str:
        return f"'{self.name}': {len(self)} vehicles among {len(self.obstacles)} obstacles"


def _numbers(words: Sequence[str], name: str) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise ObstacleError(f"vehicles '{name}': {error}; expected a number.") from None
