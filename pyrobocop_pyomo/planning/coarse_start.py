"""Long plans among many obstacles start from a plan on fewer elements, found on a copy of the model.

How to get around obstacles hardly depends on the mesh, and costs many iterations; on a fine mesh each of them is dear.
The copy keeps the user's variables out of it: another mesh would replace those at points in between.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.motion.equations_motion import phases_of_motion
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.starts import copy_with_fewer_elements, take_values_of_copy

from .planning_round import PlanningRound

logger = logging.getLogger(__name__)

# From so many elements and separations on. Or from so many pairs of shapes in all intervals together, near and far: the
# guess is near few of them, and its plan wanders among all. The copy has a quarter of the elements, or as few as this.
LEAST_ELEMENTS, LEAST_SEPARATIONS, LEAST_PAIRS = 50, 500, 5000
COARSER, LEAST_COARSE_ELEMENTS = 4, 20


@dataclass(frozen=True)
class CoarsePlan:
    """What a copy with fewer elements has found.

    Attributes
    ----------
    elements : int
        Of all phases of the copy together, when it was done.
    rounds : list of PlanningRound
    """

    elements: int
    rounds: list[PlanningRound]


def plan_on_fewer_elements(
    model: Any,
    blocks: list[Any],
    settings: Settings,
    planned: Callable[[Any, Settings], tuple[Any, list[PlanningRound]]],
) -> CoarsePlan | None:
    """Plan on a copy with fewer elements, and take its values as the initial guess.

    Parameters
    ----------
    model : Block
    blocks : list of ObstacleAvoidanceBlockData and ContainmentData
    settings : Settings
    planned : callable
        ``planned(copy, settings)`` plans, and returns the result with its rounds.

    Returns
    -------
    CoarsePlan or None
        None where the model is not large, cannot be copied with another mesh, or no plan was found. Values are then as
        before.

    Raises
    ------
    KeyboardInterrupt
        When the search was interrupted; what it had found is on the model.
    """
    phases = {id(phase): phase for block in blocks for phase in phases_of_motion(block.motion)}
    scenes = [block for block in blocks if isinstance(block, ObstacleAvoidanceBlockData)]
    separations = sum(len(block.separations) for block in scenes)
    pairs = separations + sum(len(block.record.pruned) for block in scenes)
    if separations < LEAST_SEPARATIONS and pairs < LEAST_PAIRS:
        return None
    elements = {phase: phase.grid.mesh.elements for phase in phases.values()}
    fewer = {phase: max(n // COARSER, LEAST_COARSE_ELEMENTS) for phase, n in elements.items() if n >= LEAST_ELEMENTS}
    copy = copy_with_fewer_elements(model, fewer)
    if copy is None:
        return None
    left = settings.deadline.left
    shorter = replace(settings, deadline=Deadline.after(None if left is None else 0.5 * left))
    try:
        result, rounds = planned(copy, shorter)
    except PyRobocopError as error:
        logger.info("'%s': no start on fewer elements: %s", model.name, error)
        return None
    if result.quality is not Quality.INFEASIBLE:
        take_values_of_copy(model, copy)
    if result.stop_reason is StopReason.INTERRUPTED:
        raise KeyboardInterrupt
    if result.quality is Quality.INFEASIBLE:
        return None
    return CoarsePlan(sum(copy.find_component(phase).grid.mesh.elements for phase in fewer), rounds)
