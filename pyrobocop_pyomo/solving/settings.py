"""What the caller of the procedure chose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TextIO

from pyrobocop_pyomo.ipopt.routes import Route

from .tolerances import Tolerances


@dataclass(frozen=True)
class Settings:
    """How to solve; see `solve`. Where the route cannot take a model, ``otherwise`` is the one to take instead."""

    relaxation: Any
    grouping: Any
    route: Route
    options: Mapping[str, Any]
    output: Sequence[TextIO]
    tolerances: Tolerances
    polish: bool
    otherwise: Route | None = None
