"""`Law`: several declarations, equations and pairs under one name, assigned to a phase like a declaration."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from inspect import signature
from typing import Any

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.keywords import check_keywords

from .declarations import call_site

_OTHER_WORDS = {"mu": "coefficient", "friction": "coefficient", "velocity": "slip", "speed": "slip", "distance": "gap"}


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

    def __new__(cls, *_: Any, **given: Any) -> Any:
        """Refuse a keyword that the law has not, with the one that may be meant."""
        known = [name for name in signature(cls.__init__).parameters if name not in ("self", "declared_at")]
        check_keywords(cls.__name__, given.keys() - {"declared_at"}, known, ModelError, _OTHER_WORDS)
        return super().__new__(cls)

    @abstractmethod
    def state(self, phase: Any, name: str) -> None:
        """Declare and state everything, all of it named after the name.

        Parameters
        ----------
        phase : PhaseBlock
        name : str
        """
