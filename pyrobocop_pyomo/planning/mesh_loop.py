"""One loop over meshes: a model is solved, something says on which mesh it should be solved again, and it is.

A `MeshPlan` says which meshes and why. What is stated at single times gives the first ones, before any solve; then the
errors of an answer, equations that lead a plan among obstacles astray, or pairs that switch inside elements do.
`MeshLoop` solves on them in place, and takes back what leads to nothing better.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from pyrobocop_pyomo.discretisation.estimates import SMALL_MOTION_ERROR
from pyrobocop_pyomo.discretisation.first_meshes import MOST_ELEMENTS, MOST_TIMES
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.motion.equations_motion import needed_reductions
from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.mesh import halves_of, remesh
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.reintegration import SMALLEST_SCALE, Reintegration, reintegrate
from pyrobocop_pyomo.phases.remeshing import put_on_meshes, remesh_phases, why_its_mesh_is_stated
from pyrobocop_pyomo.solving.ipopt_options import FINER_MESH, ITERATIONS_OF_ONE, SIDE_ITERATIONS
from pyrobocop_pyomo.solving.iterates import Quality, StopReason
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.result_text import KEPT_MESH
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.starts import EXPLORED_ELEMENTS, elements_of
from pyrobocop_pyomo.solving.strategies import ABSOLUTE_VALUES, SOLVE, Settings
from pyrobocop_pyomo.trajectories import Trajectory

from .recovery import PlanningPoint

logger = logging.getLogger(__name__)

# What is aimed at, as a part of what is tolerated: estimates are right within a factor, and one solve more costs more
# than some elements.
AIMED = 0.3
# Meshes have at most `MOST_TIMES` the elements of the first one, or as many as a small problem may have.
SMALL_ELEMENTS = 200
# Iterations times elements of all of them: a multiple of that of the first solve, or a small problem's.
EFFORT, SMALL_EFFORT = 10, 30_000
# Of a clearance: equations that lead farther away from the plan call for a finer mesh.
LARGEST_SHARE = 0.25
# An objective on a finer mesh that is worse by more than this many estimated errors is that of another local optimum,
# unless the motion before was none of the equations.
_TRUST = 10.0


@dataclass(frozen=True, eq=False)
class MeshPlan:
    """Meshes that phases of a model are to get.

    Attributes
    ----------
    meshes : mapping of PhaseBlock to Mesh
    why : {"errors", "safety", "switches"}
        What calls for them.
    """

    meshes: Mapping[Any, Mesh]
    why: Literal["errors", "safety", "switches"]

    def __str__(self) -> str:
        grown = (f"'{of.name}' from {of.grid.mesh.elements} to {mesh.elements}" for of, mesh in self.meshes.items())
        return f"elements of {', '.join(grown)}"


class MeshLoop:
    """Solves of one model on other meshes, in place.

    Parameters
    ----------
    model : Block

    Attributes
    ----------
    remark : str
        What keeps the meshes; empty where nothing does.
    has_ended : bool
        Whether another mesh cannot be had, or has led nowhere.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        self._checked = set[Any]()  # phases: boundaries that they have had stay, and nobody states anything meanwhile
        self.remark, self.has_ended = "", False

    def solve_on(
        self,
        plan: MeshPlan,
        solve: Callable[[], SolveResult | None],
        is_better: Callable[[SolveResult], bool],
        start: PlanningPoint | None = None,
    ) -> SolveResult | None:
        """The answer on the meshes of a plan; None where it is not better, and the model is as it was before then.

        Parameters
        ----------
        plan : MeshPlan
        solve : callable
            Solves the model, whose values are those of the motion before on the meshes of the plan.
        is_better : callable
            Whether an answer replaces the one before.
        start : PlanningPoint, optional
            Whose motion it is, where it is not the one on the model.
        """
        back = PlanningPoint(self._model)
        logger.info("'%s': %s, for %s", self._model.name, plan, plan.why)
        try:
            with undone_on_failure(back.restore):
                if start is not None:
                    start.restore()
                try:
                    put = put_on_meshes if plan.meshes.keys() <= self._checked else remesh_phases
                    put(plan.meshes)
                    self._checked |= plan.meshes.keys()
                except PyRobocopError as error:
                    self.keep_meshes(error)
                    raise
                found = solve()
        except PyRobocopError as error:
            logger.info("'%s' cannot be solved on another mesh: %s", self._model.name, error)
            self.has_ended = True
            return None
        if found is not None and is_better(found):
            return found
        back.restore()
        return None

    def keep_meshes(self, why: PyRobocopError) -> None:
        """Ask for no other mesh any more."""
        self.remark, self.has_ended = f"{KEPT_MESH}: {why}", True


