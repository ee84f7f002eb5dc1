"""`verify_motion`: the proof of clearances for any path, without a model.

Motions that come from no model: paths sampled at times, read from arrays, and trajectories.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose, check_pose, planar_pose, spatial_pose
from pyrobocop_pyomo.motion import SafetyReport, verify_clearance
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import STATES_ONLY, Motion, Nodes, intervals_of_grid
from pyrobocop_pyomo.numerics.arrays import Array, finite_numbers, increasing_numbers
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.templates.slots import Item
from pyrobocop_pyomo.trajectories import Trajectory

from .scene import BodyPair, make_scene, named_bodies, required_clearances

# -------------------------------------------------------------------------------------- motions that come from no model


BETWEEN_POINTS = "straight lines between the points, on which bodies turn at constant rates"
# A turn this close to half a turn has no shorter way.
_ROTATION_ERROR = 1e-6
_SHAPES = {
    2: "(N, 2) for x, y; (N, 3) for x, y, theta; or a list of Pose",
    3: "(N, 3) for x, y, z; (N, 6) for x, y, z, roll, pitch, yaw; or a list of Pose",
}


@dataclass(frozen=True, eq=False)
class SampledPath:
    """Poses at times. In between the reference point moves on straight lines, and the body turns at constant rates.

    Attributes
    ----------
    positions : array, shape (N, d)
    rotations : array, shape (N - 1, 3, 3)
        From which the body turns in each interval.
    axes : array, shape (N - 1, 3)
        About which it turns, in its own frame; in the plane the z axis.
    angles : array, shape (N - 1, 2)
        By how much at both ends, the shorter way.
    """

    positions: Array
    rotations: Array
    axes: Array
    angles: Array


def read_path(given: Any, times: Array, dimension: int, name: str) -> SampledPath:
    """The poses of one body at given times.

    Parameters
    ----------
    given : array_like or list of Pose
        One pose per time, in one of the forms that `verify_motion` describes.
    times : array, shape (N,)
    dimension : int
        Of the body.
    name : str
        Of the body, for messages.

    Raises
    ------
    ObstacleError
        Naming the body and the row.
    """
    label = f"the poses of '{name}'"
    poses = _poses(given, dimension, name, label)
    if len(poses) != len(times):
        raise ObstacleError(f"{label}: {len(poses)} poses for {len(times)} times; give one pose for each time.")
    rotations, positions = (np.array(of) for of in zip(*(pose.numbers() for pose in poses), strict=True))
    path = _planar(positions, rotations) if dimension == 2 else _spatial(positions, rotations)
    half = np.flatnonzero(np.abs(np.diff(path.angles, axis=1)) >= np.pi - _ROTATION_ERROR)
    if len(half):
        raise ObstacleError(
            f"{label}: from row {half[0]} to row {half[0] + 1} the body turns by half a turn, and both ways are "
            "equally short. Give poses in between."
        )
    return path


def _poses(given: Any, dimension: int, name: str, label: str) -> Sequence[Pose]:
    if isinstance(given, Sequence) and len(given) and all(isinstance(pose, Pose) for pose in given):
        for k, pose in enumerate(given):
            if pose.dimension != dimension:
                raise ObstacleError(f"{label}: row {k} is a pose in {pose.dimension} dimensions.")
            check_pose(pose, f"{name}, row {k}")
        return given
    rows = finite_numbers(given, label, ObstacleError)
    if rows.ndim != 2 or rows.shape[1] not in (dimension, dimension * (dimension + 1) // 2):
        raise ObstacleError(f"{label}: an array of shape {rows.shape}; expected {_SHAPES[dimension]}.")
    if dimension == 2:
        return [planar_pose(*row) for row in rows.tolist()]
    return [spatial_pose(row[:3], euler=row[3:] or (0.0, 0.0, 0.0)) for row in rows.tolist()]


def _planar(positions: Array, rotations: Array) -> SampledPath:
    angles = np.unwrap(np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))
    ends = np.column_stack([angles[:-1], angles[1:]])
    return SampledPath(positions, np.tile(np.eye(3), (len(ends), 1, 1)), np.tile([0.0, 0.0, 1.0], (len(ends), 1)), ends)


def _spatial(positions: Array, rotations: Array) -> SampledPath:
    between = rotations[:-1].transpose(0, 2, 1) @ rotations[1:]
    turns = scipy.spatial.transform.Rotation.from_matrix(between).as_rotvec()
    angles = np.linalg.norm(turns, axis=1)
    axes = np.where(angles[:, None] > 0.0, turns / np.where(angles > 0.0, angles, 1.0)[:, None], [0.0, 0.0, 1.0])
    return SampledPath(positions, rotations[:-1], axes, np.column_stack([np.zeros(len(angles)), angles]))


# ------------------------------------------------------------------------------------------------------------ motions


def _model_in_real_time(name: str) -> ConcreteModel:
    """A model for parameters over time, whose indices are the times."""
    model = ConcreteModel(name=name)
    model.time_at = _same
    return model


def _given_motion(
    model: Any, points: tuple[Any, ...], intervals: Nodes, samples: Mapping[str, Array], words: str, **facts: Any
) -> Motion:
    """A motion of parameters by polynomials that are given as numbers; time is real time.

    Parameters
    ----------
    model : ConcreteModel
        Of parameters, with their values at the points.
    points, intervals
        As for `Motion`.
    samples : mapping of name to array, shape (intervals, k)
        By the name of a parameter: values at ``k`` evenly spaced fractions of each interval.
    words : str
        What the motion is.
    **facts
        Of `Motion`.
    """

    fractions = {name: np.linspace(0.0, 1.0, of.shape[1]) for name, of in samples.items()}

    def polynomial(signal: Item, interval: int) -> tuple[Array, list[Any]]:
        name = signal.component.local_name
        return fractions[name], samples[name][interval].tolist()

    def refuse(signal: Item, early: bool) -> None:
        if signal.component.local_name not in samples:
            raise ObstacleError(f"'{signal.name}' is no state of trajectory '{model.name}'. {STATES_ONLY}")

    return Motion(model, points, intervals, words, polynomial, refuse, **facts)


def motion_along_paths(
    times: Array, paths: Mapping[str, SampledPath], signals: Mapping[str, Array] | None = None
) -> tuple[Motion, dict[str, Callable[..., Any]]]:
    """The motion of bodies along sampled paths, and the pose rule of each.

    Parameters
    ----------
    times : array, shape (N,)
        Of all paths.
    paths : mapping of name of the body to SampledPath
        May be none: poses can be formulas of ``t`` alone.
    signals : mapping of name to array, shape (N,)
        What rules read as ``block.name[t]``; linear between the times.

    Raises
    ------
    ObstacleError
        When the name of a signal is none, or names something else.
    """
    points = tuple(times.tolist())
    model = _model_in_real_time("path")
    samples: dict[str, Array] = {}
    for name, values in (signals or {}).items():
        if not isinstance(name, str) or not name.isidentifier() or hasattr(model, name):
            raise ObstacleError(f"a signal has the name {name!r}, which a pose rule cannot read as block.name[t].")
        samples[name] = _line(values)
    rules = {}
    for number, (name, path) in enumerate(paths.items(), start=1):
        # Names with blanks, which a user's signals do not have. Most of what turns a body in the plane is a number.
        of_path = _samples_of(path)
        numbers = {of: float(within[0, 0]) for of, within in of_path.items() if np.ptp(within) == 0.0}
        samples |= {f"{of} {number}": within for of, within in of_path.items() if of not in numbers}
        rules[name] = _pose_rule(path.positions.shape[1], number, numbers)
    for name, within in samples.items():
        values = np.append(within[:, 0], within[-1, -1])
        model.add_component(name, Param(points, initialize=dict(zip(points, values.tolist(), strict=True))))
    return _given_motion(model, points, tuple(pairwise(points)), samples, BETWEEN_POINTS), rules


def _line(values: Array) -> Array:
    """What is linear from each time to the next, at both ends of each interval."""
    return np.column_stack([values[:-1], values[1:]])


def _samples_of(path: SampledPath) -> dict[str, Array]:
    """Rodrigues' formula on each interval: ``R (u u' + (I - u u') cos(angle) + [u] sin(angle))``, ``u`` the axis."""
    along = path.axes[:, :, None] * path.axes[:, None, :]
    crossed = np.cross(path.axes[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)
    factors = {"still": along, "cosine": np.eye(3) - along, "sine": crossed}
    lines = {axis: _line(column) for axis, column in zip("xyz", path.positions.T, strict=False)}
    dimensions = range(path.positions.shape[1])
    constant = {
        f"{kind} {i}{j}": (path.rotations @ factor)[:, i, j, None]
        for (kind, factor), i, j in product(factors.items(), dimensions, dimensions)
    }
    return {**lines, "turn": path.angles, **constant}


def _pose_rule(dimension: int, number: int, constant: Mapping[str, float]) -> Callable[..., Any]:
    """The pose of the body with a number, of what `_samples_of` has for its path."""

    def pose(block: Any, t: Any) -> Pose:
        def at(name: str) -> Any:
            return constant[name] if name in constant else getattr(block, f"{name} {number}")[t]

        cosine, sine = cos(at("turn")), sin(at("turn"))
        rotation = tuple(
            tuple(
                at(f"still {i}{j}") + at(f"cosine {i}{j}") * cosine + at(f"sine {i}{j}") * sine
                for j in range(dimension)
            )
            for i in range(dimension)
        )
        return Pose(rotation, tuple(map(at, "xyz"[:dimension])))

    return pose


# -------------------------------------------------------------------------------------------------------- trajectories


def motion_along_trajectory(trajectory: Trajectory) -> Motion:
    """The motion of a trajectory's states, by the polynomials of its scheme; rules read them as of its phase."""
    model = _model_in_real_time(trajectory.name)
    grid = trajectory.grid
    times, points = tuple(grid.times), tuple(grid.points)
    for names, index in ((trajectory.states, times), (trajectory.signals, points)):
        for name, values in names.items():
            given = dict(zip(index, values.tolist(), strict=True))
            model.add_component(name, Param(list(index), initialize=given))
    for name, value in trajectory.parameters.items():
        model.add_component(name, Param(initialize=value))
    every = trajectory.element_polynomials(np.linspace(0.0, 1.0, grid.scheme.stages + 2))
    samples = {name: every[name] for name in trajectory.states}
    words = f"the polynomials of the states of trajectory '{trajectory.name}' ({grid.scheme.name})"
    intervals = intervals_of_grid(grid)
    return _given_motion(model, times, intervals, samples, words, has_equations=False)


def _same(t: Any) -> Any:
    """The time of an index of a trajectory: the index itself."""
    return t


# -------------------------------------------------------------------------------------------------- motion verification


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

    The proof is the same as for planned motions: it covers all times, not only the times of the poses.

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
    clearances = required_clearances(_WHAT, scene.clearances, scene.bodies, clearance)
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
