"""Checks before a solve: poses, fixed poses, clearances, motions that can be followed."""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable, Iterable
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, check_pose, distance_of_points
from pyrobocop_pyomo.geometry.poses import LARGEST_USUAL_ANGLE
from pyrobocop_pyomo.modeling.row_violations import constraint_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import values_restored
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.moving_shapes import moving_shapes
from pyrobocop_pyomo.motion.required_clearance import clearance_text, required_clearance
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .avoidance_record import AvoidanceRecord
from .clearances import ClearanceRule, clearance_values
from .snapshot import Snapshot, variables_of

LOGGER = logging.getLogger(__name__)

# Smallest ratio of a clearance and the tolerance of rows that still tells clear from touching.
TOLERANCES_PER_CLEARANCE = 100.0
# Equations of motion add up about ten coordinates with weights of about ten.
ROUNDING_PER_TOLERANCE = 0.02


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


def check_fixed_poses(snapshot: Snapshot, clearance_at: Callable[[tuple[str, str], Hashable], float]) -> None:
    """Check that no body pair is closer than its clearance where both poses are fixed, which no plan could change.

    Parameters
    ----------
    snapshot : Snapshot
    clearance_at : callable
        ``clearance_at(body_pair, time)``: the least that any plan keeps there.

    Raises
    ------
    ObstacleError
        Naming both bodies, the time and the clearance that is available there.
    """
    scene = snapshot.record.scene
    fixed: dict[str, list[Hashable]] = {}
    for (body, time), pose in snapshot.record.poses.items():
        if time is not None and all(variable.fixed for variable in variables_of(pose)):
            fixed.setdefault(body, []).append(time)
    for first, second in scene.part_pairs():
        moving = [part.body for part in (first, second) if not scene.is_static(part.body)]
        times = [time for time in fixed.get(moving[0], ()) if all(time in fixed.get(body, ()) for body in moving)]
        for time in times:
            asked = clearance_at((first.body, second.body), time)
            p, q = snapshot.vertices(first, [time]), snapshot.vertices(second, [time])
            rays = snapshot.rays(first, [time]), snapshot.rays(second, [time])
            if not len(rays[0]) + len(rays[1]):
                apart = np.maximum(q.min(axis=0) - p.max(axis=0), p.min(axis=0) - q.max(axis=0)).max()
                if apart > asked + first.shape.radius + second.shape.radius:
                    continue  # as boxes around most of them are
            near = distance_of_points(p, q, q_rays=rays[1], p_rays=rays[0])
            available = near.distance - first.shape.radius - second.shape.radius
            if available < asked - NEGLIGIBLE * max(1.0, float(np.abs(p).max())):
                if available > 0:
                    distance_text, remedy = f"only {available:.6g} apart", f"Ask for less than {available:.6g}, or move"
                else:
                    distance_text, remedy = f"{-available:.6g} into each other", "Move"
                raise ObstacleError(
                    f"{snapshot.what}: '{first.name}' and '{second.name}' are {distance_text} at t = {time}, where "
                    f"both poses are fixed, but the clearance is {asked:g}. {remedy} the fixed pose."
                )


def check_clearances(block: Any, tolerance: float) -> None:
    """Check that the clearances of a block are well above the tolerance of rows.

    Raises
    ------
    ObstacleError
        Naming the block and the body pair.
    """
    for pair in block.record.asked:
        least = min(clearance_values(block, pair))
        if np.isnan(least):
            raise ObstacleError(
                f"obstacle avoidance '{block.name}': {clearance_text(pair)} has no value. Give its parameters values, "
                "and its variables an initial guess."
            )
        if least < TOLERANCES_PER_CLEARANCE * tolerance:
            raise ObstacleError(
                f"obstacle avoidance '{block.name}': {clearance_text(pair)} is {least:g}, less than "
                f"{TOLERANCES_PER_CLEARANCE:g} times the {tolerance:g} that constraints may be violated by. Choose a "
                "unit of length in which the clearance is a larger number, or a smaller one of "
                "tolerances={'feasibility': ...}."
            )