class _FinerMeshes:
    """Answers on finer and finer meshes, each from the answer before.

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
    """

    def __init__(
        self, model: Any, settings: Settings, start: PlanningPoint, tolerance: float, first: SolveResult
    ) -> None:
        self._model, self._settings, self._start, self._tolerance = model, settings, start, tolerance
        self._phases = {phase.name: phase for phase in phases_of(model)}
        self._boundaries = {name: frozenset(phase.grid.mesh.boundaries) for name, phase in self._phases.items()}
        self._results, self._elements = [first], elements_of(model)
        self._most = min(max(MOST_TIMES * self._elements, SMALL_ELEMENTS), MOST_ELEMENTS)
        self._left = max(SMALL_EFFORT, EFFORT * self._elements * first.iterations)

    def best(self) -> SolveResult:
        """Refine until the tolerance is met or nothing helps; return the best answer, which is on the model."""
        loop, best = MeshLoop(self._model), self._results[0]
        # Where a few elements had no solution, twice as many may.
        halved = not _is_optimal(best)
        if halved and self._elements > EXPLORED_ELEMENTS:
            return best
        while (plan := self._next(best, halved)) is not None:
            states = self._states_of(best)
            from_answer = FINER_MESH, self._start if states else None, states
            tries: list[Any] = [from_answer, ({}, self._start, {})] if _is_optimal(best) else [(None, self._start, {})]
            for options, start, known in tries:
                solve = partial(self._solved, options, known)
                finer = loop.solve_on(plan, solve, partial(self._replaces, best), start=start)
                last = self._results[-1]
                was_in_vain = self._was_in_vain(best, last)
                is_last = halved or was_in_vain or loop.has_ended or last.stop_reason.is_final
                if finer is not None or is_last:
                    break
            # Where nothing was better: another mesh, near to the last one that was solved.
            best, halved = finer or best, finer is None
            if was_in_vain or (halved and is_last):
                break
        return self._joined(best, loop.remark)

    def _next(self, best: SolveResult, halved: bool) -> MeshPlan | None:
        """The next meshes; None where it ends."""
        now = {name: phase.grid.mesh for name, phase in self._phases.items()}
        if _is_optimal(best) and not best.discretisation.ratio(self._tolerance) > 1.0:  # or not known
            return None
        if halved:
            meshes = {name: halves_of(mesh) for name, mesh in now.items()}
        else:
            trajectories = {name: phase.trajectory() for name, phase in self._phases.items()}
            meshes = best.discretisation.finer(now, trajectories, AIMED * self._tolerance, keep=self._boundaries)
        plan = MeshPlan({self._phases[name]: mesh for name, mesh in meshes.items()}, "errors")
        at_an_end = (
            best.stop_reason is StopReason.INTERRUPTED
            or self._settings.deadline.has_passed
            or sum(mesh.elements for mesh in meshes.values()) > min(self._most, self._left)
            or meshes == now
        )
        return None if at_an_end else plan

    def _was_in_vain(self, before: SolveResult, finer: SolveResult) -> bool:
        """Whether a mesh has led to the same optimum, and to errors that are no smaller: these are none of the mesh.

        The same is what differs by no more than what is tolerated, and than the error that was said before.
        """
        found = before.discretisation
        same = min(self._tolerance * found.size, _estimated_errors(before))
        is_same = _is_optimal(before) and _is_optimal(finer) and abs(finer.objective - before.objective) <= same
        now = replace(finer.discretisation, size=found.size).ratio(self._tolerance)
        return is_same and not now < found.ratio(self._tolerance)

    def _states_of(self, best: SolveResult) -> dict[Any, Trajectory]:
        """What a finer mesh starts from beside the guess; of no phase where the whole answer is better.

        Where the best controls between the points would leave no error, and those of the answer lead the states
        elsewhere, these mean nothing there: they may turn by full circles from point to point.
        """
        nets = [of.net for of in best.discretisation.phases.values() if of.net is not None]
        are_wanting = abs(sum(nets)) > AIMED * self._tolerance * best.discretisation.size
        if are_wanting or not (_is_optimal(best) and _misses_its_equations(best)):
            return {}
        found = {phase: phase.trajectory() for phase in self._phases.values()}
        return {phase: replace(of, signals={}, piecewise_linear={}) for phase, of in found.items() if of.states}

    def _solved(self, options: Mapping[str, Any] | None, states: Mapping[Any, Trajectory]) -> SolveResult:
        """The answer on the meshes that there are now; without options by the strategies of a first solve."""
        for phase, trajectory in states.items():
            phase.initialize(trajectory)
        count, strategies = elements_of(self._model), self._settings.strategies
        if options is not None:
            # From the answer on another mesh a run that takes more than the one before hardly gets anywhere.
            usual = max(3 * SIDE_ITERATIONS, self._results[-1].iterations)
            most = max(1, min(ITERATIONS_OF_ONE, usual, int(self._left / count)))
            strategies = (replace(SOLVE, name="finer mesh", options={**options, "max_iter": most}),)
        result = solve_model(self._model, replace(self._settings, strategies=strategies, exploration=0.0))
        self._results.append(result)
        self._left -= count * result.iterations
        logger.info("'%s' on %d elements: %s", self._model.name, count, result.one_line())
        return result

    def _replaces(self, before: SolveResult, finer: SolveResult) -> bool:
        """Whether an answer is no worse than that on the mesh before, which may have flattered itself."""
        if not (_is_optimal(finer) and _is_optimal(before)):
            return _is_optimal(finer)
        if self._was_in_vain(before, finer):
            return _estimated_errors(finer) < _estimated_errors(before)
        worse = finer.standing.cost - before.standing.cost
        explained = _TRUST * _estimated_errors(finer, before)
        return _misses_its_equations(before) or not worse > explained

    def _joined(self, best: SolveResult, kept: str) -> SolveResult:
        """The best answer, with the steps of all, and what became of the mesh."""
        first, last, now = self._results[0], self._results[-1], elements_of(self._model)
        remarks = [*best.remarks, *filter(None, [kept])]
        if best is not first:
            why = (
                f"the first answer, {first.objective:.6g}, was not exact enough (mesh_tolerance={self._tolerance:g})."
                if first.solved
                else "on the first one no solution was found."
            )
            remarks.append(f"The mesh was refined from {self._elements} to {now} elements: {why}")
        elif last is not first and first.solved:
            remarks.append(f"Finer meshes than that of {now} elements led to nothing better.")
        interrupted = last.stop_reason is StopReason.INTERRUPTED
        return replace(
            with_steps_of_all(best, self._results),
            remarks=tuple(remarks),
            stop_reason=last.stop_reason if interrupted else best.stop_reason,
        )


