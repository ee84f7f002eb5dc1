"""`verify_motion`: the proof of clearances for any path, without a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.motion import SafetyReport, verify_clearance
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.given_motions import SampledPath, motion_along_paths, motion_along_trajectory, read_path
from pyrobocop_pyomo.numerics.arrays import Array, finite_numbers, increasing_numbers
from pyrobocop_pyomo.trajectories import Trajectory

from .scene import BodyPair, asked_clearances, make_scene, named_bodies

_WHAT = "verify_motion"


def verify_motion(
    path: Any,
    poses: Any = None,
    *,
    body: Any = None,
    bodies: Any = None,
    obstacles: Any = None,
    clearance: Any,
    body_pairs: Any = None,
    exclude: Iterable[BodyPair] = (),
    signals: Mapping[str, Any] | None = None,
    tolerance: float | None = None,
) -> SafetyReport:
    """Prove that bodies keep their clearances along a path of numbers or a trajectory, or find where they do not.

    The proof is that of planned motions: it covers all times, not only those of the poses.

    Parameters
    ----------
    path : array_like of shape (N,), or Trajectory
        Times, increasing, or the trajectory of a phase. ``range(N)`` where only the order of the poses is known.
    poses : array_like, list of Pose, or mapping of name to such
        One pose for each time. In the plane (N, 2) for x, y; (N, 3) for x, y, theta. In space (N, 3) for x, y, z;
        (N, 6) for x, y, z, roll, pitch, yaw. Angles are in radians; from quaternions and matrices `spatial_pose` makes
        a `Pose`. A mapping gives them by the name of a body or of an obstacle that moves.
    body : Polytope, list of Polytope or Body, optional
        The only body, in its own frame; short for ``bodies={"body": body}``.
    bodies : mapping of name to Polytope, list of Polytope or Body, optional
        Those with a pose rule need no poses: ``rule(block, t)`` is a formula of the time ``t``, of `signals`, or along
        a trajectory of its states ``block.x[t]``, as for an `ObstacleAvoidanceBlock`. A `Body` with neither a pose rule
        nor poses rests.
    obstacles : mapping or list, optional
        As for an `ObstacleAvoidanceBlock`: shapes in the world, or bodies that move by a pose rule or by `poses`.
    clearance : float, callable or mapping of body pair to such
        Distance to be kept, > 0; a rule ``rule(block, t)`` where it changes in time.
    body_pairs, exclude
        As for an `ObstacleAvoidanceBlock`.
    signals : mapping of name to array_like of shape (N,), optional
        What pose rules read as ``block.name[t]``, linear between the times: the joints of an arm, for example.
    tolerance
        As for `verify_clearance`.

    Returns
    -------
    SafetyReport
        About this motion: between two poses the origin of a body's frame moves on a straight line, and the body turns
        at a constant rate and by less than half a turn, in space about a constant axis; also where its heading steps
        from pi to -pi. Along a trajectory: the polynomials of its states;
        ``safe`` is None where they keep clear, since a trajectory has no equations to follow. The first line of the
        report says which motion it is. What a robot does that follows the poses in another way is not known.

    Raises
    ------
    ObstacleError
        Naming the body and the row, where poses or times do not fit, before anything is proven.
    """
    given = {"body": body} if bodies is None else bodies
    if (body is None) == (bodies is None):
        raise ObstacleError(f"{_WHAT}: give either body=shape, or bodies={{name: shape}}.")
    single = {"obstacle": obstacles} if isinstance(obstacles, (Polytope, Body)) else obstacles
    moving, beside = named_bodies(_WHAT, "bodies", "body", given), named_bodies(_WHAT, "obstacles", "obstacle", single)
    by_name = _poses_by_name(poses, moving)
    if isinstance(path, Trajectory):
        if by_name or signals:
            raise ObstacleError(
                f"{_WHAT}: both a trajectory and poses or signals are given. Give "
                "bodies={name: Body(shape, pose=rule)}, with rule(b, t) reading the trajectory's states, such as "
                "planar_pose(b.x[t], b.y[t])."
            )
        motion = motion_along_trajectory(path)
    else:
        if hasattr(path, "ctype") or hasattr(path, "time_at"):
            raise ObstacleError(
                f"{_WHAT}: '{path.name}' is part of a model. Give a phase's trajectory, phase.trajectory(), and one "
                "call for each phase; or an array of times and poses."
            )
        times = increasing_numbers(path, f"{_WHAT}: the times", ObstacleError)
        paths = {name: _path_of(name, rows, times, {**beside, **moving}) for name, rows in by_name.items()}
        values = {name: _signal(name, of, times) for name, of in (signals or {}).items()}
        motion, rules = motion_along_paths(times, paths, values)
        for name, rule in rules.items():
            holder = moving if name in moving else beside
            holder[name] = Body(holder[name].shape, rule)
    for name, of in moving.items():
        # A Body without pose rule rests on purpose, like the links of a robot that no joint moves.
        if not of.moves and not (isinstance(given, Mapping) and isinstance(given[name], Body)):
            raise ObstacleError(
                f"{_WHAT}: '{name}' has neither poses nor a pose rule. Give poses={{'{name}': ...}}; what rests "
                "belongs to obstacles=."
            )
    scene = make_scene(_WHAT, bodies=moving, obstacles=beside, body_pairs=body_pairs, exclude=tuple(exclude))
    clearances = asked_clearances(_WHAT, scene.clearances, scene.bodies, clearance)
    return verify_clearance(motion, scene.bodies, clearances, tolerance=tolerance)


def _signal(name: str, given: Any, times: Array) -> Array:
    values = finite_numbers(given, f"{_WHAT}: the signal '{name}'", ObstacleError)
    if values.shape != times.shape:
        raise ObstacleError(
            f"{_WHAT}: the signal '{name}' has the shape {values.shape}; expected one for each of {len(times)} times."
        )
    return values


def _poses_by_name(poses: Any, bodies: Mapping[str, Any]) -> dict[str, Any]:
    if poses is None:
        return {}
    if isinstance(poses, Mapping):
        return dict(poses)
    if len(bodies) > 1:
        raise ObstacleError(
            f"{_WHAT}: one list of poses for {len(bodies)} bodies. Give a dict: "
            f"poses={{{', '.join(f'{name!r}: ...' for name in bodies)}}}."
        )
    return {next(iter(bodies)): poses}


def _path_of(name: str, given: Any, times: Array, everybody: Mapping[str, Body]) -> SampledPath:
    if name not in everybody:
        listed = ", ".join(f"'{known}'" for known in everybody)
        raise ObstacleError(f"{_WHAT}: poses= names '{name}', which is not among {listed}.")
    shaped = everybody[name]
    if shaped.moves:
        raise ObstacleError(f"{_WHAT}: '{name}' has a pose rule and poses. Give one of them.")
    return read_path(given, times, shaped.dimension, name)
