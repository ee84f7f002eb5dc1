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
from pyrobocop_pyomo.templates.template import Template
from pyrobocop_pyomo.transcription import quadrature

from .equations import Rule, asked, rule_name
from .horizon import quadrature_weights
from .record import Statement, add_generated

INTEGRALS = "stated_integrals"


def named_integral(block: Any, integrand: Rule) -> Any:
    """See `PhaseBlock.integral`: a member of the named expression that holds the integrals of the phase."""
    statement = Statement("integrand", rule_name(integrand), Template(integrand))
    total = _integral(block, statement)
    is_part = block.record.asking  # a rule that is evaluated makes its own
    if is_part or total.__class__ in native_numeric_types:
        return total
    named = block.component(INTEGRALS)
    if named is None:
        named = add_generated(block, INTEGRALS, Expression(AnyIndex, doc="integrals over the phase"))
    block.record.integrals.append(statement)
    position = len(block.record.integrals)
    named[position] = total
    return named[position]


def restate_integrals(block: Any) -> None:
    """Give every integral that was handed out its sum over the points that the phase has now."""
    for position, statement in enumerate(block.record.integrals, start=1):
        block.component(INTEGRALS)[position].set_value(_integral(block, statement))


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


def _integral(block: Any, statement: Statement) -> Any:
    scale, weights = quadrature_weights(block)
    total = quadrature(lambda time: _summand(block, statement, time), weights)
    plain = isinstance(scale, float) and scale == 1.0
    return total if plain else scale * total
