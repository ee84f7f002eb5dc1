"""The words that stand for relaxations."""

from __future__ import annotations

from typing import Any

from .penalty import Penalty
from .protocol import ObjectiveTerm, Relaxation
from .scholtes import Scholtes, ScholtesEquality

RELAXATIONS: dict[str, type] = {
    "scholtes": Scholtes,
    "scholtes equality": ScholtesEquality,
    "penalty": Penalty,
    "l1": Penalty,
}


def as_relaxation(choice: str | Relaxation | ObjectiveTerm) -> Any:
    """Turn a word such as "scholtes" or "penalty", or a relaxation object, into the object.

    Raises
    ------
    ValueError
        If it is neither a known word nor an object that can bound or charge a product.
    """
    if isinstance(choice, str):
        if choice not in RELAXATIONS:
            raise ValueError(f"unknown relaxation {choice!r}. Known: {', '.join(map(repr, RELAXATIONS))}.")
        return RELAXATIONS[choice]()
    if isinstance(choice, type) or not isinstance(choice, (Relaxation, ObjectiveTerm)):
        raise ValueError(
            f"{choice!r} is no relaxation: it needs the methods residual(a, b, delta) and shift(delta), "
            "or coefficient(delta). Pass an object or a word."
        )
    return choice
