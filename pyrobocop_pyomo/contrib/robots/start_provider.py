"""Paths among random configurations as starts of plans: for arms, and for bodies that fly."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.obstacles import avoidance_blocks
from pyrobocop_pyomo.obstacles.rerouting import are_computed, overlaps_deeply
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.planning.recovery import PATH_CLEARANCES, Fit, register_starts

from .configuration_space import ConfigurationSpace
from .sampled_path import sampled_path

logger = logging.getLogger(__name__)

# Random configurations for each path.
SAMPLES = 4000


class ConfigurationStarts:
    """Paths among random configurations, where the initial guess collides."""

    def fits(self, model: Any) -> Fit | None:
        """See `StartProvider`. Arms that start or end where they must not have no use for their guess."""
        spaces = list(_spaces(model))
        if not spaces:
            return None
        blocks = avoidance_blocks(model)
        if all(map(_can_be_rerouted, blocks)):
            return Fit()
        is_far_off = any(map(overlaps_deeply, blocks)) or not all(space.guess_reaches_goals() for space in spaces)
        return Fit(comes_first=is_far_off)

    def propose(self, model: Any, deadline: Deadline) -> Iterator[str]:
        """See `StartProvider`. Where there are no clear configurations at the ends, other paths do not help."""
        for seed, clearances in enumerate(PATH_CLEARANCES):
            has_path, why = False, None
            for space in _spaces(model):
                if space.guess_reaches_goals_clear():
                    continue
                try:
                    guess = sampled_path(space.phase, clearances=clearances, samples=SAMPLES, seed=seed)
                except InitialGuessError as error:
                    logger.info("%s", error)
                    why = why or error
                    continue
                space.phase.initialize(guess)
                has_path = True
            if why is not None and seed == 0 and not _has_clear_ends(model):
                raise why
            if has_path:
                yield f"along random configurations, {clearances:g} clearances away"


def _can_be_rerouted(block: Any) -> bool:
    """Whether the position of every body that moves consists of variables and numbers: no links of arms."""
    motion, scene = block.motion, block.record.scene
    poses = [
        motion.pose_at_node(body.pose, motion.points[0], name=name)
        for name, body in scene.bodies.items() if body.moves and name not in scene.obstacles
    ]  # fmt: skip
    return not are_computed([pose.translation for pose in poses])


def _has_clear_ends(model: Any) -> bool:
    """Whether there are configurations that are clear and meet the rows of the model at all starts and ends."""
    generator = np.random.default_rng(len(PATH_CLEARANCES))  # other random ones than for the paths
    try:
        for space in _spaces(model):
            for is_last in (False, True):
                space.ends(is_last, space.guess()[0], generator)
    except InitialGuessError as error:
        logger.info("%s", error)
        return False
    return True


def _spaces(model: Any) -> Iterator[ConfigurationSpace]:
    """Configurations of the phases that have some."""
    for phase in phases_of(model):
        try:
            yield ConfigurationSpace(phase)
        except (InitialGuessError, ObstacleError, ValueError) as error:
            logger.info("'%s': no configurations: %s", phase.name, error)


register_starts(ConfigurationStarts())
