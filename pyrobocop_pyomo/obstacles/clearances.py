"""What is required as clearance: numbers, parameters, variables, expressions, rules of time."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping
from functools import partial
from numbers import Real
from typing import Any

from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.expr.numvalue import NumericValue, is_fixed, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.expression_bounds import ExpressionBounds
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.required_clearance import clearance_text, clearance_value, is_clearance_rule
from pyrobocop_pyomo.motion.rules_along_motion import expressions_between, formulas_between, rule_at_node
from pyrobocop_pyomo.templates.template import Template

from .scene import BodyPair, checked_pair


class ClearanceRule(Template):
    """A clearance that changes in time: ``rule(block, t)``, as the user gave it."""


def _is_length(number: Any) -> bool:
    return isinstance(number, Real) and not isinstance(number, bool) and 0.0 < float(number) < math.inf


# ------------------------------------------------------------------------------------------------------ what was given


def asked_clearances(
    label: str, body_pairs: Iterable[BodyPair], bodies: Collection[str], clearance: Any
) -> dict[BodyPair, Any]:
    """The clearance of each watched body pair: a float, an expression or a `ClearanceRule`.

    Raises
    ------
    ObstacleError
        Naming the body pair, where it is no length, or is missing.
    """
    pairs = list(body_pairs)
    if isinstance(clearance, IndexedComponent) and clearance.is_indexed():
        clearance = {key: clearance[key] for key in clearance}
    if isinstance(clearance, Mapping):
        asked = {frozenset(checked_pair(label, "clearance", key, bodies)): given for key, given in clearance.items()}
        missing = [pair for pair in pairs if frozenset(pair) not in asked]
        if missing:
            raise ObstacleError(
                f"{label}: clearance= says nothing about {', '.join(map(str, missing))}. Add them, or leave these body "
                "pairs out by exclude=."
            )
        watched = {frozenset(pair) for pair in pairs}
        unwatched = [tuple(sorted(pair)) for pair in asked if pair not in watched]
        if unwatched:
            raise ObstacleError(
                f"{label}: clearance= is given for {', '.join(map(str, unwatched))}, which is not watched. "
                "Add the pair to body_pairs=, or leave it out of clearance=."
            )
    else:
        asked = {frozenset(pair): clearance for pair in pairs}
    return {pair: _checked_clearance(label, pair, asked[frozenset(pair)]) for pair in pairs}


def _checked_clearance(label: str, pair: BodyPair, given: Any) -> Any:
    if isinstance(given, ClearanceRule):
        return given
    if is_clearance_rule(given):
        return ClearanceRule(given)
    if isinstance(given, NumericValue):
        known = value(given, exception=False) if is_fixed(given) else None
        if known is not None and not _is_length(float(known)):
            raise ObstacleError(
                f"{label}: {clearance_text(pair)} is '{given}' = {float(known):g}; it must be a length > 0. "
                "Give the parameter another value."
            )
        # An immutable Param is a number.
        return given if not given.is_constant() else float(value(given))
    if not _is_length(given):
        raise ObstacleError(
            f"{label}: {clearance_text(pair)} is {given!r}; it must be a length > 0: a number, a Param, a Var or an "
            "expression of the model, or a rule(block, t). Without clearance nothing tells touching "
            "from overlapping; choose well above the solver's tolerance."
        )
    return float(given)


# ------------------------------------------------------------------------------------------------- on a block, at times


def length_at(motion: Motion, rule: ClearanceRule, pair: BodyPair, segment: Any, position: int) -> Any:
    """What a rule asks for at one of the times of a segment, in expressions of the variables at the nodes.

    Raises
    ------
    ObstacleError
        Naming the body pair and the time.
    """
    what, time = clearance_text(pair), segment.times[position]
    with rule_at_node(motion, rule.rule, what, time):
        if segment.interval is None or time in motion.intervals[segment.interval]:
            phase = motion.phase
            found = rule(motion.block, time if phase is None else phase.record.index_for_rule(phase, time, what))
        else:
            formulas = formulas_between(motion, rule, what, partial(rule, motion.block))
            found = expressions_between(motion, formulas, segment.interval, segment.fractions[position], what)
    known = isinstance(found, Real) or (isinstance(found, NumericValue) and is_fixed(found))
    if not isinstance(found, (Real, NumericValue)) or isinstance(found, bool):
        raise ObstacleError(f"{what} at t = {time!r} is {found!r}; its rule must return a length.")
    if known and not _is_length(clearance_value(found, what)):
        raise ObstacleError(f"{what} at t = {time!r} is {value(found):g}; it must be a length > 0.")
    return found


def asked_at(block: Any, pair: BodyPair, time: Hashable) -> Any:
    """The clearance of a body pair at a time with a pose, as an expression."""
    asked = block.record.asked[pair]
    if isinstance(asked, float):
        return block.clearance[pair]
    return block.record.lengths[(*pair, time)] if isinstance(asked, ClearanceRule) else asked


def verified_clearances(block: Any) -> dict[BodyPair, Any]:
    """The clearances that `verify_clearance` takes: numbers, expressions and rules."""
    asked = block.record.asked.items()
    return {pair: of if isinstance(of, ClearanceRule) else asked_at(block, pair, None) for pair, of in asked}


def clearance_values(block: Any, pair: BodyPair) -> list[float]:
    """The clearance of a body pair at all times with a pose, at the current values; NaN where there are none."""
    asked = block.record.asked[pair]
    times = [key[2] for key in block.record.lengths if key[:2] == pair] if isinstance(asked, ClearanceRule) else [None]
    numbers = [value(asked_at(block, pair, time), exception=False) for time in times]
    return [math.nan if number is None else float(number) for number in numbers]


def least_possible(expression: Any) -> float:
    """The least value of a clearance, whatever its variables become; 0 where it is not known."""
    if isinstance(expression, Real) or not expression.is_potentially_variable():
        return float(value(expression))
    lower, _ = ExpressionBounds(use_fixed_var_values_as_bounds=True).walk_expression(expression)
    return max(float(lower), 0.0) if lower is not None and math.isfinite(lower) else 0.0


def update_estimates(block: Any) -> None:
    """Note the largest clearance of each body pair as a number, for what needs to know about how far away is enough."""
    record = block.record
    for pair in record.asked:
        known = [number for number in clearance_values(block, pair) if math.isfinite(number)]
        record.scene.clearances[pair] = max(known, default=0.0)
