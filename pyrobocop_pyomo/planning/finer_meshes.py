"""One loop over meshes: an answer says how large the errors of its mesh are, and the model is solved on a finer one."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.discretisation.estimates import SMALL_MOTION_ERROR
from pyrobocop_pyomo.discretisation.first_meshes import MOST_ELEMENTS, MOST_TIMES
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_its_mesh_is_stated
from pyrobocop_pyomo.solving.ipopt_options import FINER_MESH
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.result_text import KEPT_MESH
from pyrobocop_pyomo.solving.second_tries import ITERATIONS_OF_ONE
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.starts import EXPLORED_ELEMENTS, elements_of
from pyrobocop_pyomo.solving.strategies import ABSOLUTE_VALUES, SOLVE

from .planning_point import PlanningPoint

logger = logging.getLogger(__name__)

# What is aimed at, as a part of the tolerance: estimates are right within a factor, and one solve more costs more than
# some elements.
AIMED = 0.3
# So many meshes follow the first one, with at most `MOST_TIMES` its elements, or as many as a small problem may have.
MOST_MESHES, SMALL_ELEMENTS = 8, 200
# Iterations times elements of all of them: a multiple of that of the first solve, or a small problem's.
EFFORT, SMALL_EFFORT = 10, 30_000
# An objective on a finer mesh that is worse by more than this many estimated errors is that of another local optimum,
# unless the motion before was none of the equations.
_TRUST = 10.0


@dataclass(frozen=True, eq=False)
class MeshStep:
    """The answer on one mesh: elements of all phases, and the result."""

    elements: int
    result: SolveResult

    @property
    def is_optimal(self) -> bool:
        """Whether it is an answer at all."""
        return self.result.quality is Quality.OPTIMAL


class MeshLoop:
    """Solves of one model on finer and finer meshes, in place, each from the answer on the mesh before.

    Parameters
    ----------
    model : Block
        Holds the first answer.
    settings : Settings
    start : PlanningPoint
        Where a solve that fails starts once more.
    tolerance : float
        Of the errors; see `DiscretisationEstimate.ratio`.
    first : SolveResult

    Attributes
    ----------
    steps : list of MeshStep
        Of all solves.
    remark : str
        What keeps the meshes; empty where nothing does.
    """

    def __init__(
        self, model: Any, settings: Settings, start: PlanningPoint, tolerance: float, first: SolveResult
    ) -> None:
        self._model, self._phases = model, phases_of(model)
        self._settings, self._start, self._tolerance = settings, start, tolerance
        self._boundaries = {phase.name: frozenset(phase.grid.mesh.boundaries) for phase in self._phases}
        self.steps = [MeshStep(elements_of(model), first)]
        self._most = min(max(MOST_TIMES * self.steps[0].elements, SMALL_ELEMENTS), MOST_ELEMENTS)
        self._left = max(SMALL_EFFORT, EFFORT * self.steps[0].elements * first.iterations)
        self.remark = ""

    def run(self) -> MeshStep:
        """Go on until the tolerance is met or nothing helps; the model holds the best answer, which is returned."""
        best = self.steps[0]
        # Where a few elements had no solution, twice as many may.
        halved = not best.is_optimal
        if halved and best.elements > EXPLORED_ELEMENTS:
            return best
        while (meshes := self._next(best, halved)) is not None:
            point = PlanningPoint(self._model)
            try:
                with undone_on_failure(point.restore):
                    finer = self._on(meshes, FINER_MESH if best.is_optimal else None)
                    once_more = best.is_optimal and not halved and not finer.result.stop_reason.is_final
                    if once_more and not _replaces(finer, best):
                        finer = self._on(meshes, {})
            except PyRobocopError as error:
                logger.info("'%s' cannot be solved on a finer mesh: %s", self._model.name, error)
                return best
            if _replaces(finer, best):
                best, halved = finer, False
                continue
            point.restore()
            if halved or finer.result.stop_reason.is_final:
                return best
            halved = True  # another mesh, near to the last one that was solved
        return best

    def _next(self, best: MeshStep, halved: bool) -> dict[str, Mesh] | None:
        """The next meshes; None where it ends."""
        now = {phase.name: phase.grid.mesh for phase in self._phases}
        if best.is_optimal and not best.result.discretisation.ratio(self._tolerance) > 1.0:  # or not known
            return None
        if halved:
            meshes = {name: halves_of(mesh) for name, mesh in now.items()}
        else:
            trajectories = {phase.name: phase.trajectory() for phase in self._phases}
            meshes = best.result.discretisation.finer(now, trajectories, AIMED * self._tolerance, keep=self._boundaries)
        at_an_end = (
            best.result.stop_reason is StopReason.INTERRUPTED
            or self._settings.deadline.has_passed
            or len(self.steps) > MOST_MESHES
            or sum(mesh.elements for mesh in meshes.values()) > min(self._most, self._left)
            or meshes == now
        )
        return None if at_an_end else meshes

    def _on(self, meshes: dict[str, Mesh], options: Mapping[str, Any] | None) -> MeshStep:
        """The answer on meshes: from the values on the model where there are options for that, else from the start."""
        if not options:
            self._start.restore()
        try:
            remesh_phases({phase: meshes[phase.name] for phase in self._phases})
        except PyRobocopError as error:
            self.remark = f"{KEPT_MESH}: {error}"
            raise
        count, strategies = elements_of(self._model), self._settings.strategies
        if options is not None:
            most = max(1, min(ITERATIONS_OF_ONE, int(self._left / count)))
            strategies = (replace(SOLVE, name="finer mesh", options={**options, "max_iter": most}),)
        result = solve_model(self._model, replace(self._settings, strategies=strategies, exploration=0.0))
        self.steps.append(MeshStep(count, result))
        self._left -= count * result.iterations
        logger.info("'%s' on %d elements: %s", self._model.name, count, result.one_line())
        return self.steps[-1]


def _replaces(finer: MeshStep, before: MeshStep) -> bool:
    """Whether an answer is no worse than that on the mesh before, which may have flattered itself."""
    if not (finer.is_optimal and before.is_optimal):
        return finer.is_optimal
    explained = 0.0
    for step in (finer, before):
        error = step.result.discretisation.relative_objective_error
        error = step.result.discretisation.largest_known_motion_error if error is None else error
        explained += float(np.nan_to_num(error)) * abs(step.result.objective)
    worse = finer.result.standing.cost - before.result.standing.cost
    return (
        before.result.discretisation.largest_known_motion_error > SMALL_MOTION_ERROR or not worse > _TRUST * explained
    )


def solve_on_finer_meshes(model: Any, tolerance: float, settings: Settings) -> SolveResult:
    """Solve a model, and on finer meshes where its answer says that its errors are too large.

    Parameters
    ----------
    model : Block
        Its values are the initial guess. It holds the best answer afterwards.
    tolerance : float
        Of the objective and of limits of states, as parts of their sizes; see `DiscretisationEstimate.ratio`.
    settings : Settings
    """
    phases = phases_of(model)
    refines = bool(phases) and not any(map(why_its_mesh_is_stated, phases))
    guess = VariableValues.of_free(model) if refines else None
    first = solve_model(model, settings)
    through_pairs = first.residuals or first.strategy == ABSOLUTE_VALUES.name
    if guess is None or through_pairs or not (first.solved or first.stop_reason is StopReason.INFEASIBLE):
        return first
    if first.solved and not first.discretisation.ratio(tolerance) > 1.0:  # or not known
        return first
    answer = guess.read()
    guess.restore()
    start = PlanningPoint(model)
    guess.write(answer)
    loop = MeshLoop(model, settings, start, tolerance, first)
    return _joined(loop.run(), loop, tolerance)


def _joined(best: MeshStep, loop: MeshLoop, tolerance: float) -> SolveResult:
    """The best answer, with the steps of all, and what became of the mesh."""
    first, results = loop.steps[0], [step.result for step in loop.steps]
    remarks = [*best.result.remarks, *([loop.remark] if loop.remark else [])]
    if best is not first:
        why = (
            f"the first answer, {first.result.objective:.6g}, was not exact enough (mesh_tolerance={tolerance:g})."
            if first.result.solved
            else "on the first one no solution was found."
        )
        remarks.append(f"The mesh was refined from {first.elements} to {best.elements} elements: {why}")
    elif len(results) > 1 and first.result.solved:
        remarks.append(f"Finer meshes than that of {best.elements} elements led to nothing better.")
    interrupted = results[-1].stop_reason is StopReason.INTERRUPTED
    return replace(
        with_steps_of_all(best.result, results),
        remarks=tuple(remarks),
        stop_reason=results[-1].stop_reason if interrupted else best.result.stop_reason,
    )
