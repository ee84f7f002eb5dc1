"""Another mesh for phases that stand on a model, in place: the same declarations and templates on other points.

No function of the user's is called again. A rule that was asked at each point, or a component of the user's own that
stands on the times, keeps the mesh.

Values at times that stay are left alone, with their bounds and whether they are fixed. Others are interpolated: states
by the polynomial of the element, controls by theirs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Set
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.complementarity.record import records_below
from pyrobocop_pyomo.errors import ModelError, TrajectoryError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES
from pyrobocop_pyomo.modeling.blocks import BuiltBlockData
from pyrobocop_pyomo.modeling.in_place_changes import InPlaceChanges, expressions_of, state_anew
from pyrobocop_pyomo.modeling.pyomo_internals import put_part
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.templates.slots import Always
from pyrobocop_pyomo.templates.template import same_results
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Bounds, Control
from .delays import restate_values_at_times
from .equations import add_derivative, add_statement, restate_integrals
from .horizon import add_boundaries, make_mesh
from .nodes import IntervalNodes, KnotNodes, Nodes, StateNodes
from .phase_values import PhaseValues
from .record import PhaseRecord, Stated, note_stated
from .rule_formulas import asked_by_point
from .variables import add_variables

_REMEDY = (
    "State it on the phase (phase.constraint, phase.integral), give data over time as an rcp.Table, and read what "
    "follows the mesh: x.at(time), x.at_start, x.at_end."
)


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
    if not (grids := _other_grids(meshes)):
        return
    first = next(iter(grids))
    for phase, grid in grids.items():
        if phase.model() is not first.model():
            raise ModelError(f"phase '{phase.name}' is of another model than '{first.name}'.")
        for name in phase.record.names(Control):  # knots have to be element boundaries
            phase.record.declarations[name].nodes(name, grid, f"phase '{phase.name}': control '{name}'")
    if (reason := _reason(grids)) is not None:
        raise ModelError(reason)
    _restate(grids)


def put_on_meshes(meshes: Mapping[Any, Any]) -> None:
    """As `remesh_phases`, where it is known that nothing keeps the meshes.

    Parameters
    ----------
    meshes : mapping of PhaseBlock to mesh
    """
    if grids := _other_grids(meshes):
        _restate(grids)


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
    grids = {phase: phase.grid for phase in phases if not phase.record.free_widths}
    if not grids:
        return
    reason = _reason(grids)
    if reason is not None:
        raise ModelError(reason)
    for phase in grids:
        phase.record.normalised, phase.record.width_factors = True, factors
    _restate(grids)


def why_not_remeshed(phase: Any) -> str | None:
    """Why a phase cannot get another mesh in place, as far as can be told without trying; None where nothing is known.

    Parameters
    ----------
    phase : PhaseBlock
    """
    return _reason({phase: phase.grid})


def why_its_mesh_is_stated(phase: Any) -> str | None:
    """Why another mesh would make another problem of a phase: a control is held over its elements; None otherwise."""
    for name in phase.record.names(Control):
        control = phase.record.declarations[name]
        if control.parametrization != "collocated" and control.knots is None:
            return (
                f"The control '{name}' is {control.parametrization.replace('_', ' ')} over its elements. Declare more "
                "elements, with knots=... for the control."
            )
    return None


def _other_grids(meshes: Mapping[Any, Any]) -> dict[Any, Grid]:
    """The phases that get another grid than they have, with these."""
    wanted = {phase: _grid(phase, mesh) for phase, mesh in meshes.items()}
    return {phase: grid for phase, grid in wanted.items() if grid.mesh != phase.grid.mesh}


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


# ------------------------------------------------------------------------------------------------ what keeps a mesh


def _reason(grids: Mapping[Any, Grid]) -> str | None:
    """What keeps the meshes of phases: the first reason of all."""
    for phase in grids:
        for name in phase.record.declarations:
            if phase.component(name) is None:
                return f"phase '{phase.name}': a transformation has taken its '{name}' away."
        model = phase.model()
        if any(True for _ in records_below(model)):
            return (
                f"phase '{phase.name}': the model '{model.name}' is relaxed, and rows of the relaxation belong to "
                "single pairs. Revert the relaxation first."
            )
        if (reason := asked_by_point(phase)) is not None:
            return reason
    return _user_reading(model, grids) or _changed_part(grids)


def _user_reading(model: Any, grids: Mapping[Any, Grid]) -> str | None:
    """What of the user's stands on the times, or reads what another mesh may not have."""
    others = {id(part): "" for phase, grid in grids.items() for part in _only_on_this_mesh(phase, grid)}
    for phase in grids:
        for statement in phase.record.rules:
            formulas: Any = statement.rule.formulas(phase)
            for slot in formulas.slots:
                if isinstance(slot, Always) and id(slot.component) in others:
                    return (
                        f"phase '{phase.name}': its {statement.kind} '{statement.name}' reads '{slot.component.name}' "
                        "at all times, which another mesh may not have. Write x.at(time), which follows the mesh."
                    )
    times = _times_of(grids)
    for block in _built_blocks(model):
        if block.stands_on(times) and not block.can_follow_times:
            return (
                f"'{block.name}' stands on the times of a phase, and the rule of a pose or clearance of it has to "
                "know the time as a number. Write pyo.Expr_if for a branch, rcp.Table for data over time."
            )
    for component in _components_beside(model, grids):
        if component.is_indexed() and not component.is_reference():
            sets = component.index_set().subsets(expand_all_set_operators=True)
            if any(id(each) in times for each in sets):
                return (
                    f"'{component.name}' is indexed by the times of a phase, and nothing of it would be known at "
                    f"others. {_REMEDY}"
                )
    return _reading_of(model, grids, others)


