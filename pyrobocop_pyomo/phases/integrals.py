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
from pyrobocop_pyomo.modeling.rule_slips import slips_explained
from pyrobocop_pyomo.rules.rule_template import RuleTemplate
from pyrobocop_pyomo.transcription import quadrature

from .equations import Rule, refuse_foreign_reads, rule_name
from .horizon import quadrature_weights
from .record import PhaseRecord, Statement
from .variables import add_generated

INTEGRALS = "stated_integrals"


def named_integral(block: Any, record: PhaseRecord, integrand: Rule) -> Any:
    """See `PhaseBlock.integral`: a member of the named expression that holds the integrals of the phase."""
    statement = Statement("integral", rule_name(integrand), RuleTemplate(integrand))
    is_part = record.asking or record.restating is not None  # a rule that is evaluated anew makes its own
    is_read_later = not is_part and _is_read_later(block, record, statement)
    total = None if is_read_later else _stated(block, record, statement)
    if is_part or total.__class__ in native_numeric_types:
        return total
    named = block.component(INTEGRALS)
    if named is None:
        named = add_generated(block, record, INTEGRALS, Expression(AnyIndex, doc="integrals over the phase"))
        follow_rule(named, _Integrals(block.duration))
    record.integrals.append(statement)
    position = len(record.integrals)
    named[position] = total
    if is_read_later:
        let_follow_rule(named[position])
    return named[position]


def _is_read_later(block: Any, record: PhaseRecord, statement: Statement) -> bool:
    """Whether an integrand says the same everywhere but for variables; then it is evaluated twice, and found right."""
    if record.time_units is not None or record.free_widths or not statement.reads_variables_alone(block):
        return False
    what = _label(block, statement)
    first = [_summand(block, record, statement, what, time) for time in record.grid.points[:2]]
    refuse_foreign_reads(block, what, first[:1])
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
        record: PhaseRecord = block.record
        return _integral(block, record, record.integrals[index - 1], quadrature_weights(record, self._duration, None))

    def repeated(self, block: Any, index: int) -> RepeatedSum:
        """Its summands."""
        record: PhaseRecord = block.record
        statement = record.integrals[index - 1]
        formulas: Any = statement.rule.formulas(block)
        times = list(record.grid.points)
        factor, weights = quadrature_weights(record, self._duration, None)
        variables = [slot.at_all(block, times) for slot in formulas.slots]
        is_number = factor.__class__ in native_numeric_types

        def expression(place: int) -> Any:
            term = _summand(block, record, statement, _label(block, statement), times[place])
            return term if is_number else factor * term

        if not is_number and not any(factor is each[0] for each in variables):
            variables.append([factor] * len(times))
        scales = [weights[time] * factor if is_number else weights[time] for time in times]
        return RepeatedSum([0] * len(times), scales, variables, expression)


def restate_integrals(block: Any, record: PhaseRecord) -> None:
    """Give every integral that was handed out its sum over the points that the phase has now."""
    for position, statement in enumerate(record.integrals, start=1):
        member = block.component(INTEGRALS)[position]
        if not follows_rule(member):
            member.set_value(_stated(block, record, statement))


def _one_number(found: Any, label: str, time: float) -> Any:
    """What an integrand returned, where that is one number or formula.

    Raises
    ------
    ModelError
        When it is a list, a relation or nothing.
    """
    if found is None or isinstance(found, (str, Sequence, Mapping, RelationalExpression)):
        kind = "nothing" if found is None else f"a {type(found).__name__}"
        raise ModelError(
            f"{label} returned {kind} at t = {time:g}; expected one number or formula, such as b.u[t] ** 2. "
            + ("Is the return statement missing?" if found is None else "Return the sum of what it holds.")
        )
    return plain_scalar(found, label)


def _label(block: Any, statement: Statement) -> str:
    return f"phase '{block.name}': the integrand '{statement.name}'"


def _summand(block: Any, record: PhaseRecord, statement: Statement, label: str, time: float) -> Any:
    with slips_explained(statement.rule, label, block, ("b", "t"), ModelError, time):
        return _one_number(statement(block, record.index_for_rule(block, time, label)), label, time)


def _stated(block: Any, record: PhaseRecord, statement: Statement) -> Any:
    """The integral of a phase whose components have their names."""
    boundary = block.boundary if record.free_widths else None
    return _integral(block, record, statement, quadrature_weights(record, block.duration, boundary))


def _integral(
    block: Any, record: PhaseRecord, statement: Statement, scaled_weights: tuple[Any, dict[float, Any]]
) -> Any:
    scale, weights = scaled_weights
    what = _label(block, statement)
    terms: list[Any] = []

    def integrand(time: float) -> Any:
        terms.append(_summand(block, record, statement, what, time))
        return terms[-1]

    total = quadrature(integrand, weights)
    refuse_foreign_reads(block, what, terms[:1])
    plain = isinstance(scale, float) and scale == 1.0
    return total if plain else scale * total
