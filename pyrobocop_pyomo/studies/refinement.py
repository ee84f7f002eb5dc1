"""`solve_refined`: solve on a coarse mesh, split the elements with large errors, start from the answer, repeat."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Mesh, remesh
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.trajectories import Trajectory

from .phase_builder import PhaseBuilder
from .refined_result import REFINEMENT_HEADER, RefinedResult, RefinementEnd, RefinementStep

logger = logging.getLogger(__name__)


def solve_refined(
    build: Callable[[Any], Any],
    tolerance: float = 1e-6,
    *,
    elements: int | Mapping[str, int] | None = None,
    mesh: Any = None,
    phases: Sequence[str] | None = None,
    join: bool = True,
    most_parts: int = 4,
    most_meshes: int = 12,
    most_elements: int = 2000,
    progress: bool | None = None,
    **options: Any,
) -> RefinedResult:
    """Solve on finer and finer meshes until every element's error is within a tolerance.

    The error of an element is how far it ends from where the equations lead from its own start, under the controls
    found: what `Verification.element_error` is the largest of. Each mesh after the first starts from the answer on the
    one before.

    Parameters
    ----------
    build : callable
        ``build(mesh)`` returns a model whose phase was made with ``PhaseBlock(..., mesh=mesh)``. First it is called
        with None, for which a `PhaseBlock` makes its default mesh. With ``phases``, it is called with a mapping of
        their names to meshes.
    tolerance : float
        Largest error of a state at the end of an element, in the model's own units.
    elements : int or dict of str to int, optional
        Elements of a uniform first mesh.
    mesh : Mesh, sequence of float, or dict of str to such, optional
        The first mesh; in normalised time with a free duration.
    phases : sequence of str, optional
        Names of the phases to refine, where the model has several.
    join : bool
        Join neighbours with very small errors again; boundaries of the first mesh always stay.
    most_parts : int
        Into which one element is split at once.
    most_meshes, most_elements : int
        Where to stop without success.
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
    if not (isinstance(tolerance, (int, float)) and 0 < tolerance < math.inf):
        raise ModelError(f"tolerance = {tolerance!r}; expected a positive number.")
    if most_meshes < 1 or most_parts < 2:
        raise ModelError(f"most_meshes = {most_meshes!r} and most_parts = {most_parts!r}; at least 1 and 2 are needed.")
    builder = PhaseBuilder(build, phases)
    meshes = builder.first_meshes(elements, mesh)
    kept = {name: frozenset(each.boundaries) for name, each in meshes.items()}
    bar = Progress(progress)
    steps: list[RefinementStep] = []
    last: tuple[Any, dict[str, Trajectory]] | None = None
    while True:
        started = time.perf_counter()
        model, result = _solve_from(builder, meshes, last, options)
        found = {name: builder.phase(model, name) for name in builder.names}
        usable = result.quality is not Quality.INFEASIBLE
        trajectories = {name: phase.trajectory() for name, phase in found.items()}
        errors = {name: phase.element_errors(trajectories[name]) for name, phase in found.items()} if usable else {}
        worst = max((float(each.max()) for each in errors.values()), default=math.nan)
        step = RefinementStep(
            elements=sum(each.elements for each in meshes.values()), error=worst, objective=result.objective,
            iterations=result.iterations, seconds=time.perf_counter() - started, quality=result.quality,
        )  # fmt: skip
        if not steps:
            bar.line(f"{model.name}: refining to {tolerance:g}")
            bar.line(REFINEMENT_HEADER)
        steps.append(step)
        bar.line(step.row(len(steps)))
        logger.info("mesh %d: %s", len(steps), step)
        last = model, trajectories
        end = None
        if not usable:
            end = RefinementEnd.FAILED
        elif worst <= tolerance:
            end = RefinementEnd.REACHED
        elif len(steps) >= most_meshes:
            end = RefinementEnd.MESH_LIMIT
        else:
            meshes = {
                name: remesh(
                    meshes[name], errors[name], tolerance, found[name].grid.scheme.order,
                    most_parts=most_parts, keep=kept[name] if join else None,
                )
                for name in meshes
            }  # fmt: skip
            if sum(each.elements for each in meshes.values()) > most_elements:
                end = RefinementEnd.ELEMENT_LIMIT
        if end is not None:
            return RefinedResult(
                model=model, result=result, trajectories=trajectories, errors=errors, steps=steps,
                tolerance=float(tolerance), end=end,
            )  # fmt: skip


def _solve_from(
    builder: PhaseBuilder, meshes: dict[str, Mesh], last: Any, options: Mapping[str, Any]
) -> tuple[Any, SolveResult]:
    """Build on the meshes and solve from the last answer, and from the model's own guess where that leads nowhere."""
    model = builder.model(meshes)
    if last is not None:
        _take_over(model, builder, *last)
    result = solve(model, **{"progress": False, **options})
    if last is not None and result.quality is Quality.INFEASIBLE:
        logger.info("'%s': no acceptable point from the last answer; once more from the model's own guess", model.name)
        model = builder.model(meshes)
        result = solve(model, **{"progress": False, **options})
    return model, result


def _take_over(model: Any, builder: PhaseBuilder, before: Any, trajectories: Mapping[str, Trajectory]) -> None:
    """Start from an answer: phases by interpolation, variables elsewhere by their names."""
    refined = {id(builder.phase(before, name)) for name in builder.names}
    for block in before.block_data_objects(active=True, descend_into=Block):
        if _within(block, refined):
            continue
        for variable in block.component_data_objects(Var, descend_into=False):
            same = ComponentUID(variable, context=before).find_component_on(model)
            if same is not None and same.ctype is Var and not same.is_indexed() and not same.fixed:
                same.set_value(variable.value, skip_validation=True)
    for name in builder.names:
        builder.phase(model, name).initialize(trajectories[name])


def _within(block: Any, blocks: set[int]) -> bool:
    while block is not None:
        if id(block) in blocks:
            return True
        block = block.parent_block()
    return False
