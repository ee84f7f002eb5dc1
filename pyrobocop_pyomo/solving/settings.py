"""What the caller of the procedure chose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TextIO

from pyrobocop_pyomo.ipopt.backends import Backend

from .tolerances import Tolerances


@dataclass(frozen=True)
class Settings:
    """How to solve; see `solve`. Where the backend cannot take a model, ``otherwise`` is the one to take instead."""

    relaxation: Any
    grouping: Any
    backend: Backend
    options: Mapping[str, Any]
    output: Sequence[TextIO]
    tolerances: Tolerances
    polish: bool
    otherwise: Backend | None = None
