"""What a car may do: its geometry, what its manoeuvres cost, and the moves that a search is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import GuessError

from .reeds_shepp import words
from .rolling import in_frame_of, rolled_on

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CarSearch:
    """How finely a path for a car is looked for, and what is good about one. Lengths in the user's unit.

    Attributes
    ----------
    cell : float or None
        Side of the squares in which one path is kept per heading and direction; None: 0.06 turning radii.
    headings : int
        Into how many a full turn is divided.
    steerings : int
        How many steering angles are tried, from one limit to the other; odd, so that straight ahead is one.
    move : float or None
        Length of one move; None: enough to leave a cell and to change the heading by one division.
    cusp_cost : float or None
        What a change of direction costs, as a length; None: half a turning radius.
    steering_cost : float or None
        What a change of steering from one limit to the other costs, as a length; None: a tenth of a turning radius.
    eagerness : float
        How much more the estimated rest of the way counts than what lies behind; 1 for the shortest paths.
    refinements : int
        How often cells and moves may be halved where they lead nowhere.
    most_nodes : int
        How many poses a search may keep.
    """

    cell: float | None = None
    headings: int = 72
    steerings: int = 5
    move: float | None = None
    cusp_cost: float | None = None
    steering_cost: float | None = None
    eagerness: float = 1.5
    refinements: int = 3
    most_nodes: int = 500_000

    def __post_init__(self) -> None:
        for name in ("cell", "move", "cusp_cost", "steering_cost", "eagerness"):
            number = getattr(self, name)
            if number is not None and not (math.isfinite(number) and number > 0.0):
                raise GuessError(f"CarSearch: {name} = {number}; expected a positive number.")
        if (
            self.headings < 8
            or self.steerings < 3
            or self.steerings % 2 == 0
            or self.most_nodes < 1
            or self.refinements < 0
        ):
            raise GuessError(
                f"CarSearch: headings = {self.headings}, steerings = {self.steerings}, most_nodes = {self.most_nodes}; "
                "expected at least 8 headings, an odd number of steerings from 3 on, and a positive number of nodes."
            )


@dataclass(frozen=True, eq=False)
class CarMoves:
    """The moves of one car, their shapes and costs.

    Attributes
    ----------
    radius : float
        Of the tightest turn.
    cell, headings : float and int
        Of the cells in which one path is kept.
    spacing : float
        Longest way from one pose to the next where motions are judged.
    ways, curvatures : (b,) arrays
        Of each move.
    samples : int
        Arcs into which a move is cut.
    cusp_cost : float
    change_cost : (b + 1, b) array
        Of one move after another; the last row is for the first move of all.
    """

    radius: float
    cell: float
    headings: int
    spacing: float
    ways: Array
    curvatures: Array
    samples: int
    cusp_cost: float
    change_cost: Array

    @classmethod
    def of(cls, wheelbase: float, steering_limit: float, search: CarSearch, level: int = 0) -> CarMoves:
        """Moves of a car with given wheelbase and largest steering angle, as many times halved as the level says."""
        radius = wheelbase / math.tan(steering_limit)
        cell = 0.06 * radius if search.cell is None else search.cell
        turn = 2.0 * math.pi / search.headings * radius
        length = max(1.5 * cell, 1.1 * turn) if search.move is None else search.move
        length, cell, headings = length / 2**level, cell / 2**level, search.headings * 2**level
        samples = max(1, math.ceil(length / (0.04 * radius)))
        steer = np.linspace(-steering_limit, steering_limit, search.steerings)
        steering = np.concatenate([steer, steer])
        ways = np.repeat([length, -length], search.steerings)
        cusp = 0.5 * radius if search.cusp_cost is None else search.cusp_cost
        swing = 0.1 * radius if search.steering_cost is None else search.steering_cost
        change = swing * np.abs(steering[:, None] - steering) / (2.0 * steering_limit)
        change = change + cusp * (ways[:, None] * ways < 0)
        curvatures = np.tan(steering) / wheelbase
        curvatures[np.abs(curvatures) < 1e-12 / radius] = 0.0
        return cls(
            radius, cell, headings, length / samples, ways, curvatures, samples, cusp,
            np.vstack([change, np.zeros(len(ways))]),
        )  # fmt: skip

    def chains(self, poses: Array) -> Array:
        """Poses along every move from each pose, ``(n, b, samples + 1, 3)``."""
        steps = np.repeat((self.ways / self.samples)[:, None], self.samples, axis=1)
        return rolled_on(poses[:, None, :], steps[None], np.repeat(self.curvatures[:, None], self.samples, 1)[None])

    def free_ways(self, poses: Array, target: Array) -> tuple[Array, Array, Array]:
        """All ways to a target where nothing stands in the way.

        Returns
        -------
        costs : (w, n) array
            Length and cusps; infinite where a kind of way does not exist.
        lengths : (w, n, 5) array
            Of the pieces, negative backwards.
        turns : (w, 5) array
        """
        seen = in_frame_of(poses, target)
        found = list(words(seen[:, 0] / self.radius, seen[:, 1] / self.radius, seen[:, 2]))
        turns = np.array([each for each, _, _ in found])
        lengths = self.radius * np.array([each for _, each, _ in found])
        exists = np.array([each for _, _, each in found])
        costs = np.abs(lengths).sum(axis=2) + self.cusp_cost * cusps_of(lengths)
        return np.where(exists, costs, np.inf), lengths, turns

    def cost_of_free_way(self, poses: Array, target: Array) -> Array:
        """Cost of the cheapest of them, ``(n,)``; for many poses."""
        seen = in_frame_of(poses, target)
        least = np.full(len(poses), np.inf)
        for _, lengths, exists in words(seen[:, 0] / self.radius, seen[:, 1] / self.radius, seen[:, 2]):
            costs = self.radius * np.abs(lengths).sum(axis=1) + self.cusp_cost * cusps_of(lengths)
            least = np.where(exists, np.minimum(least, costs), least)
        return least

    def steps_along(self, lengths: Array, turns: Array) -> tuple[Array, Array]:
        """Ways and curvatures of short arcs that make up one way, ``(s,)`` each."""
        ways, curvatures = [np.zeros(0)], [np.zeros(0)]
        for length, turn in zip(lengths.tolist(), turns.tolist(), strict=True):
            count = math.ceil(abs(length) / self.spacing) if abs(length) > 1e-9 * self.radius else 0
            ways.append(np.full(count, length / max(count, 1)))
            curvatures.append(np.full(count, turn / self.radius))
        return np.concatenate(ways), np.concatenate(curvatures)


def cusps_of(lengths: Array) -> Array:
    """Number of changes of direction along signed lengths, zeros left out: ``(...)`` from ``(..., p)``."""
    count = np.zeros(lengths.shape[:-1])
    last = np.zeros(lengths.shape[:-1])
    for k in range(lengths.shape[-1]):
        sign = np.where(np.abs(lengths[..., k]) > 1e-9, np.sign(lengths[..., k]), 0.0)
        count += last * sign < 0
        last = np.where(sign == 0, last, sign)
    return count
