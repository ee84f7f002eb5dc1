"""Motions that come from no model: paths sampled at times, and trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Set
from pyomo.core.expr import cos, sin

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.numerics import Array
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

    def polynomial(self, signal: Item, interval: int) -> tuple[Array, list[Any]]:
        """The values at evenly spaced fractions."""
        values = self.samples[signal.component.local_name][interval]
        return np.linspace(0.0, 1.0, len(values)), values.tolist()


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
        rules[name] = _add_path(model, samples, number, path)
    return GivenMotion(model, points, tuple(pairwise(points)), samples), rules


def _add(model: Any, samples: dict[str, Array], name: str, values: Array, within: Array) -> None:
    """What has values at the times, and at evenly spaced fractions within each interval."""
    times = model.component(_TIMES)
    model.add_component(name, Param(times, initialize=dict(zip(times, values.tolist(), strict=True))))
    samples[name] = within


def _add_line(model: Any, samples: dict[str, Array], name: str, values: Array) -> None:
    """What is linear from each time to the next."""
    _add(model, samples, name, values, np.column_stack([values[:-1], values[1:]]))


def _add_path(model: Any, samples: dict[str, Array], number: int, path: SampledPath) -> Callable[..., Any]:
    """Rodrigues' formula on each interval: ``R (u u' + (I - u u') cos(angle) + [u] sin(angle))``, ``u`` the axis."""
    along = path.axes[:, :, None] * path.axes[:, None, :]
    crossed = np.cross(path.axes[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)
    factors = {"still": along, "cosine": np.eye(3) - along, "sine": crossed}
    dimension = path.positions.shape[1]
    for axis, column in zip("xyz", path.positions.T, strict=False):
        _add_line(model, samples, f"{axis} {number}", column)
    for (kind, factor), i, j in product(factors.items(), range(dimension), range(dimension)):
        values = (path.rotations @ factor)[:, i, j]
        _add(model, samples, f"{kind} {i}{j} {number}", np.append(values, values[-1]), values[:, None])
    _add(model, samples, f"turn {number}", np.append(path.angles[:, 0], path.angles[-1, 1]), path.angles)

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