def _reading_of(model: Any, grids: Mapping[Any, Grid], wanted: Mapping[int, str]) -> str | None:
    """The first part of a component beside the phases that reads what another mesh has not, in words.

    Parameters
    ----------
    model : Block
    grids : mapping of PhaseBlock to Grid
    wanted : mapping of identity to str
        Names of what has left the model, empty of what has its own.
    """
    made = [phase.component(name) for phase in grids for name in phase.record.made]
    expressions = [component for component in made if component is not None and component.ctype is Expression]
    leaves = wanted.keys() | {id(part) for component in expressions for part in component.values()}
    for component in _components_beside(model, grids) if wanted else ():
        parts = [] if component.is_reference() else [(part, expressions_of(part)) for part in component.values()]
        read = variables_in_any([each for _, held in parts for each in held], leaves)
        for part, held in parts if read.keys() & wanted.keys() else ():
            for found in variables_in_any(held, leaves).values():
                if id(found) in wanted:
                    name = wanted[id(found)]
                    return f"'{part.name}' reads '{name or found.name}', which another mesh may not have. {_REMEDY}"
    return None


def _only_on_this_mesh(phase: Any, grid: Grid) -> Iterator[Any]:
    """Variables of a phase, and expressions for controls, that another mesh may not have, or that mean more on it.

    States at element boundaries that the other grid has stay, and algebraics and controls at both ends: what names such
    a time means it.
    """
    record = phase.record
    boundaries = set(grid.mesh.boundaries).intersection(record.grid.mesh.boundaries)
    ends = {record.grid.mesh.boundaries[0], record.grid.mesh.boundaries[-1]}
    values = PhaseValues(phase)
    for name, nodes in values.nodes.items():
        if getattr(record.declarations.get(name), "knots", None) is not None:
            continue
        last = {nodes.times[-1]} if isinstance(nodes, IntervalNodes) else set()
        stay = boundaries if isinstance(nodes, StateNodes) else ends | last
        yield from (of for time, of in zip(nodes.times, values.variables[name], strict=True) if time not in stay)
        if isinstance(nodes, KnotNodes):
            yield from (seen for time, seen in phase.component(name).items() if time not in stay)
    if record.free_widths:
        yield from (of for number, of in phase.boundary.items() if 0 < number < record.grid.mesh.elements)


def _components_beside(model: Any, grids: Mapping[Any, Grid]) -> Iterator[Any]:
    """Components that neither these phases make anew nor a block that follows."""
    following = {id(block) for block in _built_blocks(model) if block.can_follow_times}
    for block in model.block_data_objects(active=None, descend_into=BLOCK_TYPES):
        home = block
        while home is not None and id(home) not in following:
            home = home.parent_block()
        if home is not None:
            continue
        made = block.record.made if block in grids else ()
        for component in block.component_map().values():
            is_content = component.ctype not in (*BLOCK_TYPES, Set, Suffix) and component.is_constructed()
            if is_content and component.local_name not in made:
                yield component


def _times_of(grids: Mapping[Any, Grid]) -> set[int]:
    return {id(each) for phase in grids for each in (phase.time, phase.points)}


def _built_blocks(model: Any) -> list[Any]:
    blocks = model.block_data_objects(active=None, descend_into=BLOCK_TYPES)
    return [block for block in blocks if isinstance(block, BuiltBlockData) and block.is_built]


