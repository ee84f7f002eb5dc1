"""One phase on another mesh: its declarations and statements made anew, in the components that it has.

Values at times that stay are left alone, with their bounds and whether they are fixed. Others are interpolated: states
by the polynomial of the element, controls by theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.in_place_changes import InPlaceChanges
from pyrobocop_pyomo.numerics import Array, Grid

from .carried_marks import carried_marks
from .declarations import Declaration, Parameter, within
from .delays import VALUES_AT_TIMES, restate_values_at_times
from .equations import (
    add_complementarity,
    add_constraint,
    add_constraint_at_boundaries,
    add_derivative,
    add_expression,
    add_ode,
    add_residual,
    add_step,
)
from .horizon import add_boundaries
from .integrals import INTEGRALS, restate_integrals
from .nodes import IntervalNodes, Nodes
from .record import PhaseRecord, Statement
from .variables import add_variables

ADD: dict[str, Callable[..., None]] = {
    "ode": add_ode,
    "step map": add_step,
    "residual": add_residual,
    "constraint": add_constraint,
    "constraint at boundaries": add_constraint_at_boundaries,
    "complementarity": add_complementarity,
    "expression": add_expression,
}


class Restatement:
    """A phase that is on its way to another mesh; `PhaseRecord.restating` while it is.

    Parameters
    ----------
    block : PhaseBlock
    grid : Grid
        What the phase gets, with the scheme that it has.
    changes : InPlaceChanges
        Takes everything back on an error.

    Attributes
    ----------
    before : PhaseRecord
        As it was.
    """

    def __init__(self, block: Any, grid: Grid, changes: InPlaceChanges) -> None:
        record: PhaseRecord = block.record
        self.block, self.record, self.grid, self._changes = block, record, grid, changes
        self.before = record.snapshot()
        self._nodes: dict[str, Nodes] = {}
        self._variables: dict[str, list[Any]] = {}
        for name, declaration in record.declarations.items():
            if not isinstance(declaration, Parameter):
                self._remember(name)
        for name in record.kept_derivatives:
            self._remember(f"{name}_derivative")
        standing = block.component("boundary")  # none yet where they begin to move
        self._boundaries = [] if standing is None else list(standing.values())
        self._weights: dict[Any, Array] = {}
        self._placed: set[str] = set()

    def _remember(self, name: str) -> None:
        self._nodes[name] = self.before.nodes(name)
        self._variables[name] = self._nodes[name].variables(self.block)

    # ---------------------------------------------------------------- the steps

    def begin(self) -> None:
        """Give the phase its new times, and its variables over them."""
        block, record = self.block, self.record
        self._changes.protect_block(block)
        rates = {name: held.ode for name, held in record.rates.items()}
        self._changes.on_error(lambda: self._put_record_back(rates))
        record.grid, record.restating = self.grid, self
        record.equation_of, record.discrete_states, record.generated_rows = {}, set(), set()
        record.control_rates, record.residuals_per_point = {}, 0
        self._changes.set_members(block.time, list(self.grid.times))
        self._changes.set_members(block.points, list(self.grid.points))
        if record.free_widths:
            assert record.width_factors is not None
            add_boundaries(block, record, record.width_factors, f"phase '{block.name}'")
        for name, declaration in record.declarations.items():
            # An initial guess may be an array over the mesh that the phase had.
            add_variables(block, record, name, replace(declaration, initial_guess=None))
        for name in record.names_of_states:
            if name in record.kept_derivatives:
                add_derivative(block, record, name)

    def state(self) -> None:
        """State the rules in their order, by their templates.

        Raises
        ------
        ModelError
            When one reads what the new mesh has not.
        """
        for statement in (*self.record.expressions, *self.record.statements):
            self._state(statement)

    def finish(self) -> None:
        """Give the integrals their sums, and rows that were deactivated no part again."""
        restate_integrals(self.block, self.record)
        restate_values_at_times(self.block, self.record)
        for name in self._placed:
            component = self.block.component(name)
            if hasattr(type(component), "deactivate"):
                self._carry_activity(component)
        self.record.restating = None

    def owns(self, name: str) -> bool:
        """True for components that the declarations and statements of the phase make, and the integrals."""
        record = self.before
        if name in ("time", "points", "start", "duration", "boundary", "boundary_width", INTEGRALS, VALUES_AT_TIMES):
            return True
        if name in record.declarations or name in record.generated_rows or name in self._nodes:
            return True
        if name in {nodes.component for nodes in self._nodes.values()}:
            return True
        return any(statement.name == name for statement in (*record.expressions, *record.statements))

    def _state(self, statement: Statement) -> None:
        record = self.record
        record.asking = True
        try:
            ADD[statement.kind](self.block, record, statement)
        except KeyError as error:
            raise ModelError(
                f"phase '{self.block.name}': its {statement.kind} '{statement.name}' reads what the new mesh has not "
                f"({error}). If it is of another phase, give both their meshes at once: remesh_phases({{...}})."
            ) from error
        finally:
            record.asking = False

    def _put_record_back(self, rates: dict[str, Any]) -> None:
        for attribute in fields(self.record):
            setattr(self.record, attribute.name, getattr(self.before, attribute.name))
        for name, held in self.record.rates.items():
            held.ode = rates[name]
        self.block._record = self.record

    # ---------------------------------------------------------------- what the builders call

    def place(self, name: str, component: Any) -> Any:
        """Make the component of this name like a new one, or add the new one where there is none."""
        self._placed.add(name)
        standing = self.block.component(name)
        if standing is None:
            self.block.add_component(name, component)
            return component
        return self._changes.restate(standing, component)

    def keep(self, name: str) -> None:
        """Let variables at times that stay be what they were; give the others values, bounds and domains."""
        before, variables = self._nodes[name], self._variables[name]
        nodes = self.record.nodes(name)
        component = self.block.component(nodes.component)
        indices = list(component.keys())
        position = _retained(before, nodes)
        values = self._values(variables, before, nodes)
        declaration = self.record.declarations.get(name)
        what = f"phase '{self.block.name}': '{name}'"
        vanished = sorted(set(range(len(variables))) - set(position.values()))
        bounds = carried_marks(
            [_bounds_mark(variable) for variable in variables],
            self._usual_bounds(declaration, before, component, position, variables),
            before, nodes, vanished, f"{what}: the bounds",
        )  # fmt: skip
        fixed = carried_marks(
            [bool(variable.fixed) for variable in variables],
            [False] * len(variables), before, nodes, vanished, f"{what}: the fixed value",
        )  # fmt: skip
        for number, index in enumerate(indices):
            if number in position:
                self._changes.put_back(component, index, variables[position[number]])
                continue
            variable = component[index]
            variable._domain = variables[0]._domain
            if (source := bounds[number]) is not None:
                variable.setlb(variables[source].lower)
                variable.setub(variables[source].upper)
            if values is not None:
                variable.set_value(within(float(values[number]), variable.bounds), skip_validation=True)
            variable.fixed = fixed[number] is not None

    def keep_expressions(self, name: str) -> None:
        """Let members of an expression at times that stay be the objects that they were."""
        self._changes.put_back_expressions(self.block.component(name))

    def keep_boundaries(self) -> None:
        """Let element boundaries that stay be the variables that they were; others lie on a line between these."""
        if not self._boundaries:
            return
        component, old = self.block.boundary, self.before.grid.mesh.boundaries
        number_of = {time: i for i, time in enumerate(old)}
        values = np.interp(self.grid.mesh.boundaries, old, [variable.value for variable in self._boundaries])
        for i, time in enumerate(self.grid.mesh.boundaries):
            if time in number_of:
                self._changes.put_back(component, i, self._boundaries[number_of[time]])
            else:
                component[i].set_value(float(values[i]), skip_validation=True)

    # ---------------------------------------------------------------- values

    def _interpolation(self, before: Nodes, nodes: Nodes) -> Array:
        """Weights (samples, nodes before) of the old values."""
        key = (type(before), before.times, nodes.times)
        if key in self._weights:
            return self._weights[key]
        begins = nodes.begins if nodes.begins is not None else np.zeros(len(nodes.sample_times), dtype=bool)
        self._weights[key] = before.matrix_at(nodes.sample_times, begins.tolist())
        return self._weights[key]

    def _values(self, variables: Sequence[Any], before: Nodes, nodes: Nodes) -> Array | None:
        numbers = [variable.value for variable in variables]
        if None in numbers:
            return None
        return nodes.from_samples(self._interpolation(before, nodes) @ np.array(numbers, dtype=float))

    def _usual_bounds(
        self, declaration: Declaration | None, before: Nodes, component: Any, position: dict[int, int], variables: Any
    ) -> list[Any]:
        """What the bounds of each old variable are by its declaration."""
        if declaration is None or not callable(declaration.bounds):
            fresh = next(iter(component.values()))
            return [_bounds_mark(fresh)] * len(variables)
        if isinstance(before, IntervalNodes):  # they have what the bounds at several points leave in common
            return [_bounds_mark(variable) for variable in variables]
        return [declaration.bounds_at(time, f"'{before.component}'") for time in before.times]

    # ---------------------------------------------------------------- activity

    def _carry_activity(self, component: Any) -> None:
        before = self._changes.parts_before(component) if self._changes.has_changed(component) else {}
        inactive = {index for index, part in before.items() if not part.active}
        if not inactive:
            return
        if len(inactive) == len(before):
            component.deactivate()
            return
        for index in inactive:
            if index not in component:
                raise ModelError(
                    f"'{component.name}' is deactivated at {index!r}, which the new mesh has not, and active "
                    "elsewhere. Activate it, or deactivate all of it."
                )
            component[index].deactivate()


def _retained(before: Nodes, nodes: Nodes) -> dict[int, int]:
    """Old position of each new node whose variable is the old one."""
    if not isinstance(nodes, IntervalNodes):
        number_of = {time: i for i, time in enumerate(before.times)}
        return {i: number_of[time] for i, time in enumerate(nodes.times) if time in number_of}
    assert isinstance(before, IntervalNodes)
    # The value that is seen at a time that stays is the same variable, as far as one variable is not seen twice.
    found: dict[int, int] = {}
    old_of = dict(zip(before.grid.points, before.of_points.tolist(), strict=True))
    taken: set[int] = set()
    for time, new in reversed(list(zip(nodes.grid.points, nodes.of_points.tolist(), strict=True))):
        old = old_of.get(time)
        if old is not None and new not in found and old not in taken:
            found[new] = old
            taken.add(old)
    return found


def _bounds_mark(variable: Any) -> tuple[Any, Any]:
    return tuple(
        bound if bound is None or bound.__class__ in native_numeric_types else id(bound)
        for bound in (variable.lower, variable.upper)
    )  # type: ignore[return-value]
