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

from functools import partial
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
from pyrobocop_pyomo.modeling.pyomo_internals import new_row, put_part, put_rule
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowByRule, RowRule, add_rows_by_rule
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.templates.formula_rows import by_label
from pyrobocop_pyomo.templates.template import same_results
from pyrobocop_pyomo.transcription import collocation_row, collocation_sums, continuity_row

from .expansion import RowsAlong
from .structure import PAIRS, Axis, Discretisation, Spot, axes_of, axis_on, open_sets, other_side, row_variables


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
    for variable, by_order in derivatives_along(spots, discretisation.domain):
        levels = [variable]
        for order in range(1, max(by_order) + 1):
            nearest = by_order[min(known for known in by_order if known >= order)]
            home = _home(discretisation, nearest.parent_block(), homes)
            levels.append(by_order[order] if order in by_order else _between(home, variable, nearest, order))
            discretisation.homes[levels[-1]] = home
            discretisation.derivatives.append((levels[-2], levels[-1]))


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


class LineRows(RowRule):
    """The rows of a derivative along a set, on lines: one for each choice of its other indices.

    Parameters
    ----------
    state : Var
    rate : Var or Expression
        The derivative, or the right-hand sides in its place.
    grid : Grid
    axis : Axis
        Of the set that the grid is on.
    widths : list
        Of the elements, in their unit if they have one.
    are_joints : bool
        Whether they are the rows that join elements whose last stage is not the end.
    """

    def __init__(self, state: Any, rate: Any, grid: Grid, axis: Axis, widths: list[Any], are_joints: bool) -> None:
        self._state, self._rate, self._grid, self._axis, self._widths = state, rate, grid, axis, widths
        self._are_joints = are_joints
        ends = {end: (element, 0) for element, end in enumerate(grid.mesh.boundaries[1:])}
        self._places = ends if are_joints else grid.row_places
        self._sources: dict[Any, tuple[RowsAlong, Any]] = {}  # of the lines whose rows follow this rule

    def __call__(self, block: Any, *index: Any) -> Any:
        """The row of an index, which Pyomo gives in parts; none at a time without one."""
        key = index[0] if len(index) == 1 else index
        others, time, grid = self._axis.others(key), self._axis.time(key), self._grid
        if time not in self._places:
            return Constraint.Skip
        element, row = self._places[time]
        nodes = (*grid.node_times[element], grid.mesh.boundaries[element + 1])
        states = {node: self._state[self._axis.join(others, node)] for node in nodes}
        if self._are_joints:
            return continuity_row(states, grid, element)
        stages = zip(grid.stage_times[element], grid.scheme.F[row].tolist(), strict=True)
        rates = {stage: self._rate[self._axis.join(others, stage)] for stage, weight in stages if weight != 0.0}
        if self._rate.ctype is Expression:
            rates = {stage: side.args[0] for stage, side in rates.items()}
        return collocation_row(states, rates, grid, element, row, self._widths[element])

    def write(self, rows: Any, others: Any) -> None:
        """Write the rows of a line."""
        indices = [self._axis.join(others, time) for time in self._places]
        source = self._source(others)
        if source is not None:
            self._sources[others] = source
            add_rows_by_rule(rows, self, indices)
            return
        for index in indices:
            new_row(rows, index, self(None, index))

    def _source(self, others: Any) -> tuple[RowsAlong, Any] | None:
        """The rule and the label of the rows that give a derivative at all collocation points, if there is one."""
        if self._are_joints or self._rate.ctype is not Expression or self._state.get_units() is not None:
            return None
        line = {time: self._rate[self._axis.join(others, time)] for time in self._grid.points}
        sources = {side.source for side in line.values()} - {None}
        if len(sources) != 1:
            return None
        ((rule, label),) = sources
        first_points = {time: side for time, side in line.items() if side.source is None}
        alike = all(
            same_results(other_side(rule.at(time, label), side.derivative), side.args[0])
            for time, side in first_points.items()
        )
        return (rule, label) if alike else None

    def sums(self, block: Any, indices: list[Any]) -> list[RepeatedSum]:
        """Those of each line."""
        found = []
        for others, positions in by_label(range(len(indices)), lambda i: self._axis.others(indices[i])).items():
            times = [self._axis.time(indices[position]) for position in positions]
            state = {time: self._state[self._axis.join(others, time)] for time in self._grid.times}
            rates = partial(self._right_hand_sides, others)
            for repeated in collocation_sums(self._grid, state, times, rates, self._widths):
                found.append(repeated._replace(rows=[positions[row] for row in repeated.rows]))
        return found

    def _right_hand_sides(self, others: Any, times: list[float], elements: list[int]) -> Any:
        (rule, label), axis = self._sources[others], self._axis
        derivatives = [self._rate[axis.join(others, time)].derivative for time in times]
        read = [slot.at_all(None, times) for slot in rule.slots(None)[label]]
        variables = [leaves for leaves in read if leaves[0] is not derivatives[0]]
        return variables, lambda place: other_side(rule.at(times[place], label), derivatives[place])


