"""From the user's rules to Pyomo rows: equations, step maps, residuals, constraints, complementarity; and to integrals.

An objective that holds an integral follows when the phase gets another mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from itertools import count
from types import MappingProxyType
from typing import Any

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.PyomoModel import Model
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import EqualityExpression, InequalityExpression, RelationalExpression

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.activity import ONE_MODEL, foreign_read, foreign_variable
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions, plain_scalar
from pyrobocop_pyomo.modeling.pyomo_internals import new_row
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowRule, add_rows_by_rule, sum_by_rule
from pyrobocop_pyomo.modeling.rule_slips import slips_explained
from pyrobocop_pyomo.modeling.shared_nodes import expressions_returned, variables_in_any
from pyrobocop_pyomo.templates.template import Template
from pyrobocop_pyomo.transcription import can_step, quadrature

from .declarations import Algebraic, State, check_bounds
from .families import equations_by_component
from .horizon import quadrature_weights
from .record import AT_BOUNDARIES, PhaseRecord, PreviousStates, Statement, hand_out, labelled_rows, place
from .row_rules import CollocationRows, Ode, Rates, StatedRows
from .stated_numbers import rate_units
from .variables import NoSuchTime, add_generated_rows, add_values

# What is said where a declaration or a rule comes a second time.
RUN_AGAIN = "(A notebook's cell that is run again states it again: run those from the one that makes the model.)"

Rule = Callable[..., Any]

INTEGRALS = "stated_integrals"


def _add_ode(block: Any, statement: Statement) -> None:
    """Rows for the states whose derivatives a rule gives."""
    record: PhaseRecord = block.record
    given, is_read_later = _answers(block, statement, lambda time: _given_for_states(block, statement, time))
    ode = Ode(block, statement, given)
    for name in _states_given(block, statement, given):
        declaration: Any = record.declarations[name]
        rates = Rates(ode, name)
        if declaration.derivative_bounds is None and name not in record.kept_derivatives:
            record.rates[name] = rates
            _add_collocation(block, name, rates, is_read_later)
        else:
            kept = block.derivative(name)
            rows = ((time, (kept[time] - rate, 0)) for time, rate in rates.items())
            add_generated_rows(block, f"{name}_equation", block.points, rows)
        record.equation_of[name] = statement.name


def _add_step(block: Any, statement: Statement) -> None:
    """Rows for the states whose values an element later a rule gives."""
    record: PhaseRecord = block.record
    what, grid = statement.label(block), record.grid
    if not can_step(grid.scheme):
        raise ModelError(
            f"{what} leads from one element boundary to the next, but {grid.scheme.name} has {grid.scheme.stages} "
            "stages, or one inside the element. State it on a phase with scheme='implicit_euler' (or explicit Euler)."
        )
    states = {name: block.component(name) for name in record.names_of_states}
    given, ends = {}, {}
    for nodes, (stage,) in zip(grid.node_times, grid.stage_times, strict=True):
        ends[stage] = nodes[-1]
        starting = {name: state[nodes[0]] for name, state in states.items()}
        given[stage] = _given_for_states(block, statement, stage, PreviousStates(what, starting, record.families))
    for state in _states_given(block, statement, given):
        declaration = record.declarations[state]
        assert isinstance(declaration, State)
        if declaration.derivative_bounds is not None or state in record.kept_derivatives:
            raise ModelError(
                f"{what} gives the next value of '{state}' (declared at {declaration.declared_at}), whose derivative "
                "is in use. What a step leads has none: remove derivative_bounds and phase.derivative(), or state an "
                "ode."
            )
        rows = ((time, (states[state][ends[time]] - values[state], 0)) for time, values in given.items())
        add_generated_rows(block, f"{state}_step", block.points, rows)
        record.equation_of[state] = statement.name
        record.rates[state] = {time: values[state] for time, values in given.items()}
        record.discrete_states.add(state)


# What a rule gives for a state, and what that is made of.
_GIVEN = {"ode": ("derivative", "right-hand side"), "step map": ("next value", "value")}


def _given_for_states(block: Any, statement: Statement, time: float, *more: PreviousStates) -> dict[str, Any]:
    """What a rule gives for states at a collocation point as {name: expression}."""
    label, (meaning, expected) = statement.label(block), _GIVEN[statement.kind]
    result = asked(block, statement, time, f"a dict {{state: {expected}}}", *more)
    if not isinstance(result, Mapping):
        raise ModelError(
            f"{label} returned a {type(result).__name__} at t = {time:g}; expected a dict {{state: {expected}}}."
        )
    given: dict[str, Any] = {}
    for state, expression in equations_by_component(block.record, result, f"{label} at t = {time:g}").items():
        name = block.state_name(state)
        expression = plain_scalar(expression, f"{label}: the {meaning} of '{name}' at t = {time:g}")
        if expression.__class__ not in native_numeric_types and not _is_numeric(expression):
            remedy = "Is an index [t] missing?"
            if expression is None:
                remedy = "Is a return statement missing in a function that the rule calls?"
            elif isinstance(expression, (tuple, list)):
                expression = f"[{', '.join(map(str, expression))}]"
                remedy = "Give one, without brackets or a comma behind it; several are for a state with index=."
            raise ModelError(
                f"{label} gives '{expression}' as the {meaning} of '{name}' at t = {time:g}; expected a "
                f"number or an expression. {remedy}"
            )
        if expression.__class__ in native_numeric_types and not math.isfinite(expression):
            raise ModelError(f"{label} gives {expression} as the {meaning} of '{name}' at t = {time:g}; give a number.")
        if name in given:
            raise ModelError(f"{label} gives the {meaning} of '{name}' twice at t = {time:g}; give one.")
        given[name] = expression
    return given


def _states_given(block: Any, statement: Statement, given: Mapping[float, dict[str, Any]]) -> Iterator[str]:
    """The states that a rule gives something for: at every point, and no other rule does."""
    label, (meaning, _) = statement.label(block), _GIVEN[statement.kind]
    names = list(dict.fromkeys(name for of_point in given.values() for name in of_point))
    for time, of_point in given.items():
        for name in names:
            if name not in of_point:
                raise ModelError(f"{label} gives no {meaning} of '{name}' at t = {time:g}; it must at every point.")
    for name in names:
        if (first := block.record.equation_of.get(name)) is not None:
            again = f" {RUN_AGAIN}" if first == statement.name else ""
            raise ModelError(f"{label} gives a second equation for state '{name}'; '{first}' has given one.{again}")
        yield name


def add_derivative(block: Any, name: str) -> Any:
    """The derivative of a state as a variable of its own, tied to the state by linear collocation rows."""
    record: PhaseRecord = block.record
    declaration = record.declarations[name]
    assert isinstance(declaration, State)
    what = f"phase '{block.name}': state '{name}' (declared at {declaration.declared_at})"
    bounds = check_bounds(declaration.derivative_bounds, what, "derivative bounds")
    rate = Algebraic(bounds=bounds, units=rate_units(declaration.units, record.time_units))
    record.kept_derivatives.add(name)
    derivative = add_values(block, f"{name}_derivative", rate, record.nodes(f"{name}_derivative"), what)
    _add_collocation(block, name, derivative)
    return derivative


def _add_collocation(block: Any, name: str, rates: Mapping[float, Any], is_read_later: bool = False) -> None:
    grid = block.record.grid
    rows = add_generated_rows(block, f"{name}_collocation", block.points)
    boundary = block.boundary if block.record.free_widths else None
    rule = CollocationRows(block.component(name), rates, block.duration, boundary)
    if is_read_later:
        add_rows_by_rule(rows, rule, grid.row_places)
        return
    for time in grid.row_places:
        new_row(rows, time, rule(block, time))


def _add_residual(block: Any, statement: Statement) -> None:
    """Rows for implicit and algebraic equations."""
    what = statement.label(block)
    results, is_read_later = _collect(block, statement)
    for time, rows in results.items():
        for label, row in rows.items():
            if isinstance(row, RelationalExpression) and not isinstance(row, EqualityExpression):
                raise ModelError(
                    f"{what} states the inequality '{row}' at t = {time:g}. Write ==, or use 'constraint' for it."
                )
            if not isinstance(row, RelationalExpression):
                if not _is_expression(row):
                    raise ModelError(f"{what} returned {row!r} at t = {time:g}; expected an equality in variables.")
                rows[label] = row == 0
        if len(rows) != len(next(iter(results.values()))):
            first, count = next((time_of_first, len(stated)) for time_of_first, stated in results.items())
            raise ModelError(
                f"{what} states {count} equations at t = {first:g} and {len(rows)} at t = {time:g}; it must state as "
                "many at every point. What holds at some points only is a 'constraint'."
            )
    block.record.residuals_per_point += _add_rows(block, statement, results, is_read_later)


def _add_expression(block: Any, statement: Statement) -> None:
    """A named expression of this package over the points, which rules read by its name."""
    place(block, statement.name, Expression(block.points, rule=statement))


def _add_constraint(block: Any, statement: Statement) -> None:
    """Rows for path constraints, at the points or at element boundaries."""
    label = statement.label(block)
    results, is_read_later = _collect(block, statement)
    for time, rows in results.items():
        for row in rows.values():
            if isinstance(row, InequalityExpression) and row.strict:
                raise ModelError(
                    f"{label} is strict ('<' or '>') at t = {time:g}, which no solver can keep. Write '<=' or '>=', "
                    "with a margin where the limit itself must not be reached."
                )
            if not isinstance(row, (RelationalExpression, tuple)) and row is not Constraint.Skip:
                raise ModelError(
                    f"{label} returned {_shown(row)} at t = {time:g}; expected a relation such as 'expression <= 1'."
                )
    _add_rows(block, statement, results, is_read_later)


def _shown(returned: Any) -> str:
    """What a rule returned, in a message: a formula as it is written."""
    return f"the formula {returned}" if hasattr(returned, "is_expression_type") else repr(returned)


def _add_complementarity(block: Any, statement: Statement) -> None:
    """A Complementarity component whose pairs know their element and their quadrature weight."""
    name = statement.name
    results, _ = _collect(block, statement)
    pairs = {_index(time, label): pair for time, rows in results.items() for label, pair in rows.items()}
    times = {_index(time, label): time for time, rows in results.items() for label in rows}
    _check_name(block, statement)
    component = Complementarity(
        list(pairs),
        rule=pairs,
        group={index: block.record.grid.element_of[time] for index, time in times.items()},
        weight={index: block.record.grid.quadrature_weights[time] for index, time in times.items()},
    )
    place(block, name, component)


_ADD: dict[str, Callable[[Any, Statement], None]] = {
    "ode": _add_ode,
    "step map": _add_step,
    "residual": _add_residual,
    "constraint": _add_constraint,
    AT_BOUNDARIES: _add_constraint,
    "complementarity": _add_complementarity,
    "expression": _add_expression,
}


def add_statement(block: Any, statement: Statement) -> None:
    """Add what a rule states, and keep it. What the rule makes meanwhile is made anew with it."""
    block.record.asking = True
    try:
        _ADD[statement.kind](block, statement)
    finally:
        block.record.asking = False
    if block.record.restating is None:
        block.record.statements.append(statement)


def asked(block: Any, statement: Statement, time: float, expected: str, *more: PreviousStates) -> Any:
    """What a rule returns at a time.

    Raises
    ------
    ModelError
        Naming the rule and the time, when it returns nothing, or reads what has no value there or another model's.
    """
    label = statement.label(block)
    try:
        with slips_explained(statement.rule, label, block, ("b", "t", "previous")[: 2 + len(more)], ModelError, time):
            result = statement(block, block.record.index_for_rule(block, time, label), *more)
    except KeyError as error:
        if statement.kind == AT_BOUNDARIES:
            raise ModelError(
                f"{label} reads what has no value at an element boundary ({error.args[0]}). Only states have one at "
                "each; what needs controls or algebraics is a 'constraint'."
            ) from None
        if isinstance(error, NoSuchTime):
            raise ModelError(f"{label} at t = {time:g}: {error}") from error
        raise
    if result is None:
        raise ModelError(
            f"{label} returned nothing at t = {time:g}; expected {expected}. Is the return statement missing?"
        )
    # One point tells, and a solve asks for all; what the phase stands on may be assigned to a model later.
    if time == statement.times(block)[0] and isinstance(block.model(), Model):
        foreign = foreign_variable(block, variables_in_any(expressions_returned(result)).values())
        if foreign is not None:
            raise ModelError(f"{label} {foreign_read(foreign, block)} {ONE_MODEL}")
    return result


def _answers(block: Any, statement: Statement, ask: Callable[[float], Any]) -> tuple[dict[float, Any], bool]:
    """Answers of a rule at all of its times; or at two, and that the others say the same and are read later.

    A rule that reads variables alone says the same everywhere, but for these.
    """
    found: dict[float, Any] = {}
    may_be_read_later = statement.kind != "complementarity" and block.record.time_units is None
    for time in statement.times(block):
        found[time] = ask(time)
        if statement.kind != "ode":  # a rate may be a number
            bodies = (row[1] if _is_range(row) else row for row in found[time].values())
            may_be_read_later = may_be_read_later and all(map(_is_expression, bodies))
        if len(found) == 2 and may_be_read_later and statement.reads_variables_alone(block):
            return found, True
    return found, False


def _collect(block: Any, statement: Statement) -> tuple[dict[float, dict[Hashable, Any]], bool]:
    """Answers of a rule as {time: {label: row}}; whether the others are read later, which say the same."""
    label, times = statement.label(block), statement.times(block)

    def rows(time: float) -> dict[Hashable, Any]:
        result = asked(block, statement, time, "one or several relations")
        return labelled_rows(statement.kind, plain_expressions(result))

    results, is_read_later = _answers(block, statement, rows)
    if is_read_later:
        return results, True
    states_something = any(row is not Constraint.Skip for rows in results.values() for row in rows.values())
    # What skips all times without a look at them is switched off, and meant so.
    if not states_something and block.record.restating is None and not statement.rule.is_template(block):
        raise ModelError(
            f"{label} states nothing: it skips all {len(times)} points, t = {times[0]:g} to {times[-1]:g}. A time that "
            "it compares with is no point of the mesh: for one instant write a constraint of the model with "
            "x.at(time), or give the phase a mesh= with a boundary there and use constraint_at_boundaries."
        )
    return results, False


def _add_rows(block: Any, statement: Statement, results: dict[float, dict[Hashable, Any]], is_read_later: bool) -> int:
    """One indexed constraint named after the rule; returns the number of rows at a point."""
    name = statement.name
    _check_name(block, statement)
    if is_read_later:
        of_first = next(iter(results.values()))
        indices = [_index(time, label) for time in statement.times(block) for label in of_first]
        rows = place(block, name, Constraint(indices))
        add_rows_by_rule(rows, StatedRows(statement, of_first), indices)
        return len(of_first)
    indices = [_index(time, label) for time, labelled in results.items() for label in labelled]
    rows = place(block, name, Constraint(indices))
    for time, labelled in results.items():
        for label, row in labelled.items():
            rows.add(_index(time, label), row)
    return max(len(labelled) for labelled in results.values())


def named_integral(block: Any, integrand: Rule) -> Any:
    """See `PhaseBlock.integral`: a member of the named expression that holds the integrals of the phase."""
    record: PhaseRecord = block.record
    statement = Statement("integrand", rule_name(integrand), Template(integrand))
    if record.asking:  # a rule that is evaluated makes its own
        return _integral(block, statement)
    found, is_read_later = _answers(block, statement, lambda time: {None: _summand(block, statement, time)})
    if is_read_later and not record.free_widths:
        scale, _ = quadrature_weights(block)
        return hand_out(block, INTEGRALS, record.integrals, statement, IntegralRule(scale))
    total = _integral(block, statement, {} if is_read_later else found)
    if total.__class__ in native_numeric_types:
        return total
    return hand_out(block, INTEGRALS, record.integrals, statement, total)


class IntegralRule(RowRule):
    """What an integral that a phase has handed out is, by its position.

    Parameters
    ----------
    scale : Var, Expression or float
        A factor of the whole: a component of the horizon, which a transformation may rename.
    """

    def __init__(self, scale: Any) -> None:
        self._scale = scale

    def __call__(self, block: Any, index: int) -> Any:
        """The sum over the points."""
        statement, weights = block.record.integrals[index - 1], block.record.grid.quadrature_weights
        return _scaled(self._scale, quadrature(lambda time: _summand(block, statement, time), weights))

    def sums(self, block: Any, indices: list[int]) -> list[RepeatedSum]:
        """The integrand at all points."""
        scale, weights, found = self._scale, block.record.grid.quadrature_weights, []
        times, is_free = list(weights), scale.__class__ not in native_numeric_types
        for position, index in enumerate(indices):
            statement = block.record.integrals[index - 1]
            formulas: Any = statement.rule.formulas(block)
            variables = [slot.at_all(block, times) for slot in formulas.slots]
            if is_free and not any(each[0] is scale for each in variables):
                variables.append([scale] * len(times))

            def summand(place: int, statement: Statement = statement) -> Any:
                of_time = _summand(block, statement, times[place])
                return scale * of_time if is_free else of_time

            scales = [(1.0 if is_free else scale) * weight for weight in weights.values()]
            found.append(RepeatedSum([position] * len(times), scales, variables, summand))
        return found


def restate_integrals(block: Any) -> None:
    """Give every integral that was handed out its sum over the points that the phase has now."""
    for position, statement in enumerate(block.record.integrals, start=1):
        member = block.component(INTEGRALS)[position]
        held = sum_by_rule(member)
        if held is not None and not block.record.free_widths:
            held.forget()
        else:
            member.set_value(_integral(block, statement))


def _summand(block: Any, statement: Statement, time: float) -> Any:
    """What an integrand returns at a time, where that is one number or formula.

    Raises
    ------
    ModelError
        When it is a list, a relation or nothing.
    """
    label, expected = statement.label(block), "one number or formula, such as b.u[t] ** 2"
    found = asked(block, statement, time, expected)
    if isinstance(found, (str, Sequence, Mapping, RelationalExpression)):
        raise ModelError(
            f"{label} returned a {type(found).__name__} at t = {time:g}; expected {expected}. Return the sum of what "
            "it holds."
        )
    return plain_scalar(found, label)


def _integral(block: Any, statement: Statement, known: Mapping[float, Any] = MappingProxyType({})) -> Any:
    """The sum over the points; of some the integrand may be known, as the rows of `_answers`."""
    scale, weights = quadrature_weights(block)
    total = quadrature(lambda time: known[time][None] if time in known else _summand(block, statement, time), weights)
    return _scaled(scale, total)


def _scaled(scale: Any, total: Any) -> Any:
    return total if isinstance(scale, float) and scale == 1.0 else scale * total


def _index(time: float, label: Hashable) -> Hashable:
    return time if label is None else (time, label)


def _check_name(block: Any, statement: Statement) -> None:
    name = statement.name
    if block.record.restating is not None:
        return  # it was checked when it was stated first
    if block.component(name) is not None or hasattr(type(block), name) or not name.isidentifier():
        raise ModelError(
            f"{statement.label(block)}: its rows are named after the function, but the name '{name}' is taken or no "
            "identifier. Rename the function, or say name='...' beside it."
        )


def name_of_rows(block: Any, kind: str, rule: Rule, given: str | None) -> str:
    """What the rows of a rule are called: as asked for, or like the function.

    A lambda has no name; its rows are called after what they are, and numbered. Where each phase has a method of the
    function's name, its rows have "_rows" behind theirs.

    Raises
    ------
    ModelError
        When the name that was asked for is no identifier.
    """
    if given is not None:
        if not isinstance(given, str) or not given.isidentifier():
            raise ModelError(f"phase '{block.name}': name = {given!r} of a {kind} is no identifier.")
        return given
    name = rule_name(rule)
    if kind in ("ode", "step map"):
        return name  # their rows are called after the states
    if name == "<lambda>":
        stem = kind.replace(" ", "_")
        return next(f"{stem}_{i}" for i in count(1) if not hasattr(block, f"{stem}_{i}"))
    return f"{name}_rows" if hasattr(type(block), name) else name


def rule_name(rule: Rule) -> str:
    """Name of a rule; callable objects without one, such as partials, are named by their type."""
    return getattr(rule, "__name__", type(rule).__name__)


def _is_numeric(rate: object) -> bool:
    """True for one Pyomo number: neither a relation nor a component that still needs an index."""
    numeric = getattr(rate, "is_numeric_type", lambda: False)()
    return numeric and not getattr(rate, "is_indexed", lambda: False)()


def _is_range(row: object) -> bool:
    """Whether a row is (lower, body, upper), each of them stated."""
    return isinstance(row, tuple) and len(row) == 3


def _is_expression(row: object) -> bool:
    return getattr(row, "is_potentially_variable", lambda: False)()