def _is_optimal(result: SolveResult) -> bool:
    return result.quality is Quality.OPTIMAL


def _misses_its_equations(result: SolveResult) -> bool:
    """Whether the motion is known to be none of the equations."""
    return result.discretisation.largest_known_motion_error > SMALL_MOTION_ERROR


def _estimated_errors(*results: SolveResult) -> float:
    """Of the objectives, in sum; those of the motion where the former are not known."""
    total = 0.0
    for result in results:
        found = result.discretisation
        motion = float(np.nan_to_num(found.largest_known_motion_error)) * found.size
        total += motion if found.objective_error is None else found.objective_error
    return total


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
    stated = {phase.name: why for phase in phases if (why := why_its_mesh_is_stated(phase)) is not None}
    start = PlanningPoint(model) if phases and not stated else None
    first = solve_model(model, settings)
    through_pairs = first.residuals or first.strategy == ABSOLUTE_VALUES.name
    if not phases or through_pairs or not (first.solved or first.stop_reason is StopReason.INFEASIBLE):
        return first
    if first.solved and not first.discretisation.ratio(tolerance) > 1.0:  # or not known
        return first
    if start is None:
        kept = (f"{KEPT_MESH} in phase '{name}'. {why}" for name, why in stated.items())
        return replace(first, remarks=(*first.remarks, *kept))
    return _FinerMeshes(model, settings, start, tolerance, first).best()


# ------------------------------------------------------------------------- where equations lead away from what is safe


def plan_for_safety(reports: Mapping[Any, SafetyReport]) -> MeshPlan:
    """Finer meshes where the plan alone keeps its clearances; of no phase where none is needed, or fine enough.

    A margin covers a small distance between the plan and the motion of its equations. Where that distance is a large
    share of the clearance, a margin would cost room that only the mesh needs. Of linked phases it is the mesh of the
    one that errs, which may be an earlier one than that among the obstacles.

    Parameters
    ----------
    reports : mapping of ObstacleAvoidanceBlockData or ContainmentData to SafetyReport
        At the values on the model.

    Raises
    ------
    PyRobocopError
        When the motion of some equations is not known.
    """
    wanted: dict[Any, float] = {}
    for block, report in reports.items():
        reduction = _reduction(report)
        read = block.motion.phase if reduction < 1.0 else None
        for phase, needed in () if read is None else needed_reductions(read, reduction):
            wanted[phase] = min(needed, wanted.get(phase, 1.0))
    finer = {phase: _finer(phase, reduction) for phase, reduction in wanted.items()}
    known = {phase: mesh for phase, mesh in finer.items() if mesh is not None}
    return MeshPlan(known, "safety")


def _finer(phase: Any, reduction: float) -> Mesh | None:
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
                share = AIMED * LARGEST_SHARE * clearance / deviation if np.isfinite(deviation) else 0.01
                reduction = min(reduction, float(share))
    return reduction


def _errors_inside(motion: Reintegration) -> Array:
    """Largest difference inside each element, integrated from its own start, each state relative to its size."""
    inside = [
        np.abs(motion.local[name] - planned).max(axis=1) / (SMALLEST_SCALE + np.abs(planned).max())
        for name, planned in motion.planned.items()
    ]
    errors = np.max(inside, axis=0)
    finite = errors[np.isfinite(errors)]
    return np.where(np.isfinite(errors), errors, 10.0 * float(finite.max(initial=1.0)))
