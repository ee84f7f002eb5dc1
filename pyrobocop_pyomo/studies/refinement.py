"""`solve_refined`: solve on a coarse mesh, split the elements with large errors, start from the answer, repeat."""

from __future__ import annotations

import enum
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.var import Var

from pyrobocop_pyomo.discretisation import MeshErrors, MeshTolerances
from pyrobocop_pyomo.errors import ModelError, SolveFailed, TrajectoryError
from pyrobocop_pyomo.modeling.activity import is_inside
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of, remesh_phases
from pyrobocop_pyomo.solving import Quality, SolveResult
from pyrobocop_pyomo.solving.iterates import StopReason
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.trajectories import Trajectory

from .outcomes import (
    COMMON_COLUMNS,
    Column,
    Outcome,
    StudyResult,
    seconds_left,
    solve_as_given,
    table_header,
    table_row,
)

logger = logging.getLogger(__name__)


class RefinementEnd(enum.Enum):
    """Why refinement ended; the value is a sentence."""

    REACHED = "Every element's error is within the tolerance."
    UNKNOWN = (
        "What is known of the errors is within the tolerances, but not all of them are known. Compare with a finer "
        "mesh; objective_tolerance=float('inf') leaves the objective out."
    )
    MESH_LIMIT = "The limit of meshes was reached. Raise most_meshes, or start from a finer mesh."
    ELEMENT_LIMIT = "The next mesh would exceed the limit of elements. Raise most_elements or the tolerance."
    TIME_LIMIT = "The time limit was reached. Raise time_limit, or start from a finer mesh."
    INTERRUPTED = "Ctrl-C or the stop button interrupted the refinement."
    STALLED = (
        "Twice as many elements have not made the errors smaller: a control that jumps inside an element, or the "
        "solver's own accuracy, keeps them. Put a boundary where it jumps (mesh=), or raise the tolerance."
    )
    WORSE_OPTIMUM = (
        "Finer meshes lead to a worse local optimum; the best answer is kept. Start from it, or from a finer mesh."
    )
    FAILED = (
        "No acceptable point was found on this mesh. Start from another mesh or initial guess, or look with tee=True."
    )


@dataclass(frozen=True, eq=False)
class RefinementStep(Outcome):
    """One mesh.

    Attributes
    ----------
    elements : int
        Of all phases together.
    element_error : float
        Largest error of a state at the end of an element, or excess over bounds and path constraints of states between
        the points, relative to ``max(1, size)``; NaN where the solve failed.
    objective_error : float
        Estimated error of the objective, as a part of its size; NaN where it is not known.
    """

    elements: int
    element_error: float
    objective_error: float = math.nan

    def excess(self, tolerance: float, objective_tolerance: float) -> float:
        """How many times the larger of the two errors is what is allowed; infinite after a failure."""
        if not self.feasible or math.isnan(self.element_error):
            return math.inf
        return float(np.fmax(self.element_error / tolerance, self.objective_error / objective_tolerance))


