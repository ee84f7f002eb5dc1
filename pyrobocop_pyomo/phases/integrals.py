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
    total = _integral(block, record, statement)
    if record.asking or record.restating is not None or total.__class__ in native_numeric_types:
        return total  # a rule that is evaluated anew makes its own
    named = block.component(INTEGRALS)
    if named is None:
        named = add_generated(block, record, INTEGRALS, Expression(AnyIndex, doc="integrals over the phase"))
    record.integrals.append(statement)
    position = len(record.integrals)
    named[position] = total
    return named[position]


def restate_integrals(block: Any, record: PhaseRecord) -> None:
    """Give every integral that was handed out its sum over the points that the phase has now."""
    for position, statement in enumerate(record.integrals, start=1):
        block.component(INTEGRALS)[position].set_value(_integral(block, record, statement))


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


def _integral(block: Any, record: PhaseRecord, statement: Statement) -> Any:
    scale, weights = quadrature_weights(block, record)
    what = f"phase '{block.name}': the integrand '{statement.name}'"
    terms: list[Any] = []

    def integrand(time: float) -> Any:
        with slips_explained(statement.rule, what, block, ("b", "t"), ModelError, time):
            terms.append(_one_number(statement(block, record.index_for_rule(block, time, what)), what, time))
        return terms[-1]

    total = quadrature(integrand, weights)
    refuse_foreign_reads(block, what, terms[:1])
    plain = isinstance(scale, float) and scale == 1.0
    return total if plain else scale * total
