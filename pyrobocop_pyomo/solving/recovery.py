"""What is tried when no feasible plan was found: a ladder of its own, each step from the user's guess or the last point.

A wrong side, a plane that has to see too long a step, or a guess deep inside an obstacle end in a point of local
infeasibility. None of the steps below is trusted by itself: each ends with the full clearance and hard planes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.obstacles import ObstacleAvoidanceData

from .point import Point
from .quality import Quality
from .solve_result import SolveResult

logger = logging.getLogger(__name__)

CLEARANCE_FACTORS = (0.2, 0.5, 1.0)
# Times the size of the objective, per length that a plane gives way.
SOFTNESS_WEIGHT = 100.0
SEEDS = (1, 2)


class Solves(Protocol):
    """What a recovery needs of the planning that it is part of."""

    def solve(self, purpose: str, *, again: bool = False) -> SolveResult:
        """Solve the model as it stands."""

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""


class Recovery:
    """Climbs the steps on one model until a feasible point is found.

    Parameters
    ----------
    model : Block
    blocks : list of ObstacleAvoidanceData
    planning : Solves
    guess : Point
        The user's, before the first solve.
    """

    def __init__(self, model: Any, blocks: list[ObstacleAvoidanceData], planning: Solves, guess: Point) -> None:
        self._model, self._blocks, self._planning, self._guess = model, blocks, planning, guess

    def climb(self, result: SolveResult) -> SolveResult:
        """Try one step after the other; the result of the last is returned, feasible or not."""
        for step in self._steps():
            if result.quality is not Quality.INFEASIBLE or not self._planning.may_go_on(result):
                break
            result = step()
        return result

    def _steps(self) -> Iterator[Callable[[], SolveResult]]:
        yield self._fresh_certificates
        yield self._other_norm
        yield self._growing_clearance
        yield self._giving_way
        for seed in SEEDS:
            yield lambda seed=seed: self._other_sides(seed)

    def _fresh_certificates(self) -> SolveResult:
        for block in self._blocks:
            block.split_violated()
            block.initialize()
        return self._planning.solve("planes anew, at the last point")

    def _other_norm(self) -> SolveResult:
        self._guess.restore()
        for block in self._blocks:
            block.set_norm("ball" if block.norm == "sphere" else "sphere")
            block.initialize()
        return self._planning.solve("other norm of the normals")

    def _growing_clearance(self) -> SolveResult:
        self._guess.restore()
        for block in self._blocks:
            block.initialize()
        try:
            for factor in CLEARANCE_FACTORS:
                for block in self._blocks:
                    block.scale_clearance(factor)
                result = self._planning.solve(f"{factor:.0%} of the clearance", again=factor != CLEARANCE_FACTORS[0])
                if result.quality is Quality.INFEASIBLE or not self._planning.may_go_on(result):
                    break
        finally:
            for block in self._blocks:
                block.scale_clearance(1.0)
        return result

    def _giving_way(self) -> SolveResult:
        self._guess.restore()
        for block in self._blocks:
            block.initialize()
        with softened(self._model, self._blocks, SOFTNESS_WEIGHT):
            self._planning.solve("planes that give way")
        for block in self._blocks:
            block.initialize()
        return self._planning.solve("hard planes again")

    def _other_sides(self, seed: int) -> SolveResult:
        self._guess.restore()
        for block in self._blocks:
            block.initialize(seed=seed)
        return self._planning.solve(f"sides by seed {seed}")


@contextmanager
def softened(model: Any, blocks: list[ObstacleAvoidanceData], weight: float) -> Iterator[None]:
    """Let planes give way at a price, in an objective that takes the place of the user's for a while."""
    users = list(model.component_data_objects(Objective, active=True))
    for block in blocks:
        block.soften()
    softness = sum(block.softness for block in blocks)
    own = users[0].expr if len(users) == 1 else 0.0
    sign = 1.0 if not users or users[0].is_minimizing() else -1.0
    sense = users[0].sense if users else 1
    home = blocks[0]
    home.softened_objective = Objective(expr=own + sign * weight * softness, sense=sense)
    for each in users:
        each.deactivate()
    try:
        yield
    finally:
        home.del_component("softened_objective")
        for each in users:
            each.activate()
        for block in blocks:
            block.harden()
