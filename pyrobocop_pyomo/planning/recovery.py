"""What is tried when no feasible plan was found: one step after the other, from the initial guess or the last point.

Normals on a wrong side or in contradiction, a plane for too long an interval, or an initial guess deep inside
an obstacle end in a point of local infeasibility. None of the steps below is trusted by itself: all end with the full
clearance and hard planes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.objective import Objective
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.rerouting import reroute
from pyrobocop_pyomo.obstacles.tightening import split_violated
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.solve_result import SolveResult

logger = logging.getLogger(__name__)

CLEARANCE_FACTORS = (0.2, 0.5, 1.0)
# In units of the objective, per length that a plane gives way.
SOFTNESS_WEIGHT = 100.0
# Degrees by which the way past an obstacle is turned: to its other side, then across.
TURNS = (180.0, 90.0, -90.0)


class Solves(Protocol):
    """What a recovery needs of the planning that it is part of."""

    def solve(self, purpose: str, *, again: bool = False, relaxed: bool = False) -> SolveResult:
        """Solve the model as it stands."""

    def may_go_on(self, result: SolveResult) -> bool:
        """Whether there is time, and nobody interrupted."""


class Recovery:
    """Starts to plan from, one after the other.

    Parameters
    ----------
    model : Block
        Its values are the user's initial guess.
    blocks : list of ObstacleAvoidanceBlockData
    regions : list of ContainmentData
    planning : Solves
    """

    def __init__(
        self, model: Any, blocks: list[ObstacleAvoidanceBlockData], regions: list[ContainmentData], planning: Solves
    ) -> None:
        self._model, self._blocks, self._regions, self._planning = model, blocks, regions, planning
        self._initial = VariableValues.of_free(model)
        self._directions = {block: dict(block.record.directions) for block in blocks}

    def steps(self) -> Iterator[Callable[[], SolveResult]]:
        """What solves from each start; the caller stops asking when a plan is good enough."""
        yield self._from_initial_guess
        # Where no separation takes part, obstacles are not what makes the rest infeasible.
        if not any(block.separations for block in self._blocks):
            return
        formulations = [block.record.formulation for block in self._blocks]
        if self._has_a_way_around():
            yield self._around_all
        yield self._new_planes
        if any(formulation.norms for formulation in formulations):
            yield self._other_norm
        yield self._growing_clearance
        if all(formulation.signed for formulation in formulations):
            yield self._giving_way
        for turn in TURNS:
            yield partial(self._other_side, turn)

    def _start(self, directions: Mapping[ObstacleAvoidanceBlockData, Any] | None = None) -> None:
        """Back to the initial guess, with separations that start there."""
        self._initial.restore()
        for region in self._regions:
            region.margin.store_values(dict.fromkeys(region.times, 0.0))
        for block in self._blocks:
            clear_margins(block)
            block.initialize(directions={**self._directions[block], **(directions or {}).get(block, {})})

    def _from_initial_guess(self) -> SolveResult:
        self._start()
        return self._planning.solve("from the initial guess")

    def _has_a_way_around(self) -> bool:
        """Whether the initial guess can be led around all obstacles at once; it is on the model then."""
        last = VariableValues.of_free(self._model)
        self._initial.restore()
        rerouted = [bool(reroute(block)) for block in self._blocks]
        if not any(rerouted):
            # The next step goes on from there.
            last.restore()
        return any(rerouted)

    def _around_all(self) -> SolveResult:
        for block in self._blocks:
            clear_margins(block)
            block.initialize()
        return self._planning.solve("led around all obstacles")

    def _new_planes(self) -> SolveResult:
        for block in self._blocks:
            split_violated(block)
            block.initialize()
        return self._planning.solve("new planes, at the last point")

    def _other_norm(self) -> SolveResult:
        self._start()
        for block in self._blocks:
            if block.record.formulation.norms:
                block.set_norm("ball" if block.record.norm_now == "sphere" else "sphere")
        return self._planning.solve("other norm of the normals")

    def _growing_clearance(self) -> SolveResult:
        self._start()
        try:
            for factor in CLEARANCE_FACTORS:
                for block in self._blocks:
                    block.scale_clearance(factor)
                result = self._planning.solve(
                    f"{factor:.0%} of the clearance", again=factor != CLEARANCE_FACTORS[0], relaxed=factor < 1.0
                )
                if result.quality is Quality.INFEASIBLE or not self._planning.may_go_on(result):
                    break
        finally:
            for block in self._blocks:
                block.scale_clearance(1.0)
        return result

    def _giving_way(self) -> SolveResult:
        with softened(self._model, self._blocks, SOFTNESS_WEIGHT):
            self._start()
            self._planning.solve("planes that give way", relaxed=True)
        for block in self._blocks:
            block.initialize()
        return self._planning.solve("hard planes again")

    def _other_side(self, turn: float) -> SolveResult:
        """Let the two bodies with the largest violation pass each other on another side."""
        block, pair, direction = self._most_in_the_way()
        self._start({block: {pair: _turned(direction, turn)}})
        return self._planning.solve(f"'{pair[0]}' past '{pair[1]}', {turn:.0f} degrees round")

    def _most_in_the_way(self) -> tuple[ObstacleAvoidanceBlockData, tuple[str, str], Array]:
        """The block and bodies of the separation with the largest violation, and its normal at the initial guess."""
        gaps = {
            (block, index): gap - value(block.required[index])
            for block in self._blocks
            for index, gap in block.separation_gaps().items()
        }
        block, (first, second, start) = min(gaps, key=gaps.__getitem__)
        at_last_point = _normal(block, first, second, start)
        self._start()
        # The broad phase may leave out at the initial guess what is in the way now.
        normal = _normal(block, first, second, start) if (first, second, start) in block.separations else at_last_point
        parts = block.record.scene.parts
        return block, (parts[first].body, parts[second].body), normal


def _normal(block: ObstacleAvoidanceBlockData, first: str, second: str, start: Any) -> Array:
    return np.array([value(block.normal[first, second, start, axis]) for axis in block.axes])


def clear_margins(block: ObstacleAvoidanceBlockData) -> None:
    """Forget what another motion asked for."""
    for index in block.separations:
        block.margin[index] = 0.0


def _turned(direction: Array, degrees: float) -> Array:
    """A direction turned in the plane of its two largest components."""
    i, j = np.sort(np.argsort(-np.abs(direction), kind="stable")[:2])
    angle = np.deg2rad(degrees)
    turned = direction.copy()
    turned[i] = np.cos(angle) * direction[i] - np.sin(angle) * direction[j]
    turned[j] = np.sin(angle) * direction[i] + np.cos(angle) * direction[j]
    return turned


@contextmanager
def softened(model: Any, blocks: list[ObstacleAvoidanceBlockData], weight: float) -> Iterator[None]:
    """Let planes be violated at a penalty, in an objective that replaces the user's meanwhile."""
    users = list(model.component_data_objects(Objective, active=True))
    home = blocks[0]
    name = unique_component_name(home, "softened_objective")
    own = sum(objective.expr if objective.is_minimizing() else -objective.expr for objective in users)
    try:
        for block in blocks:
            block.soften(weight)
        home.add_component(name, Objective(expr=own + sum(block.softness for block in blocks)))
        for objective in users:
            objective.deactivate()
        yield
    finally:
        for objective in users:
            objective.activate()
        home.del_component(name)
        for block in blocks:
            block.harden()
