"""How one product is bounded, and the penalties that stand in for a bound: one small file for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .elastic import Elastic
from .fischer_burmeister import FischerBurmeister
from .kanzow_schwartz import KanzowSchwartz
from .penalty import Penalty
from .protocol import ObjectiveTerm, Relaxation
from .scholtes import Scholtes
from .smoothed_minimum import ChenHarkerKanzowSmale
from .steffensen_ulbrich import SteffensenUlbrich

RELAXATIONS: dict[str, Callable[[], Any]] = {
    "scholtes": Scholtes,
    "steffensen-ulbrich": SteffensenUlbrich,
    "kanzow-schwartz": KanzowSchwartz,
    "fischer-burmeister": FischerBurmeister,
    "chks": ChenHarkerKanzowSmale,
    "penalty": Penalty,
    "l1": Penalty,
    "elastic": Elastic,
    "linf": Elastic,
}


def as_relaxation(choice: str | Relaxation | ObjectiveTerm) -> Any:
    """Return the relaxation of a name such as "scholtes" or "penalty"; an object is returned as it is.

    Raises
    ------
    ValueError
        If it is neither a known name nor an object that can bound or penalise a product.
    """
    if isinstance(choice, str):
        name = choice.replace("_", "-")
        if name not in RELAXATIONS:
            raise ValueError(f"unknown relaxation {choice!r}. Known: {', '.join(map(repr, RELAXATIONS))}.")
        return RELAXATIONS[name]()
    if isinstance(choice, type) or not isinstance(choice, (Relaxation, ObjectiveTerm)):
        raise ValueError(
            f"{choice!r} is not a relaxation: it needs the methods residual(a, b, delta) and shift(delta), "
            "or coefficient(delta). Pass an object or a name."
        )
    return choice
