"""Checks before a solve: of pose rules while they are stated, of the clocks they run on, of poses and clearances.

A pose rule gets an index ``t``, or the time of its phase. A wrong clock makes a plan that is safe among obstacles that
are somewhere else. What a rule reads, its template says.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Iterator, Mapping
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, check_pose
from pyrobocop_pyomo.geometry.poses import LARGEST_USUAL_ANGLE
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData, blocks_of_kind
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.row_violations import constraint_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.moving_shapes import moving_shapes, required_clearance
from pyrobocop_pyomo.motion.rules_along_motion import clearance_text, is_clearance_rule, pose_along
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.templates.slots import Always, Clock, Item, Slot, Time, is_on_indices

from .avoidance_record import MotionSegment, Snapshot, fixed_times, variables_of
from .broad_phase import swept_distances
from .scene import lower_bound_of_clearance

LOGGER = logging.getLogger(__name__)

# Smallest ratio of a clearance and the tolerance of rows that still tells clear from touching.
TOLERANCES_PER_CLEARANCE = 100.0
# Equations of motion add up about ten coordinates with weights of about ten.
ROUNDING_PER_TOLERANCE = 0.02

# ------------------------------------------------------------------------------------------ rules that are being stated


def check_rules(label: str, motion: Motion, bodies: Mapping[str, Body]) -> None:
    """Check the pose rules of a block that is being stated.

    Parameters
    ----------
    label : str
        Name of the block in messages.
    motion : Motion
    bodies : mapping of name to Body

    Raises
    ------
    ObstacleError
        Naming the body: its rule cannot be asked between the nodes, goes by values, turns a shape without end, or is
        on the index of a phase where that is no time.
    """
    for name, body in bodies.items():
        if body.pose is None:
            continue
        formulas = pose_along(motion, body.pose, name).followed(early=True)
        if not formulas.slots:
            LOGGER.warning(
                "%s: the pose of '%s' reads neither a variable nor time: it stands still. If it is meant to rest, give "
                "shape.placed(pose) without a rule; if not, read b.x[t], t or b.time_at(t) in the rule.",
                label,
                name,
            )
        endless = [part.name for part in body.parts if not part.is_bounded]
        moving = formulas.depending(lambda slot: not isinstance(slot, Always))
        if endless and moving.rotation != formulas.depending(lambda slot: False).rotation:
            raise ObstacleError(
                f"{label}: '{name}' turns, and its shape '{endless[0]}' has no end: far away it moves at any speed, so "
                "that no clearance can be proven. Cut the shape to what can be reached, or leave its rotation constant."
            )
        phase, reads_index = motion.phase, any(isinstance(slot, Time) for slot in formulas.slots)
        if reads_index and phase is not None and phase.has_normalised_time and not is_on_indices(motion.block):
            raise ObstacleError(
                f"{label}: the pose of '{name}' depends on t, which on phase '{phase.name}' runs from 0 to 1 and is no "
                "time, because its start, its duration or its elements are to be found. Write b.time_at(t) in place of "
                f"t, where b is '{phase.name}'; for a path that takes as long as the phase does, "
                "(b.time_at(t) - b.start) / b.duration."
            )


def _timed(block: Any) -> Iterator[tuple[str, Body, list[Slot]]]:
    """Bodies of a block whose pose depends on time and reads nothing that the plan moves, with what it reads."""
    motion = block.motion
    for name, body in block.record.scene.bodies.items():
        if body.pose is not None:
            slots = pose_along(motion, body.pose, name).followed(early=True).slots
            kinds = set(map(type, slots))
            if kinds & {Time, Clock} and not any(issubclass(kind, Item) for kind in kinds):
                yield name, body, slots


# ------------------------------------------------------------------------------------------- from one phase to the next


def check_clocks(blocks: Collection[Any]) -> None:
    """Check that what moves in time goes on where one phase follows another.

    Parameters
    ----------
    blocks : collection of ObstacleAvoidanceBlockData
        All of a model.

    Raises
    ------
    ObstacleError
        Where the clock of a phase that follows another starts anew and an obstacle of both jumps: naming it, both
        phases, and by how much.
    """
    for block in blocks:
        for doubt in _doubts(block, blocks):
            LOGGER.warning("%s", doubt)


def doubtful_clock(block: Any) -> str:
    """Why it is not known when the obstacles of a block are where, in words; empty where it is."""
    try:
        return next(_doubts(block, blocks_of_kind(block.model(), type(block))), "")
    except ObstacleError as error:
        return str(error)


def _doubts(block: Any, blocks: Collection[Any]) -> Iterator[str]:
    """What moves in time beside a phase that follows another one, and does not go on with its time."""
    second = block.motion.phase
    links = [] if second is None else [of for of in blocks_of_kind(block.model(), LinkData) if of.second is second]
    timed = list(_timed(block)) if links else []
    for first in (link.first for link in links if timed and link.first is not second):
        if _goes_on(first, second):
            if is_plain_variable(second.start) and not _is_tied(second.start):
                yield (
                    f"phase '{second.name}' follows '{first.name}', but nothing ties its start to the end of that "
                    f"phase, and {', '.join(repr(name) for name, _, _ in timed)} move(s) with its time. Give it "
                    f"start={first.name}."
                )
            continue
        before = [other for other in blocks if other.motion.phase is first]
        for name, body, _ in timed:
            yield from _passage(first, second, block, name, body, before)


def _goes_on(first: Any, second: Any) -> bool:
    """Whether the second phase starts at the time at which the first one ends, or at one that is to be found."""
    end, start = first.time_at(first.final_time), second.time_at(second.initial_time)
    if _is_open(start):
        return True
    return not _is_open(end) and abs(float(value(end)) - float(value(start))) <= NEGLIGIBLE * max(
        1.0, abs(float(value(end)))
    )


def _is_open(time: Any) -> bool:
    """Whether a time is to be found."""
    return not isinstance(time, Real) and next(iter(variables_in(time, include_fixed=False)), None) is not None


def _is_tied(start: Any) -> bool:
    """Whether rows say anything of a start, other than rows of blocks that go by it."""
    return any(
        variable is start
        for row in start.model().component_data_objects(Constraint, active=True, descend_into=True)
        if isinstance(row.parent_block(), LinkData) or not isinstance(row.parent_block(), BuiltBlockData)
        for variable in variables_in(row.body, include_fixed=False)
    )


def _passage(first: Any, second: Any, block: Any, name: str, body: Body, before: Iterable[Any]) -> Iterator[str]:
    remedy = (
        f"Give '{second.name}' start={first.name} (phases by an index: start=lambda m, k: the phase before), and write "
        "b.time_at(t) in the pose rule"
    )
    fact = (
        f"obstacle avoidance '{block.name}': phase '{second.name}' follows '{first.name}', but its time starts anew at "
        f"{value(second.time_at(second.initial_time)):g}"
    )
    for other in before:
        earlier = other.record.scene.bodies.get(name)
        if earlier is None or earlier.pose is None:
            continue
        poses = [
            other.motion.pose_at_node(earlier.pose, first.final_time, name=name),
            block.motion.pose_at_node(body.pose, second.initial_time, name=name),
        ]
        entries = np.array([[value(entry, exception=False) for entry in pose.entries] for pose in poses], dtype=float)
        jump = float(np.abs(entries[0] - entries[1]).max())  # NaN where something has no value yet
        if jump > NEGLIGIBLE * max(1.0, float(np.abs(entries).max())):
            raise ObstacleError(
                f"{fact}: '{name}' jumps by {jump:.3g} from the end of the one to the start of the other. {remedy}."
            )
    if not any(name in other.record.scene.bodies for other in before):
        yield f"{fact}, and '{name}' moves with it. If that is not meant: {remedy}."


def warn_of_clocks_that_start_anew(blocks: Iterable[Any]) -> None:
    """Tell which obstacles a receding horizon puts back to where they were: those that know no time but the phase's."""
    for block in blocks:
        for name, _, slots in _timed(block):
            without_time = [slot.component for slot in slots if isinstance(slot, Always)]
            if not any(True for component in without_time for _ in identify_mutable_parameters(component)):
                LOGGER.warning(
                    "obstacle avoidance '%s': '%s' moves with the time of its phase, which starts anew at each step of "
                    "a receding horizon. Add what has passed, a mutable Param that you set before each step: "
                    "b.time_at(t) + b.now.",
                    block.name,
                    name,
                )


