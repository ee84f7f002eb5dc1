"""Trajectories of a sequence of phases, laid one after the other in time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.variable_families import FamilyNames
from pyrobocop_pyomo.numerics import Array, Grid, Mesh
from pyrobocop_pyomo.plotting import mark_phases
from pyrobocop_pyomo.presentation import Presented

from .trajectory import Trajectory, drawn_parts, family_values, nothing_known


@dataclass(frozen=True, eq=False)
class JoinedTrajectory(Presented):
    """The trajectories of several phases as one, to be read and drawn; made by `join_trajectories`.

    Attributes
    ----------
    parts : tuple of Trajectory
        One per phase, each starting where the one before ends.

    Notes
    -----
    Values are attributes: ``joined.speed`` belongs to ``joined.time`` if it is a state, to ``joined.points`` otherwise,
    and is NaN in phases that have no such name. Both values at a boundary between phases are there, so that a jump
    remains visible. Parameters belong to phases: ``joined.parts[0].mass``. Each part is saved, and each phase verified,
    by itself.
    """

    parts: tuple[Trajectory, ...]

    def __getattr__(self, name: str) -> Array:
        if not name.startswith("_"):
            for values in (self.over_time, self.over_points):
                if name in values:
                    return values[name]
            if name in self.families:
                names = self.families[name]
                return family_values(names, [getattr(self, member) for member in names.members])
        raise AttributeError(f"{self._called} has no '{name}'.")

    @cached_property
    def over_time(self) -> dict[str, Array]:
        """What is a state in any of the phases, and the expressions that have values at the times of the states."""
        names = dict.fromkeys(name for part in self.parts for name in part.over_time)
        return {name: np.concatenate([_at_own_times(part, name) for part in self.parts]) for name in names}

    @cached_property
    def over_points(self) -> dict[str, Array]:
        """Everything else that changes in time."""
        names = dict.fromkeys(name for part in self.parts for name in part.over_points if name not in self.over_time)
        return {
            name: np.concatenate([part.over_points.get(name, nothing_known(part.points)) for part in self.parts])
            for name in names
        }

    @cached_property
    def families(self) -> dict[str, FamilyNames]:
        """Vectors and matrices that change in time."""
        return {name: names for part in self.parts for name, names in part.families.items() if names.in_time}

    @property
    def names(self) -> list[str]:
        """Names of everything that changes in time, in any of the phases."""
        return [*self.over_time, *self.over_points]

    @property
    def _called(self) -> str:
        named = ", ".join(f"'{part.name}'" for part in self.__dict__.get("parts", ()))
        return f"a joined trajectory of {named}"

    @cached_property
    def time(self) -> Array:
        """Times of the states; each boundary between phases stands there twice."""
        return np.concatenate([part.time for part in self.parts])

    @cached_property
    def points(self) -> Array:
        """Times of algebraics and controls."""
        return np.concatenate([part.points for part in self.parts])

    @cached_property
    def boundaries(self) -> Array:
        """Start of each phase, and the end of the last, shape ``(len(parts) + 1,)``."""
        return np.array([self.parts[0].time[0], *(part.time[-1] for part in self.parts)])

    @property
    def duration(self) -> float:
        """Length of all phases together."""
        return float(self.boundaries[-1] - self.boundaries[0])

    def __call__(self, t: ArrayLike, *, after: bool = False) -> dict[str, Any]:
        """Values of every state, algebraic, control and expression at given times; NaN where a phase has no such name.

        Parameters
        ----------
        t : float or array, shape (m,)
            Times within the sequence.
        after : bool
            At a boundary, ask the phase that starts there; by default the one that ends.

        Returns
        -------
        dict of name to float, or to array of shape (m,)

        Raises
        ------
        TrajectoryError
            When a time is not a number within the sequence.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        position = np.searchsorted(self.boundaries, times, side="right" if after else "left")
        part = np.clip(position - 1, 0, len(self.parts) - 1)
        values = {name: np.full(times.shape, np.nan) for name in self.names}
        for i, trajectory in enumerate(self.parts):
            if (part == i).any():
                for name, found in trajectory(times[part == i]).items():
                    values[name][part == i] = found
        return values if np.ndim(t) else {name: float(value[0]) for name, value in values.items()}

    def plot(self, names: list[str] | Mapping[str, str] | None = None, *, figure: Any = None) -> Any:
        """Draw signals over time as `Trajectory.plot` does, the phases marked."""
        title = ", ".join(part.title for part in self.parts if part.title != part.name)
        drawn = drawn_parts(self, self.parts, self._called, title, names, figure)
        mark_phases(drawn, self.boundaries, [part.name for part in self.parts])
        return drawn

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.names, *self.families})

    def _summary(self) -> str:
        count = len(self.parts)
        return (
            f"{count} phase{'s' * (count != 1)} ({', '.join(repr(part.title) for part in self.parts)}): "
            f"{', '.join(self.names)}"
        )


def join_trajectories(parts: Iterable[Any]) -> JoinedTrajectory:
    """Lay trajectories one after the other in time.

    Parameters
    ----------
    parts : iterable of Trajectory or PhaseBlock
        In the order of the motion; a phase stands for its ``trajectory()``. The first keeps its times, each other
        is moved to start where the one before ends.

    Raises
    ------
    TrajectoryError
        When there are none.
    """
    joined: list[Trajectory] = []
    for given in parts:
        part = given if isinstance(given, Trajectory) else given.trajectory()
        joined.append(_moved(part, joined[-1].grid.mesh.boundaries[-1]) if joined else part)
    if not joined:
        raise TrajectoryError("no trajectories to join; give the phases in their order.")
    return JoinedTrajectory(tuple(joined))


def _at_own_times(part: Trajectory, name: str) -> Array:
    """Values at the times of the states; what is no state is evaluated there by its polynomial."""
    if name in part.over_time:
        return part.over_time[name]
    return part(part.time)[name] if name in part.over_points else nothing_known(part.time)


def _moved(part: Trajectory, start: float) -> Trajectory:
    boundaries = part.grid.mesh.boundaries
    if boundaries[0] == start:
        return part
    mesh = Mesh(tuple(start + (boundary - boundaries[0]) for boundary in boundaries))
    linear = {
        name: np.array([start + (times - boundaries[0]), values])
        for name, (times, values) in part.piecewise_linear.items()
    }
    return replace(part, grid=Grid(part.grid.scheme, mesh), piecewise_linear=linear)
