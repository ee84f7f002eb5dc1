"""Integrals by the quadrature of the scheme, which has the order of the states."""

from __future__ import annotations

from typing import Any

from pyomo.core.base.expression import Expression
from pyomo.dae import Integral

from pyrobocop_pyomo.errors import TranscriptionError
from pyrobocop_pyomo.transcription import quadrature

from .record import Discretisation, Record
from .structure import Spot


def integrals_along(spots: list[Spot], domain: Any) -> list[Any]:
    """Every integral over a set."""
    return [
        spot.component
        for spot in spots
        if isinstance(spot.component, Integral) and spot.component.get_continuousset() is domain
    ]


def remember_integrands(spots: list[Spot], record: Record) -> None:
    """Keep the user's own rules: those of the components are wrapped in the trapezoidal rule.

    Raises
    ------
    TranscriptionError
        When the rule cannot be found.
    """
    for spot in spots:
        integral = spot.component
        if not isinstance(integral, Integral) or integral in record.integrands:
            continue
        # pyomo.dae has no public way to the integrand; it lives in the environment of the wrapped rule.
        wrapped = getattr(integral._rule, "_fcn", None)
        rule = getattr(wrapped, "__globals__", {}).get("rule")
        if not callable(rule):
            raise TranscriptionError(
                f"'{integral.name}': its integrand cannot be read; give it as rule=... a function."
            )
        record.integrands[integral] = rule


def integrate(integral: Any, done: Discretisation, record: Record) -> None:
    """Give an integral its value as an expression at the collocation points."""
    rule, block, place = record.integrands[integral], integral.parent_block(), integral.loc
    indices = list(integral.index_set()) if integral.is_indexed() else [None]
    for index in indices:
        others = index if isinstance(index, tuple) else () if index is None else (index,)
        before, after = others[:place], others[place:]
        integrand = {time: rule(block, *before, time, *after) for time in done.grid.points}
        value = quadrature(integrand.__getitem__, done.grid.quadrature_weights)
        if index in integral._data:
            integral._data[index].set_value(value)
        else:
            integral._setitem_when_not_present(index, value)


def become_expression(integral: Any) -> None:
    """An integral whose set is discretised is an expression like any other, as pyomo.dae has it."""
    if integral.ctype is Integral:
        integral.parent_block().reclassify_component_type(integral, Expression)
    # The wrapped rule has done its work, and no pickle can hold it.
    integral._rule = None
