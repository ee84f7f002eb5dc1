"""Collocation rows, which tie derivatives to their variables, and the substitution of explicit equations.

A derivative of order ``n`` is taken one order at a time: ``x``, ``x'``, ..., each a state whose polynomial has the next
as its slope. Where the model has no variable for an order in between, one is added. A second derivative is thus part of
the scheme's solution of ``x' = v, v' = a``, where ``v`` is continuous; with the second derivative of one polynomial
``v`` would jump.

An equation is explicit when a row says ``dx[t] == f``, not just within a disjunct, and the derivative is found nowhere
else, at each collocation point. The row is then deactivated, ``f`` goes into the collocation rows, which saves half of
the variables, and under the name of the derivative there is an expression, ``f`` itself: it can be read after a solve,
by whatever solver, used in further rows, and fixed.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression, ExpressionData
from pyomo.core.base.initializer import Initializer
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value as numeric_value
from pyomo.dae import DerivativeVar
from pyomo.gdp import Disjunct

from pyrobocop_pyomo.modeling.activity import enclosing_blocks
from pyrobocop_pyomo.modeling.bulk_parts import new_row, put_part
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, add_rows_by_rule, variables_in_rows
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.transcription import collocation_rows, continuity_rows, row_times

from .rows_along import ExplicitRows, RowsAlong
from .structure import (
    PAIRS,
    Axis,
    Discretisation,
    Spot,
    axes_of,
    axis_on,
    continuous_sets,
    open_sets,
    row_variables,
    variables_of_row,
)


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

    def of(self, others: Any, sides: Any = None) -> Iterable[tuple[float, Any]]:
        """Time and row of each, with `RightHandSide`s in place of the derivative where they are given."""
        states = {time: self._state[self._axis.join(others, time)] for time in self._grid.times}
        if self._are_joints:
            return continuity_rows(states, self._grid)
        of_rate = self._rate if sides is None else sides
        rates = {time: of_rate[self._axis.join(others, time)] for time in self._grid.points}
        if sides is not None:
            rates = {time: side.expr for time, side in rates.items()}
        return collocation_rows(states, rates, self._grid, _widths(self._state, self._rate, self._grid))

    def __call__(self, block: Any, *index: Any) -> Any:
        """As the rule of the constraint, for indices of another set that are new."""
        others, time = self._axis.others(index), self._axis.time(index)
        if self._line[0] != others:
            self._line = (others, dict(self.of(others)))
        return self._line[1].get(time, Constraint.Skip)


def write_rows(discretisation: Discretisation) -> None:
    """Write the rows of all derivatives, with right-hand sides in the place of those that have some."""
    grid = discretisation.grid
    for state, rate in discretisation.derivatives:
        axis, sides = axis_on(rate, discretisation.domain), discretisation.substitutions.get(rate)
        assert axis is not None
        lines = [axis.others(index) for index in rate if axis.time(index) == grid.times[0]]
        by_rule = {others: said for others in lines if (said := _said_of_line(sides, state, axis, grid, others))}
        if by_rule:
            indices = [axis.join(others, time) for others in by_rule for time in row_times(grid)]
            add_rows_by_rule(discretisation.rows[rate][0], ExplicitRows(state, grid, axis, by_rule), indices)
        for are_joints, rows in enumerate(discretisation.rows[rate]):
            line_rows = LineRows(state, rate, grid, axis, bool(are_joints))
            for others in lines if are_joints else [others for others in lines if others not in by_rule]:
                for time, row in line_rows.of(others, sides):
                    new_row(rows, axis.join(others, time), row)


def _said_of_line(sides: Any, state: Any, axis: Axis, grid: Grid, others: Any) -> tuple[RowsAlong, Any] | None:
    """The rule and the label of the rows that give a derivative at all collocation points, if there is one."""
    if sides is None or state.get_units() is not None:
        return None
    line = {time: sides[axis.join(others, time)] for time in grid.points}
    rules = {side.said for side in line.values()} - {None}
    if len(rules) != 1:
        return None
    ((rule, label),) = rules
    first_points = {time: side for time, side in line.items() if side.said is None}
    alike = all(rule.is_right_hand_side(side.expr, time, label) for time, side in first_points.items())
    return (rule, label) if alike else None


def _widths(state: Any, rate: Any, grid: Grid) -> list[Any]:
    """Element widths, in the unit of time that the units of both variables imply if they have any."""
    widths: list[Any] = grid.mesh.widths.tolist()
    above, below = state.get_units(), rate.get_units()
    if above is None and below is None:
        return widths
    unit = (1.0 if above is None else above) / (1.0 if below is None else below)
    return [width * unit for width in widths]


def substitute_derivatives(discretisation: Discretisation, found: list[Spot]) -> None:
    """Replace all derivatives that are given explicitly."""
    open_ids, states = open_sets(continuous_sets(found)), discretisation.state_ids()
    candidates = {
        id(data): data
        for _, derivative in discretisation.derivatives
        if isinstance(derivative, DerivativeVar) and not derivative.is_reference()
        # On a set that is still to be discretised there will be more of them.
        if not any(id(axis.domain) in open_ids for axis in axes_of(derivative))
        for data in derivative.values()
        if data.lower is None and data.upper is None and not (data.fixed and data.value is None)
        if id(data) not in states
    }
    explicit = _explicit_rows(found, candidates)
    for _, derivative in discretisation.derivatives:
        needed = [data for data in derivative.values() if not (data.fixed and data.value is None)]
        if needed and all(id(data) in explicit for data in needed):
            _substitute(discretisation, derivative, needed, explicit)


def _explicit_rows(found: list[Spot], candidates: dict[int, Any]) -> dict[int, tuple[Any, Any]]:
    """The row and the right-hand side of each candidate that one row gives and nothing else holds."""
    explicit: dict[int, tuple[Any, Any]] = {}
    elsewhere: set[int] = set()
    for spot in found:
        component = spot.component
        if not spot.active or component.ctype not in (Constraint, Objective, Expression, *PAIRS):
            continue
        unconditional = not any(block.ctype is Disjunct for block in enclosing_blocks(component))
        parts = [data for data in component.values() if component.ctype is Expression or data.active]
        if component.ctype in PAIRS:
            elsewhere.update(id(variable) for data in parts for variable in variables_of_row(data))
            continue
        by_rule = [data for data in parts if data.__class__ is RowByRule]
        looked_at = [row_variables((data for data in parts if data.__class__ is not RowByRule), candidates)]
        if by_rule and isinstance(component.rule_of_rows, RowsAlong):
            looked_at.append(component.rule_of_rows.given(component.parent_block(), by_rule, candidates))
        elif by_rule:  # collocation rows along another set
            elsewhere |= variables_in_rows(by_rule)
        for given, otherwise in looked_at:
            elsewhere |= otherwise
            for key, said in given.items():
                if unconditional and key not in explicit:
                    explicit[key] = said
                else:
                    elsewhere.add(key)
    return {key: value for key, value in explicit.items() if key not in elsewhere}


def _substitute(
    discretisation: Discretisation, derivative: Any, needed: list[Any], explicit: dict[int, tuple[Any, Any]]
) -> None:
    home = discretisation.rows[derivative][0].parent_block()
    parent, name = derivative.parent_block(), derivative.local_name
    parent.del_component(derivative)
    aside = Block(concrete=True)
    home.add_component(unique_component_name(home, "replaced"), aside)
    aside.deactivate()  # whoever writes the values of a model would ask for those of these variables too
    aside.add_component(name, derivative)
    expression = Expression(derivative.index_set())
    parent.add_component(name, expression)
    for data in needed:  # the indices are those of the derivative
        row, side = explicit[id(data)]
        put_part(expression, data.index(), RightHandSide(side, expression, data, row))
    discretisation.substitutions[derivative] = expression


class RightHandSide(ExpressionData):
    """The right-hand side that replaces a derivative; it has a value, and can be fixed, as a variable can.

    Fixing activates the equation ``dx[t] == f``, with the derivative in it as a fixed variable: a condition, such as a
    steady start. So it does not matter whether a derivative is fixed before or after the transformation.
    """

    __slots__ = ("_derivative", "_row")

    def __init__(self, side: Any, component: Any, derivative: Any, row: Any) -> None:
        super().__init__(side, component)
        self._derivative, self._row = derivative, row
        if not derivative.fixed:  # otherwise the row is a condition, as after `fix`
            self.unfix()
            derivative.stale = True

    @property
    def args(self) -> Any:
        """The right-hand side, which is made where a rule says it."""
        if super().args[0] is None and self.said is not None:
            rule, label = self.said
            self.set_value(rule.right_hand_side(rule.parts(self._row.index())[0], label))
        return super().args

    @property
    def said(self) -> tuple[RowsAlong, Any] | None:
        """The rule that says it, and the label of its row there; None where a row of its own does."""
        if self._row.__class__ is not RowByRule:
            return None
        rule: RowsAlong = self._row.parent_component().rule_of_rows
        return rule, rule.parts(self._row.index())[1]

    @property
    def value(self) -> float | None:
        """The value of the derivative; None where something in it has none."""
        return self._derivative.value if self.fixed else numeric_value(self, exception=False)

    @property
    def fixed(self) -> bool:
        """Whether the derivative is fixed here."""
        return bool(self._row.active)

    def fix(self, *value: Any, skip_validation: bool = False) -> None:
        """Fix the derivative, at a number or at its value."""
        self._derivative.fix(*(value or (self.value,)), skip_validation=skip_validation)
        self._row.activate()

    def unfix(self) -> None:
        """Take back `fix`."""
        self._row.deactivate()
        self._derivative.fix(None, skip_validation=True)

    free = unfix
