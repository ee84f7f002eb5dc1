"""The objective of a relaxed model that pays for products, or for the variable that bounds them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pyomo.core import Objective, minimize, quicksum

from .formulation import Formulation, products
from .record import Record, RelaxedPair


def charged_objective(record: Record, changing: Iterable[Formulation]) -> Any:
    """The user's objective with the charge for all groups, of which some are about to change or to appear."""
    relaxation, main = record.relaxation, record.main
    if record.abilities.penalises_products:
        changed = {id(formulation.group): formulation for formulation in changing}
        terms: list[Any] = []
        for group in record.groups:
            formulation = changed.pop(id(group), None)
            source = group if formulation is None else formulation
            terms += _terms(record, source.pairs, source.states)
        for formulation in changed.values():
            terms += _terms(record, formulation.pairs, formulation.states)
        amount = quicksum(terms)
    else:
        amount = main.excess
    term = relaxation.coefficient(main.delta) * amount
    if record.objective is None:
        return term
    # The user's objective enters by name: what is later assigned to it is followed.
    return record.objective + term if record.objective.is_minimizing() else record.objective - term


def set_objective(record: Record, expression: Any) -> None:
    """Let the generated objective take the place of the user's."""
    block = record.main
    if block.component("objective") is None:
        users = record.objective
        block.objective = Objective(expr=expression, sense=minimize if users is None else users.sense)
        if users is not None:
            users.deactivate()
    else:
        block.objective.set_value(expression)


def _terms(record: Record, pairs: Sequence[RelaxedPair], states: Sequence[Any]) -> list[Any]:
    formed = [product for row in products(record, pairs) for product in row]
    # A factor of one is dropped by Pyomo itself.
    if record.abilities.keeps_multipliers:
        charge = record.relaxation.charge
        return [
            product.weight * charge(product.a * product.b, state) for product, state in zip(formed, states, strict=True)
        ]
    return [product.weight * (product.a * product.b) for product in formed]
