"""What the user gave the variables at the points that a continuous set had, for the points that are new.

Bounds and domains of the declaration hold at every point; Pyomo sees to that. What was set afterwards, by
``x.setub(3)`` or ``u.fix(0)``, exists at the first points only, and has to be told from a boundary condition. The
rules, for each variable with its other indices:

* changed at every point and equal: it was meant for all points;
* changed at some points only: a condition at these points;
* changed at every point and different: nobody knows, refused;
* fixed at every point: a control or an algebraic is fixed everywhere, if at one value or at its declared ones; a state
  is not, since fixing it at both ends is how boundary conditions are stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import TranscriptionError

ATTRIBUTES = ("lower", "upper", "domain")
WORDS = {"lower": "lower bounds", "upper": "upper bounds", "domain": "domains"}


@dataclass
class Family:
    """One variable along a continuous set.

    Attributes
    ----------
    is_state : bool
        Whether it has a derivative with respect to the set.
    declared : callable or None
        ``declared(data, attribute)`` is what the declaration of the variable says at a point.
    points : set of float
        The collocation points.
    old, new : list of (time, variable)
    """

    is_state: bool
    declared: Callable[[Any, str], Any] | None
    points: frozenset[float]
    old: list[tuple[float, Any]] = field(default_factory=list)
    new: list[tuple[float, Any]] = field(default_factory=list)

    def inherit(self, domain: Any) -> None:
        """Give the new points what the old ones have.

        Raises
        ------
        TranscriptionError
            When the old points disagree.
        """
        if not self.old or not self.new:
            return
        for attribute in ATTRIBUTES:
            self._inherit(attribute, domain)
        self._guess()
        if not self.is_state:
            self._inherit_fixing(domain)

    def _declared_at(self, data: Any, attribute: str) -> Any:
        if self.declared is not None:
            return self.declared(data, attribute)
        # A variable within a block: what the block's rule gave it at a new point.
        return getattr(self.new[0][1], "value" if attribute == "initial" else attribute)

    def _inherit(self, attribute: str, domain: Any) -> None:
        given = [getattr(data, attribute) for _, data in self.old]
        changed = [
            not _same(each, self._declared_at(data, attribute)) for each, (_, data) in zip(given, self.old, strict=True)
        ]
        if not all(changed):
            for (time, data), each in zip(self.old, changed, strict=True):
                if each and not self.is_state and time not in self.points:
                    raise TranscriptionError(
                        f"'{data.name}': has {WORDS[attribute]} of its own, but no value: the scheme has no "
                        f"collocation point at {domain.local_name} = {time:g}. Take them away, or choose a scheme with "
                        "a point there."
                    )
            return
        by_rule = {id(getattr(data, attribute)): getattr(data, attribute) for _, data in self.new}
        if self.declared is None and not all(_same(each, next(iter(by_rule.values()))) for each in by_rule.values()):
            return  # the rule of a block gives each point its own
        if not all(_same(each, given[0]) for each in given):
            (first, data), (last, other) = self.old[0], self.old[-1]
            raise TranscriptionError(
                f"'{data.name}' and '{other.name}': their {WORDS[attribute]} were set to {_text(given[0])} and "
                f"{_text(given[-1])}; what holds between {first:g} and {last:g} is unknown. Give the variable "
                f"{'domain' if attribute == 'domain' else 'bounds'}=... as a function of '{domain.name}', or set them "
                "after the transformation."
            )
        for _, data in self.new:
            setattr(data, attribute, given[0])

    def _guess(self) -> None:
        known = [(time, data.value) for time, data in self.old if data.value is not None]
        if not known:
            return
        declared = [self._declared_at(data, "initial") for _, data in self.old]
        kept = any(
            initial is not None and data.value == initial for initial, (_, data) in zip(declared, self.old, strict=True)
        )
        if kept and all(data.value is not None for _, data in self.new):
            return
        known.sort()
        times, values = np.array([time for time, _ in known], dtype=float), np.array([each for _, each in known])
        for (_, data), guess in zip(self.new, np.interp([time for time, _ in self.new], times, values), strict=True):
            set_guess(data, float(guess))

    def _inherit_fixing(self, domain: Any) -> None:
        if not all(data.fixed for _, data in self.old):
            return
        values = [data.value for _, data in self.old]
        if all(each == values[0] for each in values):
            for _, data in self.new:
                data.fix(values[0], skip_validation=True)
            return
        declared = [self._declared_at(data, "initial") for _, data in self.old]
        if self.declared is not None and all(a == b for a, b in zip(values, declared, strict=True)):
            for _, data in self.new:
                data.fix()
            return
        names = ", ".join(f"'{data.name}' at {_text(data.value)}" for _, data in self.old)
        raise TranscriptionError(
            f"{names}: fixed at different values; the values between are unknown. Fix one value, give the variable "
            f"initialize=... as a function of '{domain.name}' before fixing it, or fix it after the transformation."
        )


def declaration_of(component: Any) -> Callable[[Any, str], Any]:
    """What the declaration of an indexed variable says at each of its points."""

    def declared(data: Any, attribute: str) -> Any:
        parent, index = component.parent_block(), data.index()
        if attribute == "domain":
            return component._rule_domain(parent, index, component)
        if attribute == "initial":
            rule = component._rule_init
            if rule is None or (rule.contains_indices() and index not in set(rule.indices())):
                return None
            return value(rule(parent, index), exception=False)
        side = 0 if attribute == "lower" else 1
        given = component._rule_bounds(parent, index) if component._rule_bounds is not None else None
        bound, implied = (given or (None, None))[side], data.domain.bounds()[side]
        if bound is None or implied is None:
            return implied if bound is None else bound
        # What Pyomo shows as the bound of a variable is the tighter of both.
        return (max, min)[side](bound, implied, key=value)

    return declared


def set_guess(data: Any, guess: float) -> None:
    """Give a variable a value to start from, moved onto the nearest bound if it lies outside."""
    lower, upper = data.bounds
    if lower is not None and guess < lower:
        guess = lower
    if upper is not None and guess > upper:
        guess = upper
    data.set_value(guess, skip_validation=True)


def _same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    if one is None or other is None:
        return _infinite(one) and _infinite(other)
    try:
        return bool(value(one, exception=False) == value(other, exception=False)) and _numeric(one) == _numeric(other)
    except (TypeError, AttributeError):
        return False


def _infinite(bound: Any) -> bool:
    return bound is None or (_numeric(bound) and bound in (float("inf"), float("-inf")))


def _numeric(bound: Any) -> bool:
    return bound.__class__ in native_numeric_types


def _text(given: Any) -> str:
    return f"{given:g}" if _numeric(given) else str(given)
