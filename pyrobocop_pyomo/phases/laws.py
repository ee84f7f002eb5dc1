"""`Law`: several declarations, equations and pairs under one name, assigned to a phase like a declaration."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from .declarations import call_site


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """What a phase takes as a whole: ``phase.wall = law`` calls ``law.state(phase, "wall")``.

    On any error in it, everything that it has added is taken off the phase again.

    Attributes
    ----------
    declared_at : str
        File and line where the law was made, quoted in messages.
    """

    declared_at: str = field(default_factory=call_site, repr=False, compare=False)

    @abstractmethod
    def state(self, phase: Any, name: str) -> None:
        """Declare and state everything, all of it named after the name.

        Parameters
        ----------
        phase : PhaseBlock
        name : str
        """
