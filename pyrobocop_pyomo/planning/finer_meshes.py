"""One loop over meshes: an answer says how large the errors of its mesh are, and the model is solved on a finer one."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.discretisation import MeshErrors, MeshTolerances
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
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
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.strategies import ABSOLUTE_VALUES, SOLVE

from .planning_point import PlanningPoint

logger = logging.getLogger(__name__)

# The largest error of the motion that is allowed, as a multiple of those of the objective and of limits.
MOTION = 10.0
# What is aimed at: estimates are right within a factor, and one solve more costs more than some elements.
AIMED = 0.3
# So many meshes follow the first one, with as many times its elements, or as many in a small problem; at most so many.
MOST_MESHES, MOST_TIMES, SMALL_ELEMENTS, MOST_ELEMENTS = 8, 8, 200, 1000
# Up to so many elements may have no solution where twice as many have one.
FEW_ELEMENTS = 20
# Iterations times elements of all of them: a multiple of that of the first solve, or a small problem's.
EFFORT, SMALL_EFFORT = 10, 30_000
# Iterations of one solve, or as many as before: it starts from the answer on the mesh before but may be unlucky.
_FEWEST = 300
# An objective on a finer mesh that is worse by more than this many estimated errors is that of another local optimum,
# unless the motion before had an error above this, and was none of the equations.
_TRUST, _INEXACT = 10.0, 1e-2
# Over so many meshes errors have to fall to this part at least, once that of the objective is as small as this.
_STALLED_MESHES, _FALLS, _KNOWN = 3, 0.9, 1e-3


@dataclass(frozen=True)
class MeshPlan:
    """What finer meshes have to reach, and what they may take.

    Attributes
    ----------
    tolerances : MeshTolerances
    aimed : float
        The part of the tolerances that a finer mesh aims at.
    meshes, elements : int
        Solves at most, and elements of all phases.
    effort : float
        Iterations times elements of all further solves.
    deadline : Deadline
    """

    tolerances: MeshTolerances
    aimed: float
    meshes: int
    elements: int
    effort: float
    deadline: Deadline


@dataclass(frozen=True, eq=False)
class MeshStep:
    """The answer on one mesh: elements of all phases, the result, and its errors."""

    elements: int
    result: SolveResult
    errors: MeshErrors

    @property
    def is_optimal(self) -> bool:
        """Whether it is an answer at all."""
        return self.result.quality is Quality.OPTIMAL


class MeshLoop:
    """Solves of one model on finer and finer meshes, in place, each from the answer on the mesh before.

    Parameters
    ----------
    model : Block
    settings : Settings
    start : PlanningPoint
        Where a solve that fails starts once more.
    plan : MeshPlan

    Attributes
    ----------
    steps : list of MeshStep
        Of all solves.
    remark : str
        What keeps the meshes; empty where nothing does.
    """

    def __init__(self, model: Any, settings: Settings, start: PlanningPoint, plan: MeshPlan) -> None:
        self._model, self._phases = model, phases_of(model)
        self._settings, self._start, self._plan, self._left = settings, start, plan, plan.effort
        self._boundaries = {phase.name: frozenset(phase.grid.mesh.boundaries) for phase in self._phases}
        self.steps: list[MeshStep] = []
        self.remark = ""

    def step(self, result: SolveResult) -> MeshStep:
        """Keep an answer that stands on the model."""
        self.steps.append(MeshStep(elements_of_phases(self._phases), result, _errors_of(result)))
        return self.steps[-1]

    def run(self, best: MeshStep) -> MeshStep:
        """Go on until the tolerances are met or nothing helps; the model holds the best answer, which is returned."""
        # Where a few elements had no solution, twice as many may.
        halved = not best.is_optimal
        if halved and not (best.result.stop_reason is StopReason.INFEASIBLE and best.elements <= FEW_ELEMENTS):
            return best
        while (meshes := self._next(best, halved)) is not None:
            point = PlanningPoint(self._model)
            try:
                with undone_on_failure(point.restore):
                    finer = self._on(meshes, best, FINER_MESH if best.is_optimal else None)
                    once_more = best.is_optimal and not halved and not finer.result.stop_reason.is_final
                    if once_more and not _replaces(finer, best, self._plan):
                        finer = self._on(meshes, best, {})
            except PyRobocopError as error:
                logger.info("'%s' cannot be solved on a finer mesh: %s", self._model.name, error)
                return best
            if _replaces(finer, best, self._plan):
                best, halved = finer, False
                continue
            point.restore()
            if halved or finer.result.stop_reason.is_final:
                return best
            halved = True  # another mesh, near to the last one that was solved
        return best

    def _next(self, best: MeshStep, halved: bool) -> dict[str, Mesh] | None:
        """The next meshes; None where it ends."""
        plan = self._plan
        now = {phase.name: phase.grid.mesh for phase in self._phases}
        if best.is_optimal and not best.errors.ratio(plan.tolerances) > 1.0:  # or not known
            return None
        if halved:
            meshes = {name: halves_of(mesh) for name, mesh in now.items()}
        else:
            trajectories = {phase.name: phase.trajectory() for phase in self._phases}
            aimed = plan.tolerances.scaled(plan.aimed)
            meshes = best.errors.finer(now, trajectories, aimed, keep=self._boundaries)
        count = sum(mesh.elements for mesh in meshes.values())
        at_an_end = (
            best.result.stop_reason is StopReason.INTERRUPTED
            or plan.deadline.has_passed
            or len(self.steps) >= plan.meshes
            or count > min(plan.elements, self._left)
            or meshes == now
            or _stalls(self.steps, plan.tolerances)
        )
        return None if at_an_end else meshes

    def _on(self, meshes: dict[str, Mesh], best: MeshStep, options: Mapping[str, Any] | None) -> MeshStep:
        """The answer on meshes: from the values on the model where there are options for that, else from the start."""
        if not options:
            self._start.restore()
        try:
            remesh_phases({phase: meshes[phase.name] for phase in self._phases})
        except PyRobocopError as error:
            self.remark = f"{KEPT_MESH}: {error}"
            raise
        count, strategies = elements_of_phases(self._phases), self._settings.strategies
        if options is not None:
            most = max(1, min(max(_FEWEST, best.result.iterations), int(self._left / count)))
            strategies = (replace(SOLVE, name="finer mesh", options={**options, "max_iter": most}),)
        step = self.step(solve_model(self._model, replace(self._settings, strategies=strategies, exploration=0.0)))
        self._left -= count * step.result.iterations
        logger.info("'%s' on %d elements: %s", self._model.name, count, step.result.one_line())
        return step


def elements_of_phases(phases: Sequence[Any]) -> int:
    """Of all phases together."""
    return sum(phase.grid.mesh.elements for phase in phases)


def _replaces(finer: MeshStep, before: MeshStep, plan: MeshPlan) -> bool:
    """Whether an answer is no worse than that on the mesh before, which may have flattered itself."""
    if not (finer.is_optimal and before.is_optimal):
        return finer.is_optimal
    explained = 0.0
    for step in (finer, before):
        error = step.errors.motion if np.isnan(step.errors.objective) else step.errors.objective
        explained += float(np.nan_to_num(error)) * abs(step.result.objective)
    worse = finer.result.standing.cost - before.result.standing.cost
    inexact = before.errors.motion > max(plan.tolerances.motion, _INEXACT)
    return inexact or not worse > _TRUST * explained


def _stalls(steps: Sequence[MeshStep], tolerances: MeshTolerances) -> bool:
    """Whether the last meshes, with twice the elements, brought nothing; where the cost is not known yet they may."""
    *before, last = steps[-_STALLED_MESHES - 1 :]
    if len(before) < _STALLED_MESHES or last.elements < 2 * before[0].elements or not last.errors.objective < _KNOWN:
        return False
    return last.errors.ratio(tolerances) > _FALLS * min(step.errors.ratio(tolerances) for step in before)


def solve_on_finer_meshes(model: Any, tolerance: float, settings: Settings) -> SolveResult:
    """Solve a model, and on finer meshes where its answer says that its errors are too large.

    Parameters
    ----------
    model : Block
        Its values are the initial guess. It holds the best answer afterwards.
    tolerance : float
        Of the objective and of limits of states, as parts of their sizes; the motion may err by `MOTION` times as much.
    settings : Settings
    """
    phases = phases_of(model)
    refines = bool(phases) and not any(map(why_its_mesh_is_stated, phases))
    guess = VariableValues.of_free(model) if refines else None
    first = solve_model(model, settings)
    through_pairs = first.residuals or first.strategy == ABSOLUTE_VALUES.name
    if guess is None or through_pairs or not (first.solved or first.stop_reason is StopReason.INFEASIBLE):
        return first
    tolerances = MeshTolerances(MOTION * tolerance, tolerance, tolerance)
    if first.solved and not _errors_of(first).ratio(tolerances) > 1.0:  # or not known
        return first
    answer = guess.read()
    guess.restore()
    start = PlanningPoint(model)
    guess.write(answer)

    count = elements_of_phases(phases)
    plan = MeshPlan(
        tolerances, AIMED, MOST_MESHES + 1, min(max(MOST_TIMES * count, SMALL_ELEMENTS), MOST_ELEMENTS),
        max(SMALL_EFFORT, EFFORT * count * first.iterations), settings.deadline,
    )  # fmt: skip
    loop = MeshLoop(model, settings, start, plan)
    best = loop.run(loop.step(first))
    return _joined(best, loop, tolerance)


def _errors_of(result: SolveResult) -> MeshErrors:
    return MeshErrors.of(result.discretisation)


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
