"""On which clock a body moves, and whether it moves at all: asked of the pose rules before anything is solved.

A pose rule gets an index ``t``. It is a time only where the phase has a fixed start and a fixed duration; where
something about the horizon is to be found it runs from 0 to 1. A wrong clock makes a plan that is safe among obstacles
that are somewhere else.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Iterator, Mapping
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.pose_templates import PoseReading
from pyrobocop_pyomo.motion.table_paths import TablePath
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

logger = logging.getLogger(__name__)

# By how much the index is scaled down and the duration up: what depends on their product alone does not change.
_SCALE = 1.7
# Largest jump of an obstacle from phase to phase, in units of length, that is rounding.
_LARGEST_JUMP = 1e-6


def check_rules(label: str, motion: Motion, bodies: Mapping[str, Body], *, between: bool = True) -> None:
    """Check the pose rules of a block that is being stated.

    Parameters
    ----------
    label : str
        Name of the block in messages.
    motion : Motion
        With intervals; else nothing is checked.
    bodies : mapping of name to Body
    between : bool
        Whether the rows are about the motion between the nodes. Rows of single points can be stated with rules that
        cannot be asked elsewhere; what can be asked is checked.

    Raises
    ------
    ObstacleError
        Naming the body: its rule cannot be asked between the nodes, goes by values, turns a shape without end, or is
        on the index of a phase where that is no time.
    """
    if not motion.intervals:
        return
    for name, body in bodies.items():
        if body.pose is None:
            continue
        try:
            reading = PoseReading(motion, body.pose, name)
        except ObstacleError:
            if between:
                raise
            continue
        if reading.stands_still:
            logger.warning(
                "%s: the pose of '%s' reads neither a variable nor time: it stands still. If it is meant to rest, give "
                "shape.placed(pose) without a rule; if not, read b.x[t], t or b.time_at(t) in the rule.",
                label,
                name,
            )
        _refuse_endless_turns(label, name, body, reading)
        _check_index(label, name, motion, body.pose, reading)


def _refuse_endless_turns(label: str, name: str, body: Body, reading: PoseReading) -> None:
    endless = [part.name for part in body.parts if not part.is_bounded]
    if endless and reading.turns:
        raise ObstacleError(
            f"{label}: '{name}' turns, and its shape '{endless[0]}' has no end: far away it moves at any speed, so "
            "that no clearance can be proven. Cut the shape to what can be reached, or leave its rotation constant."
        )


def _check_index(label: str, name: str, motion: Motion, pose: Any, reading: PoseReading) -> None:
    phase = motion.phase
    if phase is None or not phase.has_normalised_time or not reading.reads_index or _is_real_time(phase, reading):
        return
    fact = (
        f"{label}: the pose of '{name}' depends on t, which on phase '{phase.name}' runs from 0 to 1 and is no time, "
        "because its start, its duration or its elements are to be found"
    )
    remedy = f"Write b.time_at(t) in place of t, where b is '{phase.name}'"
    if isinstance(pose, TablePath):
        remedy = f"Give the table the clock of the phase: TablePath(..., clock=lambda m, t: m.{phase.name}.time_at(t))"
    raise ObstacleError(
        f"{fact}. {remedy}; for a path that takes as long as the phase does, (b.time_at(t) - b.start) / b.duration."
    )


def _is_real_time(phase: Any, reading: PoseReading) -> bool:
    """Whether the pose depends on ``start + duration * t`` only, as the user may have written it."""
    duration = phase.duration
    if phase.record.free_widths or not phase.has_free_duration:
        return False
    starts = [] if isinstance(phase.start, Real) else list(variables_in(phase.start, include_fixed=True))
    read = {id(variable) for variable in reading.variables}
    if (isinstance(phase.start, Real) and phase.start != 0.0) or any(id(variable) not in read for variable in starts):
        return False
    for index, length in ((0.23, 0.9), (0.61, 1.3)):
        before = reading.values(index, {id(duration): length})
        after = reading.values(index / _SCALE, {id(duration): length * _SCALE})
        if not np.allclose(before, after, rtol=NEGLIGIBLE, atol=NEGLIGIBLE):
            return False
    return True


# ------------------------------------------------------------------------------------------- from one phase to the next


def check_clocks(model: Any, blocks: Collection[Any]) -> None:
    """Check that what moves in time goes on where one phase follows another.

    Parameters
    ----------
    model : Block
    blocks : iterable of ObstacleAvoidanceBlockData

    Raises
    ------
    ObstacleError
        Where the clock of a phase that follows another starts anew and an obstacle of both jumps: naming it, both
        phases, and by how much.
    """
    for block in blocks:
        _warn_of_scaled_set(model, block)
        for doubt in _doubts(block, blocks):
            logger.warning("%s", doubt)


def doubtful_clock(block: Any) -> str:
    """Why it is not known when the obstacles of a block are where, in words; empty where it is."""
    try:
        return next(_doubts(block, blocks_of_kind(block.model(), type(block))), "")
    except ObstacleError as error:
        return str(error)


def _doubts(block: Any, blocks: Collection[Any]) -> Iterator[str]:
    """What moves in time beside a phase that follows another one, and does not go on with its time."""
    second = block.motion.phase
    for link in blocks_of_kind(block.model(), LinkData) if second is not None else ():
        first = link.first
        if link.second is not second or first is second:
            continue
        if _goes_on(first, second):
            beside = [other for other in blocks if other.motion.phase is second]
            yield from _loose_start(first, second, block, beside)
            continue
        before = [other for other in blocks if other.motion.phase is first]
        for name, body, after in _timed(block):
            yield from _passage(first, second, block, name, body, after, before)


def _goes_on(first: Any, second: Any) -> bool:
    """Whether the second phase starts at the time at which the first one ends, or at one that is to be found."""
    end, start = first.time_at(first.final_time), second.time_at(second.initial_time)
    if _is_open(start):
        return True
    return not _is_open(end) and abs(float(value(end)) - float(value(start))) <= NEGLIGIBLE * max(
        1.0, abs(float(value(end)))
    )


def _loose_start(first: Any, second: Any, block: Any, beside: Iterable[Any]) -> Iterator[str]:
    """Where a phase that follows another may start at any time: a solver then chooses where obstacles are."""
    names = [name for name, _, _ in _timed(block)] if is_plain_variable(second.start) else []
    if not names:
        return
    # The phase and its blocks read the start themselves, where poses depend on time.
    own = [second, *beside]
    rows = block.model().component_data_objects(Constraint, active=True, descend_into=True)
    others = (row for row in rows if not any(_is_within(row, block) for block in own))
    read = (variable for row in others for variable in variables_in(row.body, include_fixed=False))
    if not any(variable is second.start for variable in read):
        yield (
            f"phase '{second.name}' follows '{first.name}', but nothing ties its start to the end of that phase, and "
            f"{', '.join(map(repr, names))} move(s) with its time. Give it start={first.name}."
        )


def _is_within(row: Any, block: Any) -> bool:
    home = row.parent_block()
    while home is not None and home is not block:
        home = home.parent_block()
    return home is block


def _warn_of_scaled_set(model: Any, block: Any) -> None:
    """Tell where an index from 0 to 1 is most likely a part of a duration that is to be found."""
    domain = block.record.points
    if getattr(domain, "ctype", None) is not ContinuousSet or (domain.first(), domain.last()) != (0, 1):
        return
    for name, _, reading in _timed(block):
        scale = _common_scale(model, domain)
        if scale is not None and not any(variable is scale for variable in reading.variables):
            logger.warning(
                "obstacle avoidance '%s': '%s' moves with the index of '%s', from 0 to 1, and '%s' is in all equations "
                "along it. If that is the duration, write %s * t in the pose rule in place of t.",
                block.name,
                name,
                domain.name,
                scale.name,
                scale.name,
            )


def _common_scale(model: Any, domain: Any) -> Any:
    """A scalar variable that all equations along a set read which read any: most likely a duration."""
    common: dict[int, Any] | None = None
    for rows in model.component_objects(Constraint, active=True, descend_into=True):
        if not rows.is_indexed() or not any(subset is domain for subset in rows.index_set().subsets()):
            continue
        equalities = [row for row in rows.values() if row.active and row.equality]
        read = [list(variables_in(row.body, include_fixed=False)) for row in equalities]
        for variables in read:
            scalars = {id(v): v for v in variables if not v.parent_component().is_indexed()}
            if scalars:  # the equations that pyomo.dae adds have none
                common = scalars if common is None else {key: v for key, v in common.items() if key in scalars}
    return next(iter((common or {}).values()), None)


def _is_open(time: Any) -> bool:
    """Whether a time is to be found."""
    return not isinstance(time, Real) and next(iter(variables_in(time, include_fixed=False)), None) is not None


def _timed(block: Any) -> Iterator[tuple[str, Body, PoseReading]]:
    """Bodies of a block whose pose depends on time, and reads nothing that the plan moves."""
    motion = block.motion
    for name, body in block.record.scene.bodies.items():
        if body.pose is not None and motion.intervals:
            reading = PoseReading(motion, body.pose, name)
            if (reading.reads_index or reading.reads_time) and not reading.signals:
                yield name, body, reading


def _passage(
    first: Any, second: Any, block: Any, name: str, body: Body, after: PoseReading, before: Iterable[Any]
) -> Iterator[str]:
    remedy = f"Give '{second.name}' start={first.name}, and write b.time_at(t) in the pose rule"
    if second.parent_component().is_indexed():
        remedy = (
            f"Give the phases '{second.parent_component().name}' a start each, by start=lambda m, k: the phase before, "
            "and write b.time_at(t) in the pose rule"
        )
    fact = f"obstacle avoidance '{block.name}': phase '{second.name}' follows '{first.name}', but its time starts anew"
    there = value(second.time_at(second.initial_time))
    for other in before:
        earlier = other.record.scene.bodies.get(name)
        if earlier is None or earlier.pose is None:
            continue
        jump = _jump(
            other.motion.pose_at_node(earlier.pose, first.final_time, name=name),
            block.motion.pose_at_node(body.pose, second.initial_time, name=name),
        )
        if jump is None or jump <= _LARGEST_JUMP:
            continue
        raise ObstacleError(
            f"{fact} at {there:g}: '{name}' jumps by {jump:.3g} from the end of the one to the start of the other. "
            f"{remedy}."
        )
    if not any(name in other.record.scene.bodies for other in before):
        yield f"{fact} at {there:g}, and '{name}' moves with it. If that is not meant: {remedy}."


def warn_of_clocks_that_start_anew(blocks: Iterable[Any]) -> None:
    """Tell which obstacles a receding horizon puts back to where they were: those that know no time but the phase's."""
    for block in blocks:
        for name, _, reading in _timed(block):
            if not reading.parameters:
                logger.warning(
                    "obstacle avoidance '%s': '%s' moves with the time of its phase, which starts anew at each step of "
                    "a receding horizon. Add what has passed, a mutable Param that you set before each step: "
                    "b.time_at(t) + b.now.",
                    block.name,
                    name,
                )


def _jump(before: Pose, after: Pose) -> float | None:
    try:
        numbers = [np.concatenate([part.ravel() for part in pose.numbers()]) for pose in (before, after)]
    except ValueError:
        return None
    return float(np.abs(numbers[0] - numbers[1]).max())
