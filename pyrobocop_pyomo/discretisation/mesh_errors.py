"""`MeshErrors`: what an answer says of each element of its phases, and the meshes that follow from it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.remeshing import remesh
from pyrobocop_pyomo.trajectories import Trajectory

from .estimates import ZERO_OBJECTIVE, DiscretisationEstimate
from .jump_times import jump_fractions

MOST_PARTS = 4


@dataclass(frozen=True, eq=False)
class MeshErrors:
    """Errors of the elements of one answer, by the names of its phases.

    Attributes
    ----------
    of_motion : dict of str to array, shape (N,)
        How far states are from the motion of the equations at the end of each element, and how far limits are passed
        inside it, relative to sizes.
    of_objective : dict of str to array, shape (N,)
        What each element adds to the error of the objective, as a part of its size; phases of which that is not known
        are missing.
    objective : float
        That of the objective, as a part of its size, in which errors of different signs cancel; NaN where it is not
        known.
    """

    of_motion: Mapping[str, Array]
    of_objective: Mapping[str, Array]
    objective: float

    @classmethod
    def of(cls, estimate: DiscretisationEstimate, of_motion: Mapping[str, Array] | None = None) -> MeshErrors:
        """What an estimate says; errors of the motion are its own unless others are given."""
        found = dict(of_motion or {})
        for name, phase in estimate.phases.items():
            known = [of for of in (found.get(name, phase.motion), phase.excesses) if of is not None]
            if known:
                found[name] = np.max(known, axis=0)
        size = max(abs(estimate.objective), ZERO_OBJECTIVE)
        parts = {name: of.objective / size for name, of in estimate.phases.items() if of.objective is not None}
        error = estimate.relative_objective_error
        return cls(found, parts, math.nan if error is None else error)

    @property
    def motion(self) -> float:
        """The largest error of any element; NaN where none is known."""
        return max((float(of.max(initial=0.0)) for of in self.of_motion.values()), default=math.nan)

    def excess(self, motion: float, objective: float) -> float:
        """How many times the larger of both errors is what is allowed; NaN where neither is known."""
        return float(np.fmax(self.motion / motion, self.objective / objective))

    def finer(
        self,
        meshes: Mapping[Any, Mesh],
        trajectories: Mapping[str, Trajectory],
        motion: float,
        objective: float,
        keep: Mapping[str, Collection[float]] | None = None,
        most_parts: int = MOST_PARTS,
    ) -> dict[str, Mesh]:
        """Meshes on which all elements are expected to meet tolerances.

        Parameters
        ----------
        meshes : dict of str to Mesh
            Those of this answer.
        trajectories : dict of str to Trajectory
            The answer; where a control jumps, a boundary is put.
        motion, objective : float
            Tolerances of the two.
        keep : mapping of str to collection of float, optional
            Boundaries that stay, so that others may go; all by default.
        most_parts : int
            Into which one element is split at once.
        """
        return {
            name: remesh(
                mesh,
                self._shares(name, mesh.elements, motion, objective),
                1.0,
                trajectories[name].grid.scheme.order,
                most_parts=most_parts,
                keep=None if keep is None else keep[name],
                jumps=jump_fractions(trajectories[name]),
            )
            for name, mesh in meshes.items()
        }

    def _shares(self, name: str, elements: int, motion: float, objective: float) -> Array:
        """Each element's errors as multiples of what it may have."""
        shares = self.of_motion.get(name, np.zeros(elements)) / motion
        if name in self.of_objective:
            count = sum(len(of) for of in self.of_objective.values())
            shares = np.maximum(shares, self.of_objective[name] * count / objective)
        return shares
