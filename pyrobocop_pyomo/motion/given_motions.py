"""Motions that come from no model: paths sampled at times, and trajectories."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Set
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, planar_pose
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.rules.slots import Item
from pyrobocop_pyomo.trajectories import Trajectory

from .interpolation import STATES_ONLY, CollocationInterpolation, NodalInterpolation, item_at
from .motion import Motion
from .sampled_paths import SampledPath

# Names with blanks: those of a user's signals have none.
_TIMES = "times of the path"
_CONSTANT = "constant "
BETWEEN_POINTS = "straight lines between the points, on which bodies turn at constant rates"


@dataclass(frozen=True, eq=False)
class PathInterpolation(NodalInterpolation):
    """Sampled paths: linear between the points, but for what is constant on each interval and jumps at its end.

    Attributes
    ----------
    model : Block or None
        That of the paths.
    angles : mapping of name to mapping of float to float
        By the name of a turn, the angle of each interval by its start.
    """

    model: Any = None
    angles: Mapping[str, Mapping[float, float]] = field(default_factory=dict)

    def polynomial(self, signal: Item, interval: int) -> list[Any]:
        """Values at both ends; of a constant that of the interval, of a turn zero and the angle."""
        start, end = self.support[interval]
        name = signal.component.local_name
        if name.startswith(_CONSTANT):
            return [item_at(signal, start)] * 2
        if name in self.angles:
            return [0.0, self.angles[name][start]]
        return [item_at(signal, start), item_at(signal, end)]

    def polynomial_weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Of the values at both ends."""
        local = np.atleast_1d(np.asarray(fractions, dtype=float))
        return np.column_stack([1.0 - local, local])

    def is_time_of(self, block: Any) -> bool:
        """True for the model of the paths."""
        return block is self.model


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
    model = ConcreteModel(name="path")
    model.add_component(_TIMES, Set(initialize=points, ordered=True))
    model.time_at = _same
    for name, values in (signals or {}).items():
        if not isinstance(name, str) or not name.isidentifier() or hasattr(model, name):
            raise ObstacleError(f"a signal has the name {name!r}, which a pose rule cannot read as block.name[t].")
        _add(model, name, values)
    angles: dict[str, Mapping[float, float]] = {}
    rules = {}
    for number, (name, path) in enumerate(paths.items(), start=1):
        if path.rotations is None:
            rules[name] = _planar_rule(model, number, path)
        else:
            rules[name] = _spatial_rule(model, number, path, angles)
    intervals = tuple(itertools.pairwise(points))
    interpolation = PathInterpolation(
        intervals, intervals, _accept, BETWEEN_POINTS, is_assumed=False, model=model, angles=angles
    )
    return Motion(model, points, interpolation), rules


def _accept(signal: Item) -> None:
    """Everything that a sampled path has is continuous, or a constant of a formula that is."""


def _add(model: Any, name: str, values: Array) -> str:
    times = model.component(_TIMES)
    model.add_component(name, Param(times, initialize=dict(zip(times, values.tolist(), strict=True))))
    return name


def _planar_rule(model: Any, number: int, path: SampledPath) -> Callable[..., Any]:
    assert path.angles is not None
    x, y = (_add(model, f"{axis} {number}", path.positions[:, k]) for k, axis in enumerate("xy"))
    theta = _add(model, f"theta {number}", path.angles)

    def pose(block: Any, t: Any) -> Pose:
        return planar_pose(getattr(block, x)[t], getattr(block, y)[t], getattr(block, theta)[t])

    return pose


def _spatial_rule(
    model: Any, number: int, path: SampledPath, angles_of: dict[str, Mapping[float, float]]
) -> Callable[..., Any]:
    """Rodrigues' formula on each interval: ``R_k (u u' + (I - u u') cos(angle) + [u] sin(angle))``, ``u`` the axis."""
    assert path.rotations is not None
    turns = np.vstack([path.turns(), np.zeros(3)])
    angles = np.linalg.norm(turns, axis=1)
    axes = np.where(angles[:, None] > 0.0, turns / np.where(angles > 0.0, angles, 1.0)[:, None], [0.0, 0.0, 1.0])
    along = axes[:, :, None] * axes[:, None, :]
    crossed = np.cross(axes[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)
    factors = [path.rotations @ along, path.rotations @ (np.eye(3) - along), path.rotations @ crossed]
    position = [_add(model, f"{axis} {number}", path.positions[:, k]) for k, axis in enumerate("xyz")]
    entries = [
        [
            [_add(model, f"{_CONSTANT}{number} {kind} {i}{j}", of[:, i, j]) for kind, of in enumerate(factors)]
            for j in range(3)
        ]
        for i in range(3)
    ]
    turn = _add(model, f"turn {number}", np.zeros(len(angles)))
    angles_of[turn] = dict(zip(path.times.tolist(), angles.tolist(), strict=True))

    def pose(block: Any, t: Any) -> Pose:
        angle = getattr(block, turn)[t]
        cosine, sine = cos(angle), sin(angle)

        def entry(names: list[str]) -> Any:
            still, with_cosine, with_sine = (getattr(block, name)[t] for name in names)
            return still + with_cosine * cosine + with_sine * sine

        rotation = tuple(tuple(entry(names) for names in row) for row in entries)
        return Pose(rotation, tuple(getattr(block, name)[t] for name in position))

    return pose


# -------------------------------------------------------------------------------------------------------- trajectories


class TrajectoryInterpolation(CollocationInterpolation):
    """States of a `Trajectory`, on a model that has its values; time is real time."""

    def __init__(self, trajectory: Trajectory, model: Any) -> None:
        super().__init__(trajectory.grid)
        self.trajectory, self.model = trajectory, model

    @property
    def owner(self) -> str:
        """The trajectory."""
        return f"of trajectory '{self.trajectory.name}'"

    def refuse(self, signal: Item) -> None:
        """Refuse what is no state."""
        if signal.component.local_name not in self.trajectory.states:
            raise ObstacleError(f"'{signal.name}' is no state of trajectory '{self.trajectory.name}'. {STATES_ONLY}")

    def joins_lines(self, signal: Item) -> bool:
        """False: the parameters of the model are the states."""
        return False

    def is_time_of(self, block: Any) -> bool:
        """True for the model that stands for the phase."""
        return block is self.model

    def rates(self, signal: Item) -> Any:
        """Derivative of a state by collocation point; None where the trajectory has none."""
        values = self.trajectory.rates.get(signal.component.local_name)
        return None if values is None else dict(zip(self.grid.points, values.tolist(), strict=True))


def motion_along_trajectory(trajectory: Trajectory) -> Motion:
    """The motion of a trajectory's states, by the polynomials of its scheme; rules read them as of its phase."""
    model = ConcreteModel(name=trajectory.name)
    times, points = tuple(trajectory.grid.times), tuple(trajectory.grid.points)
    for names, index in ((trajectory.states, times), (trajectory.signals, points)):
        for name, values in names.items():
            given = dict(zip(index, values.tolist(), strict=True))
            model.add_component(name, Param(list(index), initialize=given))
    for name, value in trajectory.parameters.items():
        model.add_component(name, Param(initialize=value))
    model.time_at = _same
    return Motion(model, times, TrajectoryInterpolation(trajectory, model))


def _same(t: Any) -> Any:
    """The time of an index of a trajectory: the index itself."""
    return t