def _changed_part(grids: Mapping[Any, Grid]) -> str | None:
    """A component of phases that does not hold what was stated, in words."""
    for phase in grids:
        for name, stated in phase.record.made.items():
            if (component := phase.component(name)) is None:
                continue
            now = Stated.of(component)
            changed = (
                index
                for index in now.expressions | stated.expressions
                if not same_results(now.expressions.get(index, []), stated.expressions.get(index, []))
            )
            if (index := next(changed, None)) is not None or now.parts != stated.parts:
                part = component.name if index is None else f"{component.name}[{index}]"
                return (
                    f"'{part}' is not what the rule of '{component.name}' said when it was stated: rows that "
                    "were changed since cannot be made for another mesh. State the rule anew."
                )
    return None


# -------------------------------------------------------------------------------------------------- the new mesh


def _restate(grids: Mapping[Any, Grid]) -> None:
    """Make everything that was stated over the times of phases anew, on the grids that they get."""
    model, times = next(iter(grids)).model(), _times_of(grids)
    followers = [block for block in _built_blocks(model) if block.stands_on(times) and block.can_follow_times]
    inside = [each for of in followers for each in of.block_data_objects(active=None, descend_into=BLOCK_TYPES)]
    with PauseGC(), InPlaceChanges([*grids, *inside]) as changes:
        phases = [PhaseOnGrid(phase, grid, changes) for phase, grid in grids.items()]
        for phase in phases:
            phase.begin()  # all have their times before the first is stated
        for phase in phases:
            phase.state()
        for phase in phases:
            phase.finish()
        for block in followers:
            block.follow_times()
        if (reason := _reading_of(model, grids, changes.lost_parts())) is not None:
            raise ModelError(reason)
        changes.finish(model)