def write_rows(discretisation: Discretisation) -> None:
    """Write the rows of all derivatives, with right-hand sides in the place of those that have some."""
    grid = discretisation.grid
    for state, rate in discretisation.derivatives:
        axis, home = axis_on(rate, discretisation.domain), discretisation.homes[rate]
        assert axis is not None
        given, widths = discretisation.substitutions.get(rate, rate), _widths(state, rate, grid)
        lines = [axis.others(index) for index in rate if axis.time(index) == grid.times[0]]
        names = [rate.local_name] if grid.scheme.end_is_a_node else [rate.local_name, f"{state.local_name}_continuity"]
        for are_joints, name in enumerate(names):
            rows, rule = Constraint(rate.index_set()), LineRows(state, given, grid, axis, widths, bool(are_joints))
            home.add_component(unique_component_name(home, name), rows)
            for others in lines:
                rule.write(rows, others)
            # Where pyomo.dae discretises another set later, it asks a rule for rows on the new lines.
            put_rule(rows, Initializer(rule))


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
    open_ids, states = open_sets(found), discretisation.state_ids()
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


def _explicit_rows(found: list[Spot], candidates: dict[int, Any]) -> dict[int, Any]:
    """The row of each candidate that one row gives and nothing else holds."""
    explicit: dict[int, Any] = {}
    elsewhere: set[int] = set()
    for spot in found:
        component = spot.component
        if not spot.active or component.ctype not in (Constraint, Objective, Expression, *PAIRS):
            continue
        unconditional = not any(block.ctype is Disjunct for block in enclosing_blocks(component))
        parts = [data for data in component.values() if component.ctype is Expression or data.active]
        given, otherwise = row_variables(parts, candidates)
        elsewhere |= otherwise
        for key, row in given.items():
            if unconditional and key not in explicit:
                explicit[key] = row
            else:
                elsewhere.add(key)
    return {key: row for key, row in explicit.items() if key not in elsewhere}


def _substitute(discretisation: Discretisation, derivative: Any, needed: list[Any], explicit: dict[int, Any]) -> None:
    home = discretisation.homes[derivative]
    parent, name = derivative.parent_block(), derivative.local_name
    parent.del_component(derivative)
    aside = Block(concrete=True)
    home.add_component(unique_component_name(home, "replaced"), aside)
    aside.deactivate()  # whoever writes the values of a model would ask for those of these variables too
    aside.add_component(name, derivative)
    expression = Expression(derivative.index_set())
    parent.add_component(name, expression)
    for data in needed:  # the indices are those of the derivative
        put_part(expression, data.index(), RightHandSide(expression, data, explicit[id(data)]))
    discretisation.substitutions[derivative] = expression


class RightHandSide(ExpressionData):
    """The right-hand side that replaces a derivative; it has a value, and can be fixed, as a variable can.

    Fixing activates the equation ``dx[t] == f``, with the derivative in it as a fixed variable: a condition, such as a
    steady start. So it does not matter whether a derivative is fixed before or after the transformation.
    """

    __slots__ = ("_row", "derivative", "source")

    def __init__(self, component: Any, derivative: Any, row: Any) -> None:
        self.derivative, self._row = derivative, row
        self.source: Any = None  # the rule that says it, and the label of its row there
        if row.__class__ is RowByRule:
            rule: RowsAlong = row.parent_component().rule_of_rows
            self.source = rule, rule.parts(row.index())[1]
        super().__init__(None if self.source is not None else other_side(row.expr, derivative), component)
        if not derivative.fixed:  # otherwise the row is a condition, as after `fix`
            self.unfix()
            derivative.stale = True

    @property
    def args(self) -> Any:
        """The right-hand side, which is made where a rule says it."""
        if super().args[0] is None:
            rule, label = self.source
            self.set_value(other_side(rule.at(rule.parts(self._row.index())[0], label), self.derivative))
        return super().args

    @property
    def value(self) -> float | None:
        """The value of the derivative; None where something in it has none."""
        return self.derivative.value if self.fixed else numeric_value(self, exception=False)

    @property
    def fixed(self) -> bool:
        """Whether the derivative is fixed here."""
        return bool(self._row.active)

    def fix(self, *value: Any, skip_validation: bool = False) -> None:
        """Fix the derivative, at a number or at its value."""
        self.derivative.fix(*(value or (self.value,)), skip_validation=skip_validation)
        self._row.activate()

    def unfix(self) -> None:
        """Take back `fix`."""
        self._row.deactivate()
        self.derivative.fix(None, skip_validation=True)

    free = unfix