def check_digits(block: Any, tolerance: float) -> None:
    """Check that coordinates of the bodies that move are small enough to tell what rows ask for from rounding.

    Raises
    ------
    ObstacleError
        Naming the body, its coordinate and what can be told apart there.
    """
    snapshot = Snapshot(block.record, f"obstacle avoidance '{block.name}'")
    for body, time in block.record.poses:
        if time is None:
            continue
        farthest = float(np.abs(snapshot.pose(body, time)[1]).max())
        if np.spacing(farthest) > tolerance * ROUNDING_PER_TOLERANCE:
            raise ObstacleError(
                f"{snapshot.what}: '{body}' is at the coordinate {farthest:.6g} at {time}, where numbers are "
                f"{np.spacing(farthest):.2g} apart: rows cannot hold to {tolerance:g}. Move the origin near the start: "
                "subtract it from the poses and from all shapes, with as many digits as they are given with."
            )


def check_motion(block: Any) -> None:
    """Check before a solve that `verify` can follow all poses between the nodes.

    Raises
    ------
    ObstacleError
        Naming the body whose pose has no value, or cannot be followed.
    """
    scene, motion = block.record.scene, block.motion
    snapshot = Snapshot(block.record, f"obstacle avoidance '{block.name}'")
    for body, time in block.record.poses:
        snapshot.pose(body, time)
    if motion.intervals:
        moving_shapes(motion, {name: scene.bodies[name] for pair in scene.body_pairs for name in pair})
        for pair, asked in block.record.asked.items():
            if isinstance(asked, ClearanceRule):
                required_clearance(motion, asked, pair)


def check_contained_motion(region: Any) -> None:
    """Check the same for a `Containment`, where its poses have values already.

    Raises
    ------
    ObstacleError
        When the pose cannot be followed.
    """
    motion, record = region.motion, region.record
    if motion.intervals and _have_values(record.poses.values()):
        moving_shapes(motion, {"body": record.body})


def check_fixed_inside(region: Any, tolerance: float) -> None:
    """Check that a body is inside its region, up to a tolerance, where its pose is fixed.

    Raises
    ------
    ObstacleError
        Naming the containment, the side, the time and by how much the body is beyond it.
    """
    record = region.record
    fixed = {time for time, pose in record.poses.items() if all(variable.fixed for variable in variables_of(pose))}
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


def has_values(record: AvoidanceRecord) -> bool:
    """True when every variable that a pose reads has a value."""
    return _have_values(record.poses.values())


def _have_values(poses: Iterable[Pose]) -> bool:
    return all(variable.value is not None for pose in poses for variable in variables_of(pose))


def warn_about_quaternions(snapshot: Snapshot, model: Any) -> None:
    """Warn where variables make a rotation at some values only, and no equation keeps them at such values.

    Sines and cosines make a rotation at any angle, a quaternion only at length one. To tell them apart, the variables
    are moved a little.
    """
    constrained: set[frozenset[int]] | None = None
    for body, rotations in _free_rotations(snapshot.record).items():
        if _is_always_a_rotation(*rotations[0]):
            continue
        if constrained is None:
            rows = model.component_data_objects(Constraint, active=True, descend_into=True)
            constrained = {
                frozenset(map(id, variables_in(row.body, include_fixed=False))) for row in rows if row.equality
            }
        # Some schemes have no equations at the ends of elements: one instant with an equation is enough.
        free = (frozenset(id(variable) for variable in read if not variable.fixed) for _, read in rotations)
        if any(variables in constrained for variables in free):
            continue
        LOGGER.warning(
            "%s: the rotation of '%s' is one only while %s have length one, and no equation keeps them so: its shape "
            "would grow or shrink. Add the equation, or normalise the quaternion in the pose rule. Where differential "
            "equations turn the quaternion, add a control that stretches it as well, which the equation determines.",
            snapshot.what,
            body,
            ", ".join(variable.name for variable in rotations[0][1]),
        )


def _free_rotations(record: AvoidanceRecord) -> dict[str, list[tuple[Pose, list[Any]]]]:
    """Poses whose rotation reads a variable that is not fixed, with the variables, by body."""
    rotations: dict[str, list[tuple[Pose, list[Any]]]] = {}
    for (body, time), pose in record.poses.items():
        read = [] if time is None else variables_of(Pose(pose.rotation, (0.0,) * pose.dimension))
        if not all(variable.fixed for variable in read):
            rotations.setdefault(body, []).append((pose, read))
    return rotations


def _is_always_a_rotation(pose: Pose, variables: list[Any]) -> bool:
    """Whether the rotation stays orthonormal when its variables move."""
    with values_restored(variables) as values:
        values.write([1.1 * variable.value + 0.1 for variable in variables])
        rotation, _ = pose.numbers()
    return bool(np.abs(rotation @ rotation.T - np.eye(len(rotation))).max() < NEGLIGIBLE)
