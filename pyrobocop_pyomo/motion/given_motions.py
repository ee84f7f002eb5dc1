"""Motions that come from no model: paths sampled at times, and trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
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
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix
from pyrobocop_pyomo.templates.slots import Item
from pyrobocop_pyomo.trajectories import Trajectory

from .interpolation import STATES_ONLY, intervals_of_grid
from .motion import Motion, Nodes
from .sampled_paths import SampledPath

# A name with blanks: those of a user's signals have none.
_TIMES = "times of the path"
BETWEEN_POINTS = "straight lines between the points, on which bodies turn at constant rates"


@dataclass(frozen=True, eq=False)
class GivenMotion(Motion):
    """Polynomials that are given as numbers, for what a model of parameters has at the nodes; time is real time.

    Attributes
    ----------
    block, points
        As for `Motion`.
    intervals : tuple of tuples
        Nodes of each interval, both ends included.
    samples : mapping of name to array, shape (intervals, k)
        By the name of a parameter: values at ``k`` evenly spaced fractions of each interval.
    description : str
        What the motion is, in words.
    refusal : str
        What is said of a parameter without them.
    has_equations : bool
        False for a trajectory: it was made of equations that are not at hand.
    """

    block: Any
    points: tuple[Any, ...]
    intervals: Nodes
    samples: Mapping[str, Array]
    description: str = BETWEEN_POINTS
    refusal: str = ""
    has_equations: bool = True

    def joins_lines(self, signal: Item) -> bool:
        """False: the parameters of the model are what moves."""
        return False

    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Refuse what has no polynomials."""
        if signal.component.local_name not in self.samples:
            raise ObstacleError(f"'{signal.name}' {self.refusal}")

    def polynomial(self, signal: Item, interval: int) -> list[Any]:
        """The values at evenly spaced fractions."""
        found: list[Any] = self.samples[signal.component.local_name][interval].tolist()
        return found

    def polynomial_weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Lagrange polynomials on these fractions."""
        count = self.samples[signal.component.local_name].shape[1]
        return evaluation_matrix(np.linspace(0.0, 1.0, count), fractions)


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
    samples: dict[str, Array] = {}
    for name, values in (signals or {}).items():
        if not isinstance(name, str) or not name.isidentifier() or hasattr(model, name):
            raise ObstacleError(f"a signal has the name {name!r}, which a pose rule cannot read as block.name[t].")
        _add_line(model, samples, name, values)
    rules = {}
    for number, (name, path) in enumerate(paths.items(), start=1):
        make = _planar_rule if path.rotations is None else _spatial_rule
        rules[name] = make(model, samples, number, path)
    return GivenMotion(model, points, tuple(pairwise(points)), samples), rules


def _add(model: Any, name: str, values: Array) -> str:
    times = model.component(_TIMES)
    model.add_component(name, Param(times, initialize=dict(zip(times, values.tolist(), strict=True))))
    return name


def _add_line(model: Any, samples: dict[str, Array], name: str, values: Array) -> str:
    """What is linear from each time to the next."""
    samples[name] = np.column_stack([values[:-1], values[1:]])
    return _add(model, name, values)


def _planar_rule(model: Any, samples: dict[str, Array], number: int, path: SampledPath) -> Callable[..., Any]:
    assert path.angles is not None
    columns = {"x": path.positions[:, 0], "y": path.positions[:, 1], "theta": path.angles}
    x, y, theta = (_add_line(model, samples, f"{name} {number}", of) for name, of in columns.items())

    def pose(block: Any, t: Any) -> Pose:
        return planar_pose(getattr(block, x)[t], getattr(block, y)[t], getattr(block, theta)[t])

    return pose


def _spatial_rule(model: Any, samples: dict[str, Array], number: int, path: SampledPath) -> Callable[..., Any]:
    """Rodrigues' formula on each interval: ``R_k (u u' + (I - u u') cos(angle) + [u] sin(angle))``, ``u`` the axis."""
    assert path.rotations is not None
    turns = np.vstack([path.turns(), np.zeros(3)])
    angles = np.linalg.norm(turns, axis=1)
    axes = np.where(angles[:, None] > 0.0, turns / np.where(angles > 0.0, angles, 1.0)[:, None], [0.0, 0.0, 1.0])
    along = axes[:, :, None] * axes[:, None, :]
    crossed = np.cross(axes[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)
    factors = [path.rotations @ along, path.rotations @ (np.eye(3) - along), path.rotations @ crossed]
    position = [_add_line(model, samples, f"{axis} {number}", path.positions[:, k]) for k, axis in enumerate("xyz")]

    def constant(name: str, values: Array) -> str:
        samples[name] = values[:-1, None]
        return _add(model, name, values)

    entries = [
        [
            [constant(f"constant {number} {kind} {i}{j}", of[:, i, j]) for kind, of in enumerate(factors)]
            for j in range(3)
        ]
        for i in range(3)
    ]
    turn = _add(model, f"turn {number}", np.zeros(len(angles)))
    samples[turn] = np.column_stack([np.zeros(len(angles) - 1), angles[:-1]])

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


def motion_along_trajectory(trajectory: Trajectory) -> Motion:
    """The motion of a trajectory's states, by the polynomials of its scheme; rules read them as of its phase."""
    model = ConcreteModel(name=trajectory.name)
    grid = trajectory.grid
    times, points = tuple(grid.times), tuple(grid.points)
    for names, index in ((trajectory.states, times), (trajectory.signals, points)):
        for name, values in names.items():
            given = dict(zip(index, values.tolist(), strict=True))
            model.add_component(name, Param(list(index), initialize=given))
    for name, value in trajectory.parameters.items():
        model.add_component(name, Param(initialize=value))
    model.time_at = _same
    return GivenMotion(
        model,
        times,
        intervals_of_grid(grid),
        trajectory.element_polynomials(np.linspace(0.0, 1.0, grid.scheme.stages + 2)),
        f"the polynomials of the states of trajectory '{trajectory.name}' ({grid.scheme.name})",
        f"is no state of trajectory '{trajectory.name}'. {STATES_ONLY}",
        has_equations=False,
    )


def _same(t: Any) -> Any:
    """The time of an index of a trajectory: the index itself."""
    return t
