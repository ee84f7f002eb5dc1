"""What a problem of the suite is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TextbookProblem:
    """A published problem, stated as its source states it.

    Attributes
    ----------
    name : str
    source : str
        Author or collection.
    published : float
        The best published value of the objective; where `computed`, that of a fine mesh instead.
    build : callable
        ``build(mesh, elements)`` makes the model; either may be None.
    elements : int or None
        Of each phase to start with; None for the default.
    phases : tuple of str
        Names of the phases, where there are several: ``build`` then takes a mesh for each.
    computed : bool
        Whether no source gives enough digits, so that the value to compare with was computed here.
    """

    name: str
    source: str
    published: float
    build: Callable[..., Any]
    elements: int | None = None
    phases: tuple[str, ...] = ()
    computed: bool = False