# ------------------------------------------------------------------------------------------------ poses and clearances


def check_poses(snapshot: Snapshot, motion: Motion) -> None:
    """Check that every pose is a rotation and a translation at the current values.

    Poses between the nodes, where separations were split, are not judged: a quaternion of length one at the nodes is
    shorter between them, and the proof knows what that means.

    Raises
    ------
    ObstacleError
        Naming the body and the time.
    """
    in_degrees: set[str] = set()
    nodes = {*motion.points, *motion.nodes}
    for (body, time), pose in snapshot.record.poses.items():
        if time not in nodes:
            continue
        snapshot.pose(body, time)
        try:
            # One warning about angles per body is enough.
            check_pose(Pose(pose.rotation, pose.translation) if body in in_degrees else pose, body)
            if any(abs(value(angle)) > LARGEST_USUAL_ANGLE for angle in pose.angles):
                in_degrees.add(body)
        except ObstacleError as error:
            raise ObstacleError(f"{snapshot.what}: at {time}, {error}") from None


def check_fixed_poses(snapshot: Snapshot) -> None:
    """Check that no body pair is closer than its clearance where both poses are fixed, which no plan could change.

    Raises
    ------
    ObstacleError
        Naming both bodies, the time and the clearance that is available there.
    """
    record, scene = snapshot.record, snapshot.record.scene
    fixed = {name: fixed_times(record.poses, name) for name, body in scene.bodies.items() if body.moves}
    places: dict[MotionSegment, float] = {}
    for first, second in scene.part_pairs():
        moving = [fixed[part.body] for part in (first, second) if part.body in fixed]
        for time in (time for time in moving[0] if time in moving[-1]):
            place = MotionSegment(first.name, second.name, None, (time,))
            places[place] = lower_bound_of_clearance(record.clearance_at((first.body, second.body), time))
    distances, _ = swept_distances(snapshot, list(places))
    for (place, clearance), available in zip(places.items(), distances.tolist(), strict=True):
        time, size = place.times[0], float(np.abs(snapshot.placed_pair(place)[0].bounding_box).max())
        if available < clearance - NEGLIGIBLE * max(1.0, size):
            if available > 0:
                distance_text, remedy = f"only {available:.6g} apart", f"Ask for less than {available:.6g}, or move"
            else:
                distance_text, remedy = f"{-available:.6g} into each other", "Move"
            raise ObstacleError(
                f"{snapshot.what}: '{place.first}' and '{place.second}' are {distance_text} at t = {time}, where "
                f"both poses are fixed, but the clearance is {clearance:g}. {remedy} the fixed pose."
            )


