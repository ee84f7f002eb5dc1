"""Rules that hold the width of the elements as a number: on another mesh they would go on with the old one."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

from .record import PhaseRecord

# Sums and quotients that lead to a width differ from it by rounding.
_ROUNDING = 1e-12


def captured_width(record: PhaseRecord) -> str | None:
    """The first rule of a phase that holds a number which is the width of all its elements, in words.

    A constant of the user's that happens to be equal cannot be told from it.
    """
    widths = record.grid.mesh.widths
    if widths.max() - widths.min() > _ROUNDING * widths.max() or len(widths) == 1:
        return None
    width = float(widths[0])
    for statement in (*record.statements, *record.integrals):
        for name, number in _numbers_of(statement.rule):
            if math.isclose(number, width, rel_tol=_ROUNDING):
                return (
                    f"its {statement.kind} '{statement.name}' holds {name} = {number:g}, which is the width of the "
                    "elements and would stay so on another mesh. Read it in the rule: "
                    "b.grid.mesh.widths[b.grid.element_of[t]]."
                )
    return None


def _numbers_of(rule: Callable[..., Any] | None, depth: int = 2) -> Iterator[tuple[str, float]]:
    """Numbers that a function reads from what surrounds it, also through the functions that it calls."""
    if isinstance(rule, functools.partial):
        named = {**{str(i): given for i, given in enumerate(rule.args)}, **rule.keywords}
        yield from _among(named, depth)
        rule = rule.func
    if inspect.isfunction(rule):
        held = inspect.getclosurevars(rule)
        yield from _among({**held.nonlocals, **held.globals}, depth)


def _among(named: dict[str, Any], depth: int) -> Iterator[tuple[str, float]]:
    for name, held in named.items():
        if isinstance(held, float):
            yield name, float(held)
        elif depth and inspect.isfunction(held):
            yield from _numbers_of(held, depth - 1)
