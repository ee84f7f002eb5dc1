"""What to say of an initial guess that goes through obstacles, where no safe motion was found from it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.motion.safety_report import joined_report
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.phases import phases_of

logger = logging.getLogger(__name__)


def colliding_guess(model: Any, guess: VariableValues, blocks: Sequence[ObstacleAvoidanceBlockData]) -> str:
    """Which bodies the initial guess brings together, when and by how much, and how to find one that is clear.

    Parameters
    ----------
    model : Block
        Its values are left as they are.
    guess : VariableValues
        Taken of the initial guess.
    blocks : sequence of ObstacleAvoidanceBlockData

    Returns
    -------
    str
        Empty where the guess is clear, or cannot be judged.
    """
    now = VariableValues(guess.variables)
    guess.restore()
    try:
        worst = joined_report([block.verify(equations=False) for block in blocks]).worst
    except PyRobocopError as error:
        logger.info("'%s': the initial guess cannot be judged: %s", model.name, error)
        return ""
    finally:
        now.restore()
    if worst is None or not worst.distance < worst.clearance:
        return ""
    phases = phases_of(model)
    phase = phases[0].name if phases else "phase"
    apart = f"overlap {-worst.distance:.3g}" if worst.distance < 0 else f"distance {worst.distance:.3g}"
    return (
        f"The initial guess collides: '{worst.first}' with '{worst.second}', {apart} at t = {worst.time:.3g}. "
        f"Start from a motion that is clear: {phase}.initialize(rcp.scenes.waypoint_initial_guess({phase}, "
        f'{{"x": [...], "y": [...]}})), for an arm {phase}.initialize(rcp.scenes.sampled_path({phase})), for a car '
        "path = rcp.scenes.hybrid_a_star(start, goal, body=..., obstacles=...) and "
        f"{phase}.initialize(path.initial_guess({phase}, speed=...))."
    )
