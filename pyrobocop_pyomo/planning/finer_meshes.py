"""Finer meshes, in place, where an answer says of itself that its mesh makes too large an error."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.discretisation import MeshErrors
from pyrobocop_pyomo.errors import PyRobocopError, RemeshingError
from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.numerics.remeshing import remesh
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_not_remeshed
from pyrobocop_pyomo.solving.ipopt_options import NEARLY_THERE
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.solving.strategies import SOLVE

from .planning_point import PlanningPoint

logger = logging.getLogger(__name__)

# The largest error of the motion that is allowed, as a multiple of that of the objective.
MOTION = 10.0
# What is aimed at: estimates are right within a factor, and one solve more costs more than some elements.
AIMED = 0.3
# So many meshes follow the first one, with as many times its elements, and as many in all.
MOST_MESHES, MOST_TIMES, MOST_ELEMENTS = 8, 8, 1000
# Iterations times elements of all of them: a multiple of that of the first solve, or a small problem's.
EFFORT, SMALL_EFFORT = 10, 30_000
# Of one solve, which starts from the answer on the mesh before but may be unlucky: as a multiple of its iterations.
_FEWEST, _MORE = 300, 3
# An objective on a finer mesh that is worse by more than this many estimated errors is that of another local optimum.
_TRUST = 10.0


def solve_on_finer_meshes(
    model: Any, first: SolveResult, tolerance: float, settings: Settings, solve: Callable[[Settings], SolveResult]
) -> SolveResult:
    """Refine the meshes of all phases and solve again, warm, until the errors of the answer are within a tolerance.

    Parameters
    ----------
    model : Block
        Holds the answer of `first`.
    first : SolveResult
    tolerance : float
        Of the objective, as a part of its size; the motion may err by `MOTION` times as much of each state's size.
    settings : Settings
    solve : callable
        Solves the model as it stands, with other settings.

    Returns
    -------
    SolveResult
        The best answer, which the model holds; `first` itself where its mesh is fine enough, or cannot be told from.
    """
    phases = phases_of(model)
    if not phases or first.residuals or not first.solved:
        return first
    return _Refinement(model, phases, first, tolerance, settings, solve).best()


class _Refinement:
    """The meshes of one solve."""

    def __init__(
        self,
        model: Any,
        phases: list[Any],
        first: SolveResult,
        tolerance: float,
        settings: Settings,
        solve: Callable[[Settings], SolveResult],
    ) -> None:
        self._model, self._phases, self._settings, self._solve = model, phases, settings, solve
        self._objective, self._motion = tolerance, MOTION * tolerance
        self._results = [first]
        self._first_elements = self._elements()
        self._left = max(SMALL_EFFORT, EFFORT * self._first_elements * first.iterations)
        self._first_boundaries = {phase.name: frozenset(phase.grid.mesh.boundaries) for phase in phases}
        self._remark = ""

    def best(self) -> SolveResult:
        """Go on until the tolerance is met, no mesh is better, or the effort is spent."""
        best, halved = self._results[0], False
        while True:
            errors = MeshErrors.of(best.discretisation)
            if not errors.excess(self._motion, self._objective) > 1.0:  # or not known
                break
            meshes = self._halves() if halved else self._finer(errors)
            if meshes is None:
                break
            point = PlanningPoint(self._model)
            finer = self._solved_on(meshes, best)
            if finer is None:
                break
            self._results.append(finer)
            if self._replaces(finer, best):
                best, halved = finer, False
                continue
            point.restore()
            if halved or finer.stop_reason.is_final:
                break
            halved = True  # another mesh, near to the last one that was solved
        return self._joined(best)

    def _elements(self) -> int:
        return sum(phase.grid.mesh.elements for phase in self._phases)

    def _finer(self, errors: MeshErrors) -> dict[str, Mesh] | None:
        meshes = {phase.name: phase.grid.mesh for phase in self._phases}
        trajectories = {phase.name: phase.trajectory() for phase in self._phases}
        tolerances = AIMED * self._motion, AIMED * self._objective
        return self._allowed(errors.finer(meshes, trajectories, *tolerances, keep=self._first_boundaries))

    def _halves(self) -> dict[str, Mesh] | None:
        meshes = {phase.name: phase.grid.mesh for phase in self._phases}
        return self._allowed(
            {
                name: remesh(mesh, np.full(mesh.elements, np.inf), 1.0, 1, most_parts=2)
                for name, mesh in meshes.items()
            }
        )

    def _allowed(self, meshes: dict[str, Mesh]) -> dict[str, Mesh] | None:
        """The meshes, unless they are too many or too fine."""
        count = sum(mesh.elements for mesh in meshes.values())
        most = min(MOST_TIMES * self._first_elements, MOST_ELEMENTS)
        if len(self._results) > MOST_MESHES or count > most or self._left < count or self._settings.deadline.has_passed:
            return None
        return None if meshes == {phase.name: phase.grid.mesh for phase in self._phases} else meshes

    def _solved_on(self, meshes: dict[str, Mesh], before: SolveResult) -> SolveResult | None:
        """The answer on other meshes; None where the phases cannot have them, or nothing can be solved there."""
        phases = {phase.name: phase for phase in self._phases}
        try:
            for phase in self._phases:
                if (reason := why_not_remeshed(phase)) is not None:
                    raise RemeshingError(reason)
            remesh_phases({phases[name]: mesh for name, mesh in meshes.items()})
        except PyRobocopError as error:
            self._remark = f"The mesh stays as it is: {error}"
            return None
        count = self._elements()
        iterations = min(max(_FEWEST, _MORE * before.iterations), self._left // count)
        again = replace(SOLVE, name="finer mesh", options={**NEARLY_THERE, "max_iter": iterations})
        result = self._solve(replace(self._settings, strategies=(again,)))
        self._left -= count * result.iterations
        logger.info("'%s' on %d elements: %s", self._model.name, count, result.one_line())
        return result

    def _replaces(self, finer: SolveResult, before: SolveResult) -> bool:
        """Whether an answer is no worse than that on the mesh before, which may have flattered itself."""
        if finer.quality is not Quality.OPTIMAL:
            return False
        errors = [MeshErrors.of(result.discretisation) for result in (finer, before)]
        explained = sum(
            np.nan_to_num(of.objective) * abs(result.objective)
            for of, result in zip(errors, (finer, before), strict=True)
        )
        worse = finer.standing.cost - before.standing.cost
        inexact = errors[1].excess(self._motion, np.inf) > 1.0  # the motion before was none of the equations
        return inexact or not worse > _TRUST * explained

    def _joined(self, best: SolveResult) -> SolveResult:
        """The best answer, with the steps of all, and what became of the mesh."""
        first, results = self._results[0], self._results
        remarks = [*best.remarks, *([self._remark] if self._remark else [])]
        if len(results) == 1:
            return replace(first, remarks=tuple(remarks))
        elements = self._elements()
        if best is first:
            remarks.append(f"Finer meshes than that of {elements} elements led to nothing better.")
        else:
            remarks.append(
                f"The mesh was refined from {self._first_elements} to {elements} elements, where the estimated errors "
                f"of the first answer, {first.objective:.6g}, called for it (mesh_tolerance={self._objective:g})."
            )
        steps, number = [], 0
        for result in results:
            if result is best:
                number = len(steps) + result.best.number
            steps += [replace(step, number=step.number + len(steps)) for step in result.steps]
        interrupted = results[-1].stop_reason is StopReason.INTERRUPTED
        return replace(
            best,
            steps=steps,
            best=replace(best.best, number=number),
            remarks=tuple(remarks),
            stop_reason=results[-1].stop_reason if interrupted else best.stop_reason,
        )
