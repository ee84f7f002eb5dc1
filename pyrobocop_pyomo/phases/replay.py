"""A plan played back: what its controls do when everything else is left to the equations and the pairs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.trajectories import Trajectory

from .companions import put_on_model
from .record import PhaseRecord
from .simulation import SimulationOptions, simulate


@dataclass(frozen=True)
class Replay:
    """A plan, and the motion that its controls lead to.

    Attributes
    ----------
    trajectory : Trajectory
        The simulated motion, on the grid of the phase.
    distances : dict of state name to number
        Largest difference of each state from the plan, over the times of the grid.
    """

    trajectory: Trajectory
    distances: Mapping[str, float]

    @property
    def distance(self) -> float:
        """The largest of all differences."""
        return max(self.distances.values(), default=0.0)

    def __str__(self) -> str:
        listed = ", ".join(f"{name} {distance:.2e}" for name, distance in self.distances.items())
        return f"largest distance from the plan: {listed or 'no states'}"


def replay(block: Any, record: PhaseRecord, trajectory: Trajectory, options: SimulationOptions) -> Replay:
    """See `PhaseActions.replay`."""
    with put_on_model([(block, trajectory)]):
        found = simulate(block, record, {}, {}, options)
    boundaries = trajectory.grid.mesh.boundaries
    planned = trajectory(np.minimum(np.maximum(found.time, boundaries[0]), boundaries[-1]))
    distances = {
        name: float(np.abs(found.states[name] - planned[name]).max(initial=0.0)) for name in record.names_of_states
    }
    return Replay(found, distances)
