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

from .estimates import SMALL_MOTION_ERROR, SMALL_OBJECTIVE_ERROR, ZERO_OBJECTIVE, DiscretisationEstimate
from .jump_times import jump_fractions

# The largest error of the motion that is allowed, as a multiple of those of the objective and of limits.
MOTION = SMALL_MOTION_ERROR / SMALL_OBJECTIVE_ERROR


@dataclass(frozen=True, eq=False)
class MeshErrors:
    """Errors of the elements of one answer, by the names of its phases.

    Attributes
    ----------
    of_motion : dict of str to array, shape (N,)
        How far states are from the motion of the equations at the end of each element, relative to sizes.
    of_limits : dict of str to array, shape (N,)
        How far bounds and path inequalities of states are passed inside each element, relative to sizes.
    of_objective : dict of str to array, shape (N,)
        What each element adds to the error of the objective, as a part of its size; phases of which that is not known
        are missing.
    objective : float
        That of the objective, as a part of its size, in which errors of different signs cancel; NaN where it is not
        known.
    """

    of_motion: Mapping[str, Array]
    of_limits: Mapping[str, Array]
    of_objective: Mapping[str, Array]
    objective: float

    @classmethod
    def of(cls, estimate: DiscretisationEstimate) -> MeshErrors:
        """What an estimate says."""
        phases = estimate.phases
        of_motion = {name: of.motion for name, of in phases.items() if of.motion is not None}
        of_limits = {name: of.relative_excesses for name, of in phases.items() if of.relative_excesses is not None}
        size = max(abs(estimate.objective), ZERO_OBJECTIVE)
        parts = {name: of.objective / size for name, of in phases.items() if of.objective is not None}
        error = estimate.relative_objective_error
        return cls(of_motion, of_limits, parts, math.nan if error is None else error)

    @property
    def motion(self) -> float:
        """The largest error of the motion in any element; NaN where none is known."""
        return _largest(self.of_motion)

    @property
    def limits(self) -> float:
        """The most by which a limit is passed in any element; NaN where that is not known."""
        return _largest(self.of_limits)

    def ratio(self, tolerance: float) -> float:
        """How many times the largest error is what it may be; NaN where none is known.

        Parameters
        ----------
        tolerance : float
            What errors of limits and of the objective may be, relative to sizes; that of the motion, `MOTION` times so
            much.
        """
        return float(np.fmax.reduce((self.motion / MOTION, self.limits, self.objective))) / tolerance

    def finer(
        self,
        meshes: Mapping[Any, Mesh],
        trajectories: Mapping[str, Trajectory],
        tolerance: float,
        keep: Mapping[str, Collection[float]],
    ) -> dict[str, Mesh]:
        """Meshes on which all elements are expected to meet a tolerance.

        Parameters
        ----------
        meshes : dict of str to Mesh
            Those of this answer.
        trajectories : dict of str to Trajectory
            The answer; where a control jumps, a boundary is put.
        tolerance : float
            As that of `ratio`.
        keep : mapping of str to collection of float
            Boundaries that stay; others may go.
        """
        return {
            name: remesh(
                mesh,
                self._shares(name, mesh.elements, tolerance),
                1.0,
                trajectories[name].grid.scheme.order,
                keep=keep[name],
                jumps=jump_fractions(trajectories[name]),
            )
            for name, mesh in meshes.items()
        }

    def _shares(self, name: str, elements: int, tolerance: float) -> Array:
        """Each element's errors as multiples of what it may have."""
        none = np.zeros(elements)
        errors = np.maximum(self.of_motion.get(name, none) / MOTION, self.of_limits.get(name, none))
        if name in self.of_objective:
            count = sum(len(of) for of in self.of_objective.values())
            errors = np.maximum(errors, self.of_objective[name] * count)
        return errors / tolerance


def _largest(of: Mapping[str, Array]) -> float:
    return max((float(errors.max(initial=0.0)) for errors in of.values()), default=math.nan)