@dataclass(frozen=True, eq=False, kw_only=True)
class RefinedResult(StudyResult[RefinementStep]):
    """One outcome per mesh, in order; `best` is the mesh of the model.

    That is the finest one, unless the solver failed there, was cut short, came to a worse local optimum, or the errors
    did not become smaller.

    Attributes
    ----------
    model : ConcreteModel
        On the mesh of `best`, holding its answer.
    trajectories : dict of phase name to Trajectory
        The answer.
    errors : dict of phase name to array, shape (N,)
        Errors of this mesh's elements; empty after a failure.
    tolerance, objective_tolerance : float
        What was asked for.
    end : RefinementEnd
        Why it ended.
    """

    model: Any = field(repr=False)
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    errors: Mapping[str, Array] = field(repr=False)
    tolerance: float
    objective_tolerance: float
    end: RefinementEnd
    _place: int = field(default=-1, repr=False)

    item = "mesh"
    numbered_by = "mesh"
    own_columns = (
        Column("elements", 8, lambda step: step.elements, "d"),
        Column("element_error", 9, lambda step: step.element_error, ".1e", heading="error"),
        Column("objective_error", 9, lambda step: step.objective_error, ".1e", heading="of cost"),
    )

    @property
    def best(self) -> RefinementStep:
        """The mesh whose answer is on the model."""
        return self.outcomes[self._place]

    @property
    def reached(self) -> bool:
        """True when every element's error and that of the objective are within the tolerances, at an optimal point."""
        return self.end is RefinementEnd.REACHED and self.result.solved

    @property
    def trajectory(self) -> Trajectory:
        """The answer, where one phase was refined.

        Raises
        ------
        TrajectoryError
            When there are several.
        """
        if len(self.trajectories) != 1:
            raise TrajectoryError(
                f"refined were {', '.join(self.trajectories)}: read trajectories['{next(iter(self.trajectories))}']."
            )
        return next(iter(self.trajectories.values()))

    def raise_for_status(self) -> None:
        """Do nothing when the tolerance was reached at an optimal point.

        Raises
        ------
        SolveFailed
            Otherwise; this object is its attribute ``result``.
        """
        if self.reached:
            return
        best, number = self.best, self._place % len(self.outcomes) + 1
        raise SolveFailed(
            f"'{self.name}': {' '.join((self.end.value, *self._unknown))} Mesh {number} has {best.elements} elements "
            f"and the error {best.element_error:.1e}; asked was {self.tolerance:g}. The objective's error is estimated "
            f"at {best.objective_error:.1e} of its size; asked was {self.objective_tolerance:g}. "
            f"{self.result.quality.value}",
            self,
        )

    def __str__(self) -> str:
        asked = f"Asked was {self.tolerance:g}, and {self.objective_tolerance:g} of the objective."
        return "\n".join([f"{self.name}: {self.end.value} {asked}", *self._unknown, self.table()])

    @property
    def _unknown(self) -> tuple[str, ...]:
        return self.result.discretisation.remarks if self.end is RefinementEnd.UNKNOWN else ()


