"""Finer meshes, in place, where an answer says of itself that its mesh makes too large an error."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.discretisation import MeshErrors, MeshTolerances
from pyrobocop_pyomo.errors import PyRobocopError, RemeshingError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_its_mesh_is_stated, why_not_remeshed
from pyrobocop_pyomo.solving.ipopt_options import FINER_MESH
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.procedure import solve_model
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
# An objective on a finer mesh that is worse by more than this many estimated errors is that of another local optimum.
_TRUST = 10.0


class FinerMeshes:
    """The meshes of one solve, which get finer until the errors of its answer are within a tolerance.

    Parameters
    ----------
    model : Block
        Its values are the initial guess.
    tolerance : float
        Of the objective and of limits of states, as parts of their sizes; the motion may err by `MOTION` times as much.
    settings : Settings
    """

    def __init__(self, model: Any, tolerance: float, settings: Settings) -> None:
        self._model, self._settings = model, settings
        phases = phases_of(model)
        self._phases = [] if any(map(why_its_mesh_is_stated, phases)) else phases
        self._tolerances = MeshTolerances(MOTION * tolerance, tolerance, tolerance)
        self._guess = VariableValues.of_free(model) if self._phases else None
        self._remark = ""

    def solve(self) -> SolveResult:
        """Solve the model, and again on finer meshes, warm; the model holds the best answer, which is returned."""
        first = solve_model(self._model, self._settings)
        through_pairs = first.residuals or first.strategy == ABSOLUTE_VALUES.name
        infeasible = first.stop_reason is StopReason.INFEASIBLE
        if self._guess is None or through_pairs or not (first.solved or infeasible):
            return first
        if first.solved and not self._errors(first).ratio(self._tolerances) > 1.0:  # or not known
            return first
        self._results = [first]
        self._first_elements = self._elements()
        self._left = max(SMALL_EFFORT, EFFORT * self._first_elements * first.iterations)
        self._first_boundaries = {phase.name: frozenset(phase.grid.mesh.boundaries) for phase in self._phases}
        answer = self._guess.read()
        self._guess.restore()
        self._start = PlanningPoint(self._model)
        self._guess.write(answer)
        if infeasible:
            return self._on_halves(first)
        return self._joined(self._refined(first))

    def _on_halves(self, first: SolveResult) -> SolveResult:
        """Where a few elements had no solution, twice as many may: solve there once, from the guess."""
        point, meshes = PlanningPoint(self._model), self._halves()
        if self._first_elements > FEW_ELEMENTS or meshes is None:
            return first
        self._start.restore()
        if self._remeshed(meshes):
            try:
                finer = self._solved(first, {}, second_tries=True)
                if finer.solved:
                    return self._joined(self._refined(finer))
            except BaseException as error:
                self._give_up(point, error)
                return first
        point.restore()
        return first

    def _refined(self, best: SolveResult) -> SolveResult:
        """Go on until the tolerances are met, no mesh is better, or the effort is spent."""
        halved = False
        while True:
            errors = self._errors(best)
            if not errors.ratio(self._tolerances) > 1.0:
                return best
            meshes = self._halves() if halved else self._finer(errors)
            point = PlanningPoint(self._model)
            if meshes is None or not self._remeshed(meshes):
                return best
            try:
                finer = self._solved(best, FINER_MESH)
                if not self._replaces(finer, best) and not halved and not finer.stop_reason.is_final:
                    self._start.restore()
                    remesh_phases(self._of_phases(meshes))
                    finer = self._solved(best, {})
            except BaseException as error:
                self._give_up(point, error)
                return best
            if self._replaces(finer, best):
                best, halved = finer, False
                continue
            point.restore()
            if halved or finer.stop_reason.is_final:
                return best
            halved = True  # another mesh, near to the last one that was solved

    def _give_up(self, point: PlanningPoint, error: BaseException) -> None:
        """Go back to a point where another mesh ended with an error; what is none of this package's goes on."""
        point.restore()
        if not isinstance(error, PyRobocopError):
            raise error
        logger.info("'%s' cannot be solved on a finer mesh: %s", self._model.name, error)

    @staticmethod
    def _errors(result: SolveResult) -> MeshErrors:
        return MeshErrors.of(result.discretisation)

    def _of_phases(self, meshes: dict[str, Mesh]) -> dict[Any, Mesh]:
        return {phase: meshes[phase.name] for phase in self._phases}

    def _elements(self) -> int:
        return sum(phase.grid.mesh.elements for phase in self._phases)

    def _finer(self, errors: MeshErrors) -> dict[str, Mesh] | None:
        meshes = {phase.name: phase.grid.mesh for phase in self._phases}
        trajectories = {phase.name: phase.trajectory() for phase in self._phases}
        aimed = self._tolerances.scaled(AIMED)
        return self._allowed(errors.finer(meshes, trajectories, aimed, keep=self._first_boundaries))

    def _halves(self) -> dict[str, Mesh] | None:
        meshes = {phase.name: phase.grid.mesh for phase in self._phases}
        return self._allowed({name: halves_of(mesh) for name, mesh in meshes.items()})

    def _allowed(self, meshes: dict[str, Mesh]) -> dict[str, Mesh] | None:
        """The meshes, unless they are too many or too fine."""
        count = sum(mesh.elements for mesh in meshes.values())
        most = min(max(MOST_TIMES * self._first_elements, SMALL_ELEMENTS), MOST_ELEMENTS)
        if len(self._results) > MOST_MESHES or count > most or self._left < count or self._settings.deadline.has_passed:
            return None
        return None if meshes == {phase.name: phase.grid.mesh for phase in self._phases} else meshes

    def _remeshed(self, meshes: dict[str, Mesh]) -> bool:
        """Whether the phases can have these meshes; they have them then."""
        try:
            for phase in self._phases:
                if (reason := why_not_remeshed(phase)) is not None:
                    raise RemeshingError(reason)
            remesh_phases(self._of_phases(meshes))
        except PyRobocopError as error:
            self._remark = f"The mesh stays as it is: {error}"
            return False
        return True

    def _solved(self, before: SolveResult, options: Mapping[str, Any], *, second_tries: bool = False) -> SolveResult:
        """The answer from the values on the model."""
        count = self._elements()
        iterations = max(1, min(max(_FEWEST, before.iterations), self._left // count))
        again = (replace(SOLVE, name="finer mesh", options={**options, "max_iter": iterations}),)
        strategies = self._settings.strategies if second_tries else again
        result = solve_model(self._model, replace(self._settings, strategies=strategies, exploration=0.0))
        self._left -= count * result.iterations
        self._results.append(result)
        logger.info("'%s' on %d elements: %s", self._model.name, count, result.one_line())
        return result

    def _replaces(self, finer: SolveResult, before: SolveResult) -> bool:
        """Whether an answer is no worse than that on the mesh before, which may have flattered itself."""
        if finer.quality is not Quality.OPTIMAL:
            return False
        errors = self._errors(finer), self._errors(before)
        explained = sum(
            np.nan_to_num(of.objective) * abs(result.objective)
            for of, result in zip(errors, (finer, before), strict=True)
        )
        worse = finer.standing.cost - before.standing.cost
        inexact = errors[1].motion > self._tolerances.motion  # the motion before was none of the equations
        return inexact or not worse > _TRUST * explained

    def _joined(self, best: SolveResult) -> SolveResult:
        """The best answer, with the steps of all, and what became of the mesh."""
        first, results = self._results[0], self._results
        remarks = [*best.remarks, *([self._remark] if self._remark else [])]
        elements = self._elements()
        if best is first and len(results) > 1:
            remarks.append(f"Finer meshes than that of {elements} elements led to nothing better.")
        elif best is not first:
            remarks.append(
                f"The mesh was refined from {self._first_elements} to {elements} elements: "
                + (
                    f"the first answer, {first.objective:.6g}, was not exact enough "
                    f"(mesh_tolerance={self._tolerances.objective:g})."
                    if first.solved
                    else "on the first one no solution was found."
                )
            )
        interrupted = results[-1].stop_reason is StopReason.INTERRUPTED
        return replace(
            with_steps_of_all(best, results),
            remarks=tuple(remarks),
            stop_reason=results[-1].stop_reason if interrupted else best.stop_reason,
        )
