"""Finer meshes for phases whose equations lead too far away from the plan.

A margin covers a small distance between the plan and the motion of its equations. Where that distance is a large share
of the clearance, a margin would cost room that only the mesh needs: there the mesh gets finer, in place. Of linked
phases it is the mesh of the one that errs, which may be an earlier one than that among the obstacles.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pyrobocop_pyomo.discretisation.first_meshes import MOST_ELEMENTS
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.motion.equations_motion import needed_reductions
from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.remeshing import remesh
from pyrobocop_pyomo.phases.reintegration import Reintegration, reintegrate
from pyrobocop_pyomo.phases.remeshing import remesh_phases
from pyrobocop_pyomo.solving.result_text import KEPT_MESH

# As shares of the clearance: larger deviations call for a finer mesh, which aims at the second one.
LARGEST_SHARE, WANTED_SHARE = 0.25, 0.05


class SafetyMeshes:
    """The meshes of the phases that avoidance blocks and regions stand on.

    Parameters
    ----------
    blocks : iterable of ObstacleAvoidanceBlockData and ContainmentData

    Attributes
    ----------
    remark : str
        What keeps a mesh that is too coarse for its obstacles; empty where nothing does.
    """

    def __init__(self, blocks: Iterable[Any]) -> None:
        self._blocks = list(blocks)
        self._stays = False
        self.remark = ""

    def stay(self) -> None:
        """Refine no more: finer meshes have led nowhere."""
        self._stays = True

    def refine(self, reports: Iterable[SafetyReport]) -> str:
        """Refine where the plan alone keeps its clearances; returns what was done, or nothing.

        Parameters
        ----------
        reports : iterable of SafetyReport
            Of each block, at the values on the model.
        """
        wanted: dict[int, tuple[Any, float]] = {}
        if self._stays:
            return ""
        meshes = {}
        try:
            for block, report in zip(self._blocks, reports, strict=True):
                reduction = _reduction(report)
                read = block.motion.phase if reduction < 1.0 else None
                for phase, needed in () if read is None else needed_reductions(read, reduction):
                    wanted[id(phase)] = (phase, min(needed, wanted.get(id(phase), (phase, 1.0))[1]))
            for phase, reduction in wanted.values():
                mesh = self._finer(phase, reduction)
                if mesh is not None:
                    meshes[phase] = mesh
            if not meshes:
                return ""
            before = {phase: phase.grid.mesh.elements for phase in meshes}
            remesh_phases(meshes)
        except PyRobocopError as error:
            self.stay()
            self.remark = f"{KEPT_MESH}: {error}"
            return ""
        said = [f"'{phase.name}' from {count} to {phase.grid.mesh.elements}" for phase, count in before.items()]
        return f"elements of {', '.join(said)}"

    def _finer(self, phase: Any, reduction: float) -> Mesh | None:
        """A mesh on which the equations lead that much less far away; None where it would be too fine."""
        mesh, scheme = phase.grid.mesh, phase.grid.scheme
        errors = _errors_inside(reintegrate(phase, phase.trajectory(), states_only=True))
        # A polynomial of degree s deviates by O(h^(s + 1)) inside an element, whatever the order at its end is.
        order = min(scheme.order, scheme.stages)
        tolerance = float(np.mean(errors)) * reduction ** ((order + 1) / order)
        finer = remesh(mesh, errors, tolerance, order)
        return finer if mesh.elements < finer.elements <= MOST_ELEMENTS else None


def _reduction(report: SafetyReport) -> float:
    """By which factor the distance between plan and equations has to shrink; 1 where margins can cover it."""
    reduction = 1.0
    for pair in report.body_pairs:
        for interval in pair.plan_only:
            deviation, clearance = pair.interval_deviation[interval], pair.interval_clearance[interval]
            if deviation > LARGEST_SHARE * clearance:
                share = WANTED_SHARE * clearance / deviation if np.isfinite(deviation) else 0.01
                reduction = min(reduction, float(share))
    return reduction


def _errors_inside(motion: Reintegration) -> Array:
    """Largest difference inside each element, integrated from its own start, each state relative to its size."""
    inside = [
        np.abs(motion.local[name] - planned).max(axis=1) / (1e-3 + np.abs(planned).max())
        for name, planned in motion.planned.items()
    ]
    errors = np.max(inside, axis=0)
    finite = errors[np.isfinite(errors)]
    return np.where(np.isfinite(errors), errors, 10.0 * float(finite.max(initial=1.0)))