def solve_refined(
    build: Callable[[Any], Any],
    tolerance: float = 1e-6,
    *,
    objective_tolerance: float = 1e-4,
    elements: int | Mapping[str, int] | None = None,
    mesh: Any = None,
    phases: Sequence[str] | None = None,
    join: bool = True,
    most_parts: int = 4,
    most_meshes: int = 12,
    most_elements: int = 2000,
    time_limit: float | None = None,
    time_limit_per_mesh: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> RefinedResult:
    """Solve on finer and finer meshes until the errors of the motion and of the objective are within tolerances.

    The error of an element is how far it ends from where the equations lead from its own start, under the controls
    found: `Verification.element_error`, here relative to the size of each state where that is above one. What each
    element adds to the error of the objective is estimated from multipliers (`SolveResult.discretisation`), and bounds
    and path constraints of states are looked at between the points as well. Elements with large shares of any of these
    are split, in all phases. Each mesh after the first starts from the answer on the one before; where
    that fails, from the model's own initial guess. The best mesh is kept, whatever the later ones give.

    Parameters
    ----------
    build : callable
        ``build(mesh)`` returns a model whose phase was made with ``PhaseBlock(..., mesh=mesh)``. First it is called
        with None, for which a `PhaseBlock` makes its default mesh. With ``phases``, it is called with a mapping of
        their names to meshes.
    tolerance : float
        Largest error of a state at the end of an element, and excess over bounds and path constraints of states: in the
        model's own units, or as a part of the state's largest value where that is above one.
    objective_tolerance : float
        Largest estimated error of the objective, as a part of its size; ``float("inf")`` not to refine on it. Where it
        is not known, as with pairs, refinement ends with `RefinementEnd.UNKNOWN`.
    elements : int or dict of str to int, optional
        Elements of a uniform first mesh.
    mesh : Mesh, sequence of float, or dict of str to such, optional
        The first mesh; in normalised time with a free duration.
    phases : sequence of str, optional
        Names of the phases whose meshes ``build`` takes, where the model has several. Others get theirs in place, by
        `remesh_phases`.
    join : bool
        Join neighbours with very small errors again; boundaries of the first mesh always stay.
    most_parts : int
        Into which one element is split at once.
    most_meshes, most_elements : int
        Where to stop without success.
    time_limit : float, optional
        Seconds, for all meshes together.
    time_limit_per_mesh : float, optional
        Seconds, for the solve on one mesh.
    progress : bool, optional
        Show a line per mesh; by default only on a terminal.
    **options
        For `solve`, on every mesh.

    Returns
    -------
    RefinedResult
        Also when the tolerance was not reached.

    Raises
    ------
    ModelError
        When `build` or the first mesh do not fit.
    TrajectoryError
        When the errors of a phase cannot be estimated.

    References
    ----------
    Haman & Rao, Adaptive mesh refinement and error estimation method for optimal control using direct collocation,
    arXiv:2410.07488; Patterson, Hager & Rao, A ph mesh refinement method for optimal control, doi:10.1002/oca.2114
    """
    if not callable(build):
        raise ModelError(
            f"solve_refined was given {type(build).__name__} '{getattr(build, 'name', build)}' to solve; expected a "
            "function that builds the model on any mesh: def build(mesh): ... PhaseBlock(..., mesh=mesh) ... return m, "
            "and solve_refined(build)."
        )
    if not (isinstance(tolerance, (int, float)) and 0 < tolerance < math.inf):
        raise ModelError(f"tolerance = {tolerance!r}; expected a positive number.")
    if not (isinstance(objective_tolerance, (int, float)) and objective_tolerance > 0):
        raise ModelError(f"objective_tolerance = {objective_tolerance!r}; expected a positive number.")
    if most_meshes < 1 or most_parts < 2:
        raise ModelError(f"most_meshes = {most_meshes!r} and most_parts = {most_parts!r}; at least 1 and 2 are needed.")
    deadline = Deadline.after(time_limit)
    builder = PhaseBuilder(build, phases)
    meshes = builder.first_meshes(elements, mesh)
    first_boundaries = {name: frozenset(first.boundaries) for name, first in meshes.items()}
    columns = (*RefinedResult.own_columns, *COMMON_COLUMNS)
    bar = Progress(progress)
    steps: list[RefinementStep] = []
    best: tuple[int, dict[str, Mesh], _Answer] | None = None
    halved = False
    while True:
        coarser = None if best is None else best[2]
        shown = {"progress": bar.within(f"mesh {len(steps) + 1}"), **options}
        step, found = _solve_on(builder, meshes, coarser, deadline, time_limit_per_mesh, shown)
        if not steps:
            bar.line(f"{found.model.name}: refining to {tolerance:g}")
            bar.line(table_header(columns, RefinedResult.numbered_by))
        steps.append(step)
        bar.line(table_row(columns, step, len(steps)))
        logger.info("mesh %d: %s", len(steps), step)
        if best is None or _replaces(step, steps[best[0]], tolerance, objective_tolerance):
            best = (len(steps) - 1, meshes, found)
        end = None
        if step.result is not None and step.result.stop_reason is StopReason.INTERRUPTED:
            end = RefinementEnd.INTERRUPTED
        elif not step.feasible and deadline.has_passed:
            end = RefinementEnd.TIME_LIMIT
        elif not step.feasible and (halved or not steps[best[0]].feasible or len(steps) >= most_meshes):
            end = RefinementEnd.FAILED
        elif steps[best[0]].excess(tolerance, objective_tolerance) <= 1.0:
            end = RefinementEnd.REACHED if best[2].knows(objective_tolerance) else RefinementEnd.UNKNOWN
        elif step.excess(tolerance, objective_tolerance) <= 1.0:
            end = RefinementEnd.WORSE_OPTIMUM
        elif len(steps) >= most_meshes:
            end = RefinementEnd.MESH_LIMIT
        elif _stalls(steps, tolerance, objective_tolerance):
            end = RefinementEnd.STALLED
        elif deadline.has_passed:
            end = RefinementEnd.TIME_LIMIT
        elif not step.feasible:
            halved = True  # another mesh, near to the last one that was solved
            meshes = {name: halves_of(mesh) for name, mesh in best[1].items()}
        else:
            meshes = found.of_mesh.finer(
                meshes,
                found.trajectories,
                MeshTolerances(tolerance, tolerance, objective_tolerance),
                keep=first_boundaries if join else None,
                most_parts=most_parts,
            )
        if end is None and sum(finer.elements for finer in meshes.values()) > most_elements:
            end = RefinementEnd.ELEMENT_LIMIT
        if end is not None:
            place, _, answer = best
            return RefinedResult(
                name=answer.model.name, outcomes=tuple(steps), seconds=sum(step.seconds for step in steps),
                model=answer.model, trajectories=answer.trajectories, errors=answer.errors,
                tolerance=float(tolerance), objective_tolerance=float(objective_tolerance), end=end, _place=place,
            )  # fmt: skip


# Estimated errors of the objective are right within this factor.
_TRUST = 10.0
# A solve that starts from the answer on the mesh before takes fewer iterations than the first did, but may be unlucky.
_FEWEST, _MORE = 300, 3
# Over so many meshes errors have to fall to this part at least, once that of the objective is as small as this.
_STALLED_MESHES, _FALLS, _KNOWN = 3, 0.9, 1e-3


def _stalls(steps: Sequence[RefinementStep], tolerance: float, objective_tolerance: float) -> bool:
    """Whether the last meshes, with twice the elements, brought nothing; where the cost is not known yet they may."""
    if len(steps) < _STALLED_MESHES + 1:
        return False
    *before, last = steps[-_STALLED_MESHES - 1 :]
    if last.elements < 2 * before[0].elements or not last.objective_error < _KNOWN:
        return False
    if any(abs(step.objective - last.objective) > _KNOWN * abs(last.objective) for step in before):
        return False  # on the way to another optimum
    return last.excess(tolerance, objective_tolerance) > _FALLS * min(
        step.excess(tolerance, objective_tolerance) for step in before
    )


def _replaces(step: RefinementStep, before: RefinementStep, tolerance: float, objective_tolerance: float) -> bool:
    """Whether the answer on a finer mesh is no worse than the best one until then.

    Its objective may be worse where the coarse one flattered itself, by as much as the errors of both explain; by more,
    it is that of another local optimum. A motion that is not that of the equations, or that passes its limits, flatters
    the objective too.
    """
    if step.result is None or before.result is None:
        return before.result is None
    ranks = [result.quality.rank for result in (step.result, before.result)]
    if ranks[0] != ranks[1] or not step.feasible:
        return ranks[0] > ranks[1]
    falls = step.excess(tolerance, objective_tolerance) <= before.excess(tolerance, objective_tolerance)
    known = [(of.objective_error + of.element_error) * abs(of.objective) for of in (step, before)]
    worse = step.result.standing.cost - before.result.standing.cost
    if abs(worse) > _TRUST * sum(known):  # false where the errors are not known
        return bool(worse < 0.0)
    return falls or not step.objective_error >= before.objective_error


@dataclass(frozen=True, eq=False)
class _Answer:
    """A solved model, the trajectories of its phases, and the errors of their elements.

    Those in `of_mesh` are relative to sizes.
    """

    model: Any
    trajectories: Mapping[str, Trajectory]
    errors: Mapping[str, Array]
    of_mesh: MeshErrors
    result: SolveResult

    def knows(self, objective_tolerance: float) -> bool:
        """Whether all errors that have a tolerance are known, in all phases."""
        of_phases = self.result.discretisation.phases
        every = all(name in of_phases and of_phases[name].excesses is not None for name in self.trajectories)
        return every and (objective_tolerance == math.inf or set(self.of_mesh.of_objective) == set(self.trajectories))


def _solve_on(
    builder: PhaseBuilder,
    meshes: dict[str, Mesh],
    coarser: _Answer | None,
    deadline: Deadline,
    time_limit: float | None,
    options: Mapping[str, Any],
) -> tuple[RefinementStep, _Answer]:
    """Solve from the coarser answer, and from the model's own initial guess where that leads nowhere."""
    started = time.perf_counter()

    def solved(model: Any, limits: Mapping[str, Any]) -> SolveResult:
        limit = seconds_left(deadline.within(time_limit))
        return solve_as_given(model, **{**options, **limits, "time_limit": limit})

    model = builder.model(meshes)
    if coarser is not None:
        _take_over(model, builder, coarser)
    result = solved(model, {} if coarser is None else _limits(coarser, options))
    if coarser is not None and _failed(result) and not deadline.has_passed:
        logger.info("'%s': no acceptable point from the last answer; once more from its own initial guess", model.name)
        once_more = builder.model(meshes)
        other = solved(once_more, {})
        if result.quality is Quality.INFEASIBLE or other.quality.rank >= result.quality.rank:
            model, result = once_more, other
    phases = {name: builder.phase(model, name) for name in builder.names}
    trajectories = {name: phase.trajectory() for name, phase in phases.items()}
    errors: dict[str, Array] = {}
    of_mesh = MeshErrors({}, {}, {}, math.nan)
    if result.quality is not Quality.INFEASIBLE:
        relative = {}
        for name, phase in phases.items():
            trajectory = trajectories[name]
            found = phase.reintegrate(trajectory)
            sizes = {state: max(1.0, float(np.abs(values).max())) for state, values in trajectory.states.items()}
            errors[name] = found.end_errors(found.local, trajectory)
            relative[name] = found.end_errors(found.local, trajectory, sizes)
        of_mesh = MeshErrors.of(result.discretisation, relative)
    step = RefinementStep(
        sum(mesh.elements for mesh in meshes.values()),
        float(np.fmax(of_mesh.motion, of_mesh.limits)),
        of_mesh.objective,
        result=result,
        seconds=time.perf_counter() - started,
    )
    return step, _Answer(model, trajectories, errors, of_mesh, result)


def _limits(coarser: _Answer, options: Mapping[str, Any]) -> dict[str, Any]:
    """Of a solve that starts from an answer: without pairs, no second tries and not many more iterations."""
    special = coarser.result.residuals or coarser.result.safety is not None
    if special or "strategies" in options or "schedule" in options:
        return {}
    of_ipopt = dict(options.get("options") or {})
    of_ipopt.setdefault("max_iter", max(_FEWEST, _MORE * coarser.result.iterations))
    return {"strategies": ("solve",), "options": of_ipopt}


def _failed(result: SolveResult) -> bool:
    """Whether another start may do better."""
    ended = result.stop_reason.is_final
    return not ended and (result.quality is Quality.INFEASIBLE or result.stop_reason is StopReason.ITERATION_LIMIT)


def _take_over(model: Any, builder: PhaseBuilder, coarser: _Answer) -> None:
    """Start from an answer: phases by interpolation, variables elsewhere by their names."""
    refined = [builder.phase(coarser.model, name) for name in builder.names]
    for block in coarser.model.block_data_objects(active=True, descend_into=Block):
        if any(block is phase or is_inside(block, phase) for phase in refined):
            continue
        for variable in block.component_data_objects(Var, descend_into=False):
            same = ComponentUID(variable, context=coarser.model).find_component_on(model)
            if same is not None and same.ctype is Var and not same.is_indexed() and not same.fixed:
                same.set_value(variable.value, skip_validation=True)
    for name in builder.names:
        builder.phase(model, name).initialize(coarser.trajectories[name])


class PhaseBuilder:
    """The user's function of one mesh or of several, and the phases of what it returns.

    Parameters
    ----------
    build : callable
        Takes a mesh, or a mapping of phase names to meshes where the phases are named; returns a model.
    phases : sequence of str, optional
        Names of the phases whose meshes the function takes; the only one of the model by default.

    Attributes
    ----------
    names : list of str
        Of all phases of the model; those whose meshes the function does not take are given theirs in place.
    """

    def __init__(self, build: Callable[[Any], Any], phases: Sequence[str] | None) -> None:
        if isinstance(phases, str):
            raise ModelError(f"phases = {phases!r}; expected a list of names, such as [{phases!r}].")
        self._build = build
        self._named = None if phases is None else list(phases)
        self.names: list[str] = [] if phases is None else list(phases)

    def first_meshes(self, elements: Any, mesh: Any) -> dict[str, Mesh]:
        """Call the user's function once to learn what the phases are and when they happen."""
        if elements is not None and mesh is not None:
            raise ModelError("elements and mesh are given; one of them says what the first mesh is.")
        model = self._call(None if self._named is None else dict.fromkeys(self._named))
        found = [phase.name for phase in phases_of(model)]
        if self._named is None and len(found) != 1:
            raise ModelError(
                f"build(mesh) returned a model with {len(found)} phases: {', '.join(found) or 'none'}. Pass "
                "phases=[...], and build will be called with a mapping of their names to meshes."
            )
        self.names.extend(name for name in found if name not in self.names)
        meshes = {name: self.phase(model, name).grid.mesh for name in self.names}
        for given, make in ((elements, _uniform), (mesh, _given)):
            if given is not None:
                wanted = given if isinstance(given, Mapping) else dict.fromkeys(self._named or self.names, given)
                unknown = [name for name in wanted if name not in meshes]
                if unknown:
                    raise ModelError(f"a first mesh for '{unknown[0]}'; refined are {', '.join(self.names)}.")
                meshes |= {name: make(meshes[name], said) for name, said in wanted.items()}
        return meshes

    def model(self, meshes: dict[str, Mesh]) -> Any:
        """The user's model on given meshes."""
        taken = meshes if self._named is None else {name: meshes[name] for name in self._named}
        model = self._call(meshes[self.names[0]] if self._named is None else dict(taken))
        remesh_phases({self.phase(model, name): mesh for name, mesh in meshes.items() if name not in taken})
        for name, mesh in taken.items():
            made = self.phase(model, name).grid.mesh
            if made != mesh:
                raise ModelError(
                    f"build(mesh) made phase '{name}' with {made.elements} elements; the mesh it was called with has "
                    f"{mesh.elements}. Pass it on: PhaseBlock(..., mesh=mesh)."
                )
        return model

    def phase(self, model: Any, name: str) -> Any:
        """A phase by its name.

        Raises
        ------
        ModelError
            When the model has none of this name.
        """
        phase = model.find_component(name)
        if not isinstance(phase, PhaseBlockData):
            raise ModelError(f"build(...) returned the model '{model.name}', which has no phase '{name}'.")
        return phase

    def _call(self, meshes: Any) -> Any:
        model = self._build(meshes)
        if not hasattr(model, "block_data_objects"):
            raise ModelError(f"build(mesh) returned a {type(model).__name__}; expected a model. Is 'return m' missing?")
        return model


def _uniform(mesh: Mesh, elements: int) -> Mesh:
    return Mesh.uniform(mesh.boundaries[0], mesh.boundaries[-1], elements)


def _given(mesh: Mesh, boundaries: Any) -> Mesh:
    return boundaries if isinstance(boundaries, Mesh) else Mesh.given(boundaries)
