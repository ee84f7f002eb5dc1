"""Another mesh for phases that stand on a model, in place; everything that was stated over their times follows.

What the phases themselves state is made anew from the templates of their rules (`Restatement`), and blocks of this
package that stand on their times follow (`Followers`). No function of the user's is called again: a rule that was asked
at each point, or a component of the user's own over the times, keeps the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from typing import Any

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.constraint import IndexedConstraint

from pyrobocop_pyomo.complementarity.record import records_below
from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.bulk_parts import parts_taken_off
from pyrobocop_pyomo.modeling.in_place_changes import InPlaceChanges
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.rules.rule_template import same_results

from .asked_by_point import asked_by_point
from .declarations import Bounds, Control
from .followers import Followers, inner_variables
from .horizon import make_mesh
from .restatement import Restatement


def remesh_phases(meshes: Mapping[Any, Any]) -> None:
    """Give phases of one model other meshes, in place.

    Components stay the objects that they are, and so do the variables at times that stay: what reads
    ``b.x[b.final_time]`` goes on working. New variables have the values of the trajectory that stands on the model,
    new rows come from what the rules said for all times when they were stated: none is called again. Phases whose rules
    read each other's variables have to be given at once.

    Parameters
    ----------
    meshes : mapping of PhaseBlock to mesh
        Each a number of elements, element boundaries in the phase's time indices, or a `Mesh`.

    Raises
    ------
    ModelError
        Naming what keeps the mesh: a rule that was asked at each point, a component of the user's own over the times or
        that reads them, rows that were changed, rules that a pickle has lost, a relaxation that is applied. The model
        is as it was.
    ModelError
        When a mesh is none, or does not fit the phase.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.move = rcp.PhaseBlock(duration=1.0, elements=4)
    >>> m.move.x, m.move.v = rcp.State(initial=0, final=1), rcp.Control()
    >>> _ = m.move.ode(lambda b, t: {b.x: b.v[t]})
    >>> m.effort = pyo.Objective(expr=m.move.integral(lambda b, t: b.v[t] ** 2))
    >>> rcp.remesh_phases({m.move: [0, 0.1, 0.25, 0.5, 1]})
    >>> m.move.grid.mesh.boundaries
    (0.0, 0.1, 0.25, 0.5, 1.0)
    """
    asked = _other_grids(meshes)
    if not asked:
        return
    model = asked[0][0].model()
    for phase, grid in asked:
        if phase.model() is not model:
            raise ModelError(f"phase '{phase.name}' is of another model than '{asked[0][0].name}'.")
        for name in phase.record.names(Control):  # knots have to be element boundaries
            phase.record.declarations[name].nodes(name, grid, f"phase '{phase.name}': control '{name}'")
    if (reason := _reason(model, [phase for phase, _ in asked])) is not None:
        raise ModelError(reason)
    _restate(model, asked)


def put_on_meshes(meshes: Mapping[Any, Any]) -> None:
    """As `remesh_phases`, where it is known that nothing keeps the meshes.

    Parameters
    ----------
    meshes : mapping of PhaseBlock to mesh
    """
    if asked := _other_grids(meshes):
        _restate(asked[0][0].model(), asked)


def _other_grids(meshes: Mapping[Any, Any]) -> list[tuple[Any, Grid]]:
    """The phases that get another grid than they have, with these."""
    wanted = [(phase, _grid(phase, mesh)) for phase, mesh in meshes.items()]
    return [(phase, grid) for phase, grid in wanted if grid.mesh != phase.grid.mesh]


def rows_taken_off(phase: Any) -> AbstractContextManager[list[Any]]:
    """Take the rows that a phase has stated off it for a while, as for a copy with another mesh, which states its own.

    Those of a component of which some are deactivated stay, since the new ones will be so too. Gives the others.
    """
    record = phase.record
    names = (*record.generated_rows, *(statement.name for statement in record.statements))
    components = [phase.component(name) for name in dict.fromkeys(names)]
    return parts_taken_off(
        (component, {})
        for component in components
        if isinstance(component, IndexedConstraint) and all(row.active for row in component.values())
    )


def free_element_widths(phases: Iterable[Any], factors: Bounds) -> None:
    """Let the element boundaries of phases be found, in place, as if they had been built with free element widths.

    Time indices stay as they are: they name the points and are no times any more, which `PhaseBlock.time_at` gives.

    Parameters
    ----------
    phases : iterable of PhaseBlock
        Of one model. Those whose boundaries move already stay as they are.
    factors : (smallest, largest)
        Of each element's width.

    Raises
    ------
    ModelError
        Naming what cannot follow. Phases may be left half way then: this is for copies.
    """
    asked = [(phase, phase.grid) for phase in phases if not phase.record.free_widths]
    if not asked:
        return
    reason = _reason(asked[0][0].model(), [phase for phase, _ in asked])
    for phase, _ in asked:
        moving = [name for name, of in phase.record.declarations.items() if callable(getattr(of, "bounds", None))]
        if moving:
            reason = f"phase '{phase.name}': the bounds of '{moving[0]}' are given by the times of its points."
    if reason is not None:
        raise ModelError(reason)
    for phase, _ in asked:
        phase.record.normalised = phase.record.free_widths = True
        phase.record.width_factors = factors
    _restate(asked[0][0].model(), asked)


def _restate(model: Any, asked: list[tuple[Any, Grid]]) -> None:
    """Make everything that was stated over the times of phases anew, on the grids that they get."""
    with PauseGC(), InPlaceChanges() as changes:
        restated = [Restatement(phase, grid, changes) for phase, grid in asked]
        followers = Followers(model, restated, changes)
        try:
            _make_anew(restated)
            followers.follow()
        except PyRobocopError as error:
            if isinstance(error, ModelError):
                raise
            raise ModelError(
                f"{_names(asked)} keeps its mesh, since not everything can be stated on the new one: {error}"
            ) from error
        except (LookupError, ValueError, TypeError, ArithmeticError, AttributeError) as error:
            raise ModelError(
                f"{_names(asked)} keeps its mesh: what its rules say failed on the new one, by "
                f"{type(error).__name__}: {error}."
            ) from error
        changes.finish(model)


def _make_anew(restated: list[Restatement]) -> None:
    """State phases on the grids that they get, each after all have their times."""
    for restatement in restated:
        restatement.begin()
    for restatement in restated:
        restatement.state()
    for restatement in restated:
        restatement.finish()


def why_not_remeshed(phase: Any) -> str | None:
    """Why a phase cannot get another mesh in place, as far as can be told without trying; None where nothing is known.

    Parameters
    ----------
    phase : PhaseBlock
    """
    return _reason(phase.model(), [phase])


def _reason(model: Any, phases: list[Any]) -> str | None:
    """What keeps the meshes of phases: the first reason of all."""
    inner = inner_variables(phases)
    for phase in phases:
        if (reason := _own_reason(phase) or asked_by_point(phase) or _reads_inner_times(phase, inner)) is not None:
            return reason
    changes = InPlaceChanges()
    restated = [Restatement(phase, phase.grid, changes) for phase in phases]
    return Followers(model, restated, changes).reason() or _changed_rows(restated, changes)


def _reads_inner_times(phase: Any, inner: dict[int, Any]) -> str | None:
    for statement in phase.record.rules:
        for leaf in statement.readings(phase):
            if id(leaf) in inner:
                return (
                    f"phase '{phase.name}': its {statement.kind} '{statement.name}' reads '{leaf.name}' at all times, "
                    "which another mesh may not have. Write x.at(time), which follows the mesh."
                )
    return None


def _changed_rows(restated: list[Restatement], changes: InPlaceChanges) -> str | None:
    """A rule whose rows are not what it has said: phases are stated on the meshes that they have, and put back."""
    with PauseGC(), changes:
        try:
            _make_anew(restated)
            for component, index, before, now in changes.rewritten():
                if not same_results(before, now):
                    return (
                        f"'{component.name}[{index}]' is not what the rule of '{component.name}' said when it was "
                        "stated: rows that were changed since cannot be made for another mesh. State the rule anew."
                    )
        finally:
            changes.take_back()
    return None


def why_its_mesh_is_stated(phase: Any) -> str | None:
    """Why another mesh would make another problem of a phase: a control is held over its elements; None otherwise."""
    for name in phase.record.names(Control):
        control = phase.record.declarations[name]
        if control.parametrization != "collocated" and control.knots is None:
            return (
                f"They stay, since the control '{name}' is {control.parametrization.replace('_', ' ')} over its "
                "elements. Declare more elements, with knots=... for the control."
            )
    return None


def _own_reason(phase: Any) -> str | None:
    what = f"phase '{phase.name}'"
    record = phase.record
    for name in record.declarations:
        if phase.component(name) is None:
            return f"{what}: a transformation has taken its '{name}' away."
    if any(True for _ in records_below(phase.model())):
        return (
            f"{what}: the model '{phase.model().name}' is relaxed, and rows of the relaxation belong to single pairs. "
            "Revert the relaxation first."
        )
    return None


def _grid(phase: Any, mesh: Any) -> Grid:
    record = getattr(phase, "record", None)
    if record is None or not hasattr(phase, "points"):
        raise ModelError(f"'{getattr(phase, 'name', phase)}' is no PhaseBlock: only a phase has a mesh.")
    grid = phase.grid
    first, last = grid.mesh.boundaries[0], grid.mesh.boundaries[-1]
    elements, boundaries = (mesh, None) if isinstance(mesh, int) and not isinstance(mesh, bool) else (None, mesh)
    if boundaries is None and elements is None:
        raise ModelError(f"phase '{phase.name}': its new mesh is {mesh!r}; give elements or boundaries.")
    try:
        made = make_mesh(first, last, elements, boundaries)
    except ModelError as error:
        raise type(error)(f"phase '{phase.name}': {error}") from None
    ends = (first, *made.boundaries[1:-1], last)  # the very floats: they are indices
    return Grid(grid.scheme, type(made)(ends))


def _names(asked: list[tuple[Any, Grid]]) -> str:
    return "phase " + ", ".join(f"'{phase.name}'" for phase, _ in asked)