class PhaseOnGrid:
    """A phase that is on its way to another grid; `PhaseRecord.restating` while it is.

    Parameters
    ----------
    block : PhaseBlock
    grid : Grid
        What the phase gets, with the scheme that it has.
    changes : InPlaceChanges
        Knows what the phase held.
    """

    def __init__(self, block: Any, grid: Grid, changes: InPlaceChanges) -> None:
        record: PhaseRecord = block.record
        self._block, self._record, self._grid, self._changes = block, record, grid, changes
        self._before = PhaseValues(block)
        self._plan: Trajectory | None = None  # none where values are missing
        if grid.mesh != record.grid.mesh:
            with suppress(TrajectoryError):
                self._plan = self._before.trajectory(evaluate=False)
        self._indices = record.grid.mesh.boundaries
        self._placed: list[Any] = []

    # ---------------------------------------------------------------- the steps

    def begin(self) -> None:
        """Give the phase its new times, and its variables over them."""
        block, record = self._block, self._record
        record.grid, record.restating = self._grid, self
        record.equation_of, record.discrete_states, record.generated_rows = {}, set(), set()
        record.rates, record.control_rates, record.residuals_per_point = {}, {}, 0
        for members_of, members in ((block.time, self._grid.times), (block.points, self._grid.points)):
            members_of.clear()
            members_of.update(members)
        if record.free_widths:
            add_boundaries(block, f"phase '{block.name}'")
        for name, declaration in record.declarations.items():
            # An initial guess may be an array over the mesh that the phase had.
            add_variables(block, name, replace(declaration, initial_guess=None))
        for name in record.names_of_states:
            if name in record.kept_derivatives:
                add_derivative(block, name)

    def state(self) -> None:
        """State the rules in their order, by their templates.

        Raises
        ------
        ModelError
            When one cannot be stated on the new mesh.
        """
        for statement in self._record.statements:
            try:
                add_statement(self._block, statement)
            except (LookupError, ValueError, TypeError, ArithmeticError, AttributeError) as error:
                raise ModelError(
                    f"phase '{self._block.name}': its {statement.kind} '{statement.name}' cannot be stated on the new "
                    f"mesh ({type(error).__name__}: {error}). If it reads another phase, give both their meshes at "
                    "once: remesh_phases({...})."
                ) from error

    def finish(self) -> None:
        """Give integrals their sums, and deactivated rows no part again."""
        block, record = self._block, self._record
        restate_integrals(block)
        restate_values_at_times(block)
        self._interpolate()
        for component in self._placed:
            _carry_activity(component, self._changes.parts_before(component))
        record.restating = None
        note_stated(block, list(record.made))

    # ---------------------------------------------------------------- what the builders call

    def place(self, name: str, component: Any) -> Any:
        """Make the component of this name like a new one, or add the new one where there is none."""
        standing = self._block.component(name)
        if standing is None:
            self._block.add_component(name, component)
            return component
        self._placed.append(standing)
        before = self._changes.parts_before(standing)
        state_anew(standing, component)
        # Members of an expression at times that stay are the objects that they were.
        for index, member in list(standing.items()) if standing.ctype is Expression else ():
            if index in before:
                before[index].set_value(member.expr)
                put_part(standing, index, before[index])
        return standing

    def keep(self, name: str, nodes: Nodes, declared: Bounds) -> None:
        """Let variables at times that stay be what they were; give the others bounds and domains.

        Parameters
        ----------
        name : str
        nodes : Nodes
            Those that it has now.
        declared : (lower, upper)
            The bounds that were declared for all values.
        """
        before, variables = self._before.nodes[name], self._before.variables[name]
        component, position = self._block.component(nodes.component), _retained(before, nodes)
        pattern = self._set_for_all(name, declared, position, nodes)
        for number, index in enumerate(component.keys()):
            if number in position:
                put_part(component, index, variables[position[number]])
                continue
            variable = component[index]
            variable.domain = variables[0].domain
            if pattern is not None:
                variable.setlb(pattern.lower)
                variable.setub(pattern.upper)
                variable.fixed = pattern.fixed

    def keep_boundaries(self) -> None:
        """Let element boundaries that stay be the variables that they were; others lie on a line between these."""
        component = self._block.boundary
        before = self._changes.parts_before(component)
        if not before:
            return  # they begin to move
        boundaries = self._grid.mesh.boundaries
        values = np.interp(boundaries, self._indices, [variable.value for variable in before.values()])
        for i, time in enumerate(boundaries):
            if time in self._indices:
                put_part(component, i, before[self._indices.index(time)])
            else:
                component[i].set_value(float(values[i]), skip_validation=True)

    # ---------------------------------------------------------------- what is carried over

    def _interpolate(self) -> None:
        """Give new variables the values of the plan."""
        if self._plan is None:
            return
        now, kept = PhaseValues(self._block), {id(of) for each in self._before.variables.values() for of in each}
        times = partial(np.interp, xp=self._indices, fp=self._plan.grid.mesh.boundaries)
        for name, numbers in now.sampled(self._plan, times).items():
            for variable, number in zip(now.variables[name], numbers.tolist(), strict=True):
                if id(variable) not in kept:
                    variable.set_value(within_bounds(number, variable), skip_validation=True)

    def _set_for_all(self, name: str, declared: Bounds, position: Mapping[int, int], nodes: Nodes) -> Any | None:
        """One of the variables, if the user has set bounds of all alike or fixed all; None if they are as declared.

        The ends of a state are another matter: they have initial and final values.

        Raises
        ------
        ModelError
            When what was set for some times only would be lost.
        """
        before, variables = self._before.nodes[name], self._before.variables[name]
        marks = [(_bounds_of(variable), bool(variable.fixed)) for variable in variables]
        is_state = isinstance(before, StateNodes)
        between = range(1, len(marks) - 1) if is_state else range(len(marks))
        set_by_user = [i for i in between if marks[i] != (declared, False)]
        fewest = 2 if is_state else 1  # one state between the ends is a waypoint
        if len(set_by_user) == len(between) >= fewest and len({marks[i] for i in between}) == 1:
            return variables[between[0]]
        stay = set(position.values())
        changes = isinstance(before, IntervalNodes) and before.times != nodes.times
        for i in set_by_user:
            if changes or i not in stay:
                what = "fixed value" if variables[i].fixed else "bounds"
                raise ModelError(
                    f"phase '{self._block.name}': '{name}': the {what} at t = {before.times[i]:g} was set for some "
                    "times only, which the new mesh has not. Set it for all times, or state a constraint."
                )
        return None


def _retained(before: Nodes, nodes: Nodes) -> dict[int, int]:
    """Old position of each new node whose variable is the old one."""
    if isinstance(nodes, IntervalNodes) and nodes.times != before.times:
        return {len(nodes.times) - 1: len(before.times) - 1}  # of other intervals, that which the end sees
    number_of = {time: i for i, time in enumerate(before.times)}
    return {i: number_of[time] for i, time in enumerate(nodes.times) if time in number_of}


def _carry_activity(component: Any, before: Mapping[Any, Any]) -> None:
    inactive = [index for index, part in before.items() if not getattr(part, "active", True)]
    if inactive and len(inactive) == len(before):
        component.deactivate()
        return
    for index in inactive:
        if index not in component:
            raise ModelError(
                f"'{component.name}' is deactivated at {index!r}, which the new mesh has not, and active "
                "elsewhere. Activate it, or deactivate all of it."
            )
        component[index].deactivate()


def _bounds_of(variable: Any) -> tuple[Any, Any]:
    """Bounds that can be compared: expressions by their identity."""
    sides = (variable.lower, variable.upper)
    return tuple(of if of is None or of.__class__ in native_numeric_types else id(of) for of in sides)  # type: ignore[return-value]
