"""Motions that come from no model: paths sampled at times, read from arrays, and trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, check_pose, planar_pose, spatial_pose
from pyrobocop_pyomo.numerics.arrays import Array, finite_numbers
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.templates.slots import Item
from pyrobocop_pyomo.trajectories import Trajectory

from .motion import STATES_ONLY, Motion, Nodes, intervals_of_grid

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
    what = f"the poses of '{name}'"
    poses = _poses(given, dimension, name, what)
    if len(poses) != len(times):
        raise ObstacleError(f"{what}: {len(poses)} poses for {len(times)} times; give one pose for each time.")
    rotations, positions = (np.array(of) for of in zip(*(pose.numbers() for pose in poses), strict=True))
    path = _planar(positions, rotations) if dimension == 2 else _spatial(positions, rotations)
    half = np.flatnonzero(np.abs(np.diff(path.angles, axis=1)) >= np.pi - _ROTATION_ERROR)
    if len(half):
        raise ObstacleError(
            f"{what}: from row {half[0]} to row {half[0] + 1} the body turns by half a turn, and both ways are "
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

    def polynomial(signal: Item, interval: int) -> tuple[Array, list[Any]]:
        values = samples[signal.component.local_name][interval]
        return np.linspace(0.0, 1.0, len(values)), values.tolist()

    return Motion(model, points, intervals, words, polynomial, **facts)


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
        When the name of a signal is none, or is that of something else.
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
        # Names with blanks: those of a user's signals have none.
        samples |= {f"{of} {number}": within for of, within in _samples_of(path).items()}
        rules[name] = _pose_rule(path.positions.shape[1], number)
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


def _pose_rule(dimension: int, number: int) -> Callable[..., Any]:
    """The pose of the body with a number, of what `_samples_of` has for its path."""

    def pose(block: Any, t: Any) -> Pose:
        def at(name: str) -> Any:
            return getattr(block, f"{name} {number}")[t]

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
    samples = trajectory.element_polynomials(np.linspace(0.0, 1.0, grid.scheme.stages + 2))

    def refuse(signal: Item) -> None:
        if signal.component.local_name not in samples:
            raise ObstacleError(f"'{signal.name}' is no state of trajectory '{trajectory.name}'. {STATES_ONLY}")

    words = f"the polynomials of the states of trajectory '{trajectory.name}' ({grid.scheme.name})"
    intervals = intervals_of_grid(grid)
    return _given_motion(model, times, intervals, samples, words, refuse=refuse, has_equations=False)


def _same(t: Any) -> Any:
    """The time of an index of a trajectory: the index itself."""
    return t
