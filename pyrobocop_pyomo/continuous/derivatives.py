"""Collocation rows, which tie derivatives to their variables.

A derivative of order ``n`` is taken one order at a time: ``x``, ``x'``, ..., each a state whose polynomial has the next
as its slope. Where the model has no variable for an order in between, one is added. A second derivative is thus part of
the scheme's solution of ``x' = v, v' = a``, where ``v`` is continuous; with the second derivative of one polynomial
``v`` would jump.

Where a row says ``dx[t] == f``, not just within a disjunct, ``f`` itself stands in the collocation rows: a solver takes
fewer iterations, and ``dx[t]`` follows by the user's own row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.initializer import Initializer
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar
from pyomo.gdp import Disjunct

from pyrobocop_pyomo.modeling.activity import enclosing_blocks
from pyrobocop_pyomo.modeling.bulk_parts import new_row
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.transcription import collocation_rows, continuity_rows

from .structure import Axis, Discretisation, Spot, axis_on, explicit_equations


def derivatives_along(spots: list[Spot], domain: Any) -> list[tuple[Any, dict[int, Any]]]:
    """Every variable with derivatives along a set, and the derivatives by their order."""
    found: dict[int, tuple[Any, dict[int, Any]]] = {}
    for spot in spots:
        derivative = spot.component
        if not isinstance(derivative, DerivativeVar):
            continue
        along = derivative.get_continuousset_list()
        if all(along_set is domain for along_set in along):
            variable = derivative.get_state_var()
            found.setdefault(id(variable), (variable, {}))[1][len(along)] = derivative
    return list(found.values())


def add_collocation(discretisation: Discretisation, spots: list[Spot]) -> None:
    """Add what holds the rows of every derivative along a set, beside the derivative; `write_rows` fills it."""
    homes: dict[int, Any] = {}
    discretisation.states.clear()
    for variable, by_order in derivatives_along(spots, discretisation.domain):
        levels = [variable]
        for order in range(1, max(by_order) + 1):
            nearest = by_order[min(known for known in by_order if known >= order)]
            home = _home(discretisation, nearest.parent_block(), homes)
            levels.append(by_order[order] if order in by_order else _between(home, variable, nearest, order))
            _add_rows(home, levels[-2], levels[-1], discretisation)
            discretisation.states.append(levels[-2])
            discretisation.derivatives.append((levels[-2], levels[-1]))


def remove_collocation(discretisation: Discretisation) -> None:
    """Take away all generated blocks of a set."""
    for block in discretisation.generated:
        parent = block.parent_block()
        if parent is not None:
            parent.del_component(block)
    discretisation.generated.clear()


def _home(discretisation: Discretisation, parent: Any, homes: dict[int, Any]) -> Any:
    """The generated block beside the derivatives of one block: both are deactivated together."""
    if id(parent) not in homes:
        home = homes[id(parent)] = Block(concrete=True)
        parent.add_component(unique_component_name(parent, f"{discretisation.domain.local_name}_collocation"), home)
        discretisation.generated.append(home)
    return homes[id(parent)]


def _between(home: Any, variable: Any, derivative: Any, order: int) -> Any:
    name = unique_component_name(home, f"{variable.local_name}_derivative_{order}")
    # Its unit does not matter: only the generated rows hold this variable.
    added = Var(derivative.index_set())
    home.add_component(name, added)
    return added


def _add_rows(home: Any, state: Any, rate: Any, discretisation: Discretisation) -> None:
    grid, axis = discretisation.grid, axis_on(rate, discretisation.domain)
    assert axis is not None
    names = [rate.local_name] if grid.scheme.end_is_a_node else [rate.local_name, f"{state.local_name}_continuity"]
    discretisation.rows[rate] = [Constraint(rate.index_set()) for _ in names]
    for name, rows in zip(names, discretisation.rows[rate], strict=True):
        home.add_component(unique_component_name(home, name), rows)
        # Where pyomo.dae discretises another set later, it asks a rule for rows on the new lines.
        rows._rule = Initializer(LineRows(state, rate, grid, axis, name != names[0]))


class LineRows:
    """The rows of a derivative along a set, for one choice of its other indices after the other.

    Parameters
    ----------
    state : Var
    rate : Var
    grid : Grid
    axis : Axis
        Of the set that the grid is on.
    are_joints : bool
        Whether they are the rows that join elements whose last stage is not the end.
    """

    def __init__(self, state: Any, rate: Any, grid: Grid, axis: Axis, are_joints: bool) -> None:
        self._state, self._rate, self._grid, self._axis, self._are_joints = state, rate, grid, axis, are_joints
        self._line: tuple[Any, dict[float, Any]] = (self, {})

    def of(self, others: Any, sides: Mapping[int, Any]) -> Iterable[tuple[float, Any]]:
        """Time and row of each, with right-hand sides in place of the derivative where they are given."""
        states = {time: self._state[self._axis.join(others, time)] for time in self._grid.times}
        if self._are_joints:
            return continuity_rows(states, self._grid)
        rates = {time: self._rate[self._axis.join(others, time)] for time in self._grid.points}
        rates = {time: sides.get(id(data), data) for time, data in rates.items()}
        return collocation_rows(states, rates, self._grid, _widths(self._state, self._rate, self._grid))

    def __call__(self, block: Any, *index: Any) -> Any:
        """As the rule of the constraint, for indices of another set that are new."""
        others, time = self._axis.others(index), self._axis.time(index)
        if self._line[0] != others:
            self._line = (others, dict(self.of(others, {})))
        return self._line[1].get(time, Constraint.Skip)


def write_rows(discretisation: Discretisation, sides: Mapping[int, Any]) -> None:
    """Write the rows of all derivatives, with right-hand sides in the place of those that have some."""
    for state, rate in discretisation.derivatives:
        axis = axis_on(rate, discretisation.domain)
        assert axis is not None
        lines = [axis.others(index) for index in rate if axis.time(index) == discretisation.grid.times[0]]
        for number, rows in enumerate(discretisation.rows[rate]):
            line_rows = LineRows(state, rate, discretisation.grid, axis, number == 1)
            for others in lines:
                for time, row in line_rows.of(others, sides):
                    new_row(rows, axis.join(others, time), row)


def _widths(state: Any, rate: Any, grid: Grid) -> list[Any]:
    """Element widths, in the unit of time that the units of both variables imply if they have any."""
    widths: list[Any] = grid.mesh.widths.tolist()
    above, below = state.get_units(), rate.get_units()
    if above is None and below is None:
        return widths
    unit = (1.0 if above is None else above) / (1.0 if below is None else below)
    return [width * unit for width in widths]


def right_hand_sides(discretisation: Discretisation, found: list[Spot]) -> dict[int, Any]:
    """By the ids of derivatives, the right-hand sides of rows that give them explicitly."""
    rates = {id(data) for _, rate in discretisation.derivatives for data in rate.values()}
    sides: dict[int, Any] = {}
    for spot in found:
        if spot.component.ctype is not Constraint or not spot.active:
            continue
        if any(block.ctype is Disjunct for block in enclosing_blocks(spot.component)):
            continue
        for data, side in explicit_equations((row for row in spot.component.values() if row.active), rates):
            sides.setdefault(id(data), side)
    return sides
