"""Integrals over a phase, by name: an objective that holds one follows when the phase gets another mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_scalar
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, SumRule, follow_rule, follows_rule, let_follow_rule
from pyrobocop_pyomo.templates.template import Template
from pyrobocop_pyomo.transcription import quadrature

from .equations import Rule, asked, rule_name
from .horizon import quadrature_weights
from .record import Statement, add_generated

INTEGRALS = "stated_integrals"


def named_integral(block: Any, integrand: Rule) -> Any:
    """See `PhaseBlock.integral`: a member of the named expression that holds the integrals of the phase."""
    statement = Statement("integrand", rule_name(integrand), Template(integrand))
    is_part = block.record.asking or block.record.restating is not None  # a rule that is evaluated anew makes its own
    is_read_later = not is_part and _is_read_later(block, statement)
    total = None if is_read_later else _stated(block, statement)
    if is_part or total.__class__ in native_numeric_types:
        return total
    named = block.component(INTEGRALS)
    if named is None:
        named = add_generated(block, INTEGRALS, Expression(AnyIndex, doc="integrals over the phase"))
        follow_rule(named, _Integrals(block.duration))
    block.record.integrals.append(statement)
    position = len(block.record.integrals)
    named[position] = total
    if is_read_later:
        let_follow_rule(named[position])
    return named[position]


def _is_read_later(block: Any, statement: Statement) -> bool:
    """Whether an integrand says the same everywhere but for variables; then it is evaluated twice, and found right."""
    if block.record.time_units is not None or block.record.free_widths or not statement.reads_variables_alone(block):
        return False
    first = [_summand(block, statement, time) for time in block.record.grid.points[:2]]
    # The second answer is compared with the rule's own, which may show that it is no template.
    is_sum = all(term.__class__ not in native_numeric_types for term in first)
    return is_sum and statement.reads_variables_alone(block)


class _Integrals(SumRule):
    """The integrals of a phase.

    Parameters
    ----------
    duration : Var or float
        Of the phase.
    """

    def __init__(self, duration: Any) -> None:
        self._duration = duration

    def __call__(self, block: Any, index: int) -> Any:
        """The sum over the points."""
        return _integral(block, block.record.integrals[index - 1], self._duration, None)

    def repeated(self, block: Any, index: int) -> RepeatedSum:
        """Its summands."""
        statement = block.record.integrals[index - 1]
        formulas: Any = statement.rule.formulas(block)
        times = list(block.record.grid.points)
        factor, weights = quadrature_weights(block.record, self._duration, None)
        variables = [slot.at_all(block, times) for slot in formulas.slots]
        is_number = factor.__class__ in native_numeric_types

        def expression(place: int) -> Any:
            term = _summand(block, statement, times[place])
            return term if is_number else factor * term

        if not is_number and not any(factor is each[0] for each in variables):
            variables.append([factor] * len(times))
        scales = [weights[time] * factor if is_number else weights[time] for time in times]
        return RepeatedSum([0] * len(times), scales, variables, expression)


def restate_integrals(block: Any) -> None:
    """Give every integral that was handed out its sum over the points that the phase has now."""
    for position, statement in enumerate(block.record.integrals, start=1):
        member = block.component(INTEGRALS)[position]
        if follows_rule(member):
            let_follow_rule(member)  # what was read of it is that of the mesh before
        else:
            member.set_value(_stated(block, statement))


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


def _stated(block: Any, statement: Statement) -> Any:
    """The integral of a phase whose components have their names."""
    return _integral(block, statement, block.duration, block.boundary if block.record.free_widths else None)


def _integral(block: Any, statement: Statement, duration: Any, boundary: Any) -> Any:
    scale, weights = quadrature_weights(block.record, duration, boundary)
    total = quadrature(lambda time: _summand(block, statement, time), weights)
    plain = isinstance(scale, float) and scale == 1.0
    return total if plain else scale * total
