"""What a problem of the catalogue is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True, eq=False)
class MpccProblem:
    """A mathematical program with complementarity constraints whose answer is known.

    Attributes
    ----------
    name : str
        Unique in the catalogue; for a published problem the name it has there.
    build : callable
        Returns a new ConcreteModel with its start values set.
    best : float or None
        The best objective value known, in the sense of the model's objective; None for an infeasible problem.
        A point counts as optimal when it is feasible and as good as this, or better.
    feasible : bool
        False when no point satisfies the constraints and the pairs.
    notes : str
        What makes the problem worth solving, and what is known of its stationary points.
    source : str
        Where the problem is from.
    tags : frozenset of str
        For choosing among problems. "convex" promises that every branch (one side of each pair set to zero) is a
        convex program, "linear" that it is a linear one.
    answer : mapping of str to float
        Values of variables at a best point, by name; may be empty or leave variables out.
    """

    name: str
    build: Callable[[], Any]
    best: float | None
    feasible: bool = True
    notes: str = ""
    source: str = ""
    tags: frozenset[str] = frozenset()
    answer: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        """Refuse an entry that contradicts itself."""
        if self.feasible == (self.best is None):
            raise ValueError(
                f"'{self.name}': feasible is {self.feasible} and best is {self.best}; a feasible problem has a best "
                "value and an infeasible one has None."
            )

    def __str__(self) -> str:
        best = "infeasible" if self.best is None else f"best {self.best:.8g}"
        return f"{self.name} ({best}): {', '.join(sorted(self.tags))}"
