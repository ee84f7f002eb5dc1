"""From one solve to the next: delta moves, and with it the numbers that a relaxation keeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pyomo.common.config import PositiveFloat
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ComplementarityError

from .group_rows import Product, products
from .record import RelaxationRecord, RelaxedPair, only_record


def finite_positive(number: Any) -> float:
    """Return a positive finite number as a float; any other one is a ValueError."""
    number = PositiveFloat(number)
    if not math.isfinite(number):
        raise ValueError(f"expected a finite number, found {number}")
    return number


def update_parameters(model: Any, delta: float, multipliers: Mapping[Any, float] | None = None) -> bool:
    """Set delta for the next solve, and the numbers of the relaxation from the point and the multipliers of the last.

    Parameters
    ----------
    model : Block
        Relaxed, with the values of the last solve.
    delta : float
        For the next one; positive.
    multipliers : mapping, optional
        From generated rows to their multipliers, of either sign; asked by relaxations that decide from these.
        Default: the model's import suffix ``dual``.

    Returns
    -------
    bool
        Whether any number of the model changed.

    Raises
    ------
    ComplementarityError
        If the model holds no or several relaxations, a side has no value, or multipliers are needed and missing.
    """
    record, delta = only_record(model), finite_positive(delta)
    before = record.main.delta.value
    changed = before != delta
    if record.abilities.keeps_multipliers:
        changed = _update_multipliers(record, before, delta) or changed
    if record.abilities.keeps_bounds:
        changed = _update_bounds(record, delta, _found(record, multipliers)) or changed
    record.main.delta.set_value(delta)
    return changed


def reset_parameters(model: Any, delta: float) -> None:
    """Set delta for a first solve, and whatever `update_parameters` has changed to its first value."""
    record, delta = only_record(model), finite_positive(delta)
    record.main.delta.set_value(delta)
    for group in record.groups:
        for state in group.states:
            state.set_value(0.0 if record.abilities.keeps_multipliers else delta)
        for pair in group.pairs:
            for slack in (pair.a_slack, pair.b_slack):
                if slack is not None:
                    slack.set_value(delta)


def _update_multipliers(record: RelaxationRecord, before: float, delta: float) -> bool:
    changed = False
    for group in record.groups:
        formed = [product for row in products(record, group.pairs) for product in row]
        for product, state in zip(formed, group.states, strict=True):
            amount = _number(record, product.a) * _number(record, product.b)
            changed |= _set(state, record.relaxation.next_multiplier(state.value, amount, before, delta))
    return changed


def _update_bounds(record: RelaxationRecord, delta: float, multipliers: Mapping[Any, float]) -> bool:
    changed = False
    relaxation = record.relaxation
    for group in record.groups:
        # The sides' own slacks are decided from the rows that they stand in, before the bounds of these rows move.
        pulls: dict[int, tuple[RelaxedPair, float]] = {}
        for row, formed, state in zip(group.rows, products(record, group.pairs), group.states, strict=True):
            multiplier = abs(multipliers.get(row) or 0.0)
            values = [(_number(record, product.a), _number(record, product.b)) for product in formed]
            for product in formed:
                for pair in _pairs_of(product):
                    known = pulls.get(id(pair), (pair, 0.0))[1]
                    pulls[id(pair)] = (pair, max(known, multiplier))
            changed |= _set(state, relaxation.next_bound(state.value, delta, values, multiplier))
        for pair, multiplier in pulls.values():
            a, b = _number(record, pair.a), _number(record, pair.b)
            for slack, side, partner in ((pair.a_slack, a, b), (pair.b_slack, b, a)):
                if slack is not None:
                    changed |= _set(slack, relaxation.next_slack(slack.value, delta, side, partner, multiplier))
    return changed


def _pairs_of(product: Product) -> list[RelaxedPair]:
    return [*product.a_pairs, *product.b_pairs]


def _set(parameter: Any, number: float) -> bool:
    changed = parameter.value != number
    parameter.set_value(number)
    return changed


def _number(record: RelaxationRecord, side: Any) -> float:
    number = value(side, exception=False)
    if number is None:
        raise ComplementarityError(
            f"'{record.main.name}': the side '{side}' has no value to go on from. Solve the model first."
        )
    return float(number)


def _found(record: RelaxationRecord, multipliers: Mapping[Any, float] | None) -> Mapping[Any, float]:
    if multipliers is not None:
        return multipliers
    model = record.main.model()
    suffix = model.component("dual")
    if not isinstance(suffix, Suffix) or not suffix.import_enabled():
        raise ComplementarityError(
            f"'{model.name}': {record.relaxation} decides from the multipliers of its rows, and there is no suffix "
            "'dual' to read them from. Declare dual = Suffix(direction=Suffix.IMPORT) before the solve, or pass them."
        )
    return suffix