def check_block(block: Any, tolerance: float) -> None:
    """Check an avoidance block before a solve.

    Its clearances have to be well above the tolerance of rows, `verify` has to be able to follow its poses between the
    nodes, and coordinates must be small enough to tell what rows ask for from rounding.

    Raises
    ------
    ObstacleError
        Naming the block, the body or the body pair, and what can be told apart.
    """
    record, motion = block.record, block.motion
    snapshot = Snapshot(record, f"obstacle avoidance '{block.name}'")
    for pair in record.clearances:
        least = min(record.clearance_values(pair))
        if np.isnan(least):
            raise ObstacleError(
                f"{snapshot.what}: {clearance_text(pair)} has no value. Give its parameters values, and its variables "
                "an initial guess."
            )
        if least < TOLERANCES_PER_CLEARANCE * tolerance:
            raise ObstacleError(
                f"{snapshot.what}: {clearance_text(pair)} is {least:g}, less than {TOLERANCES_PER_CLEARANCE:g} times "
                f"the {tolerance:g} that constraints may be violated by. Choose a unit of length in which the "
                "clearance is a larger number, or a smaller one of tolerances={'feasibility': ...}."
            )
    farthest = {place: float(np.abs(snapshot.pose(*place)[1]).max()) for place in record.poses}
    moving_shapes(motion, {name: record.scene.bodies[name] for pair in record.clearances for name in pair})
    for pair, clearance in record.clearances.items():
        if is_clearance_rule(clearance):
            required_clearance(motion, clearance, pair)
    for (body, time), coordinate in farthest.items():
        if time is not None and np.spacing(coordinate) > tolerance * ROUNDING_PER_TOLERANCE:
            raise ObstacleError(
                f"{snapshot.what}: '{body}' is at the coordinate {coordinate:.6g} at {time}, where numbers are "
                f"{np.spacing(coordinate):.2g} apart: rows cannot hold to {tolerance:g}. Move the origin near the "
                "start: subtract it from the poses and from all shapes, with as many digits as they are given with."
            )


def check_region(region: Any, tolerance: float) -> None:
    """Check a `Containment` before a solve: its fixed poses are inside, and `verify` can follow those with values.

    Raises
    ------
    ObstacleError
        Naming the containment, the side, the time and by how much the body is beyond it; or why its pose cannot be
        followed.
    """
    record, motion = region.record, region.motion
    fixed = fixed_times(record.poses, "body")
    beyond = {
        (time, side): constraint_violation(row) for (time, _, side), row in region.inside.items() if time in fixed
    }
    worst = max(beyond, key=lambda place: beyond[place], default=None)
    if worst is not None and beyond[worst] > tolerance:
        time, side = worst
        raise ObstacleError(
            f"containment '{region.name}': at t = {time}, where the pose is fixed, the body is {beyond[worst]:.6g} "
            f"beyond side {side + 1} of the region, with the clearance of {value(region.clearance):g}. Move the fixed "
            "pose, or ask for a larger region."
        )
    if has_values(record):
        moving_shapes(motion, {"body": record.scene.bodies["body"]})


def has_values(record: Any) -> bool:
    """True when every variable that a pose reads has a value."""
    return all(variable.value is not None for pose in record.poses.values() for variable in variables_of(pose))
