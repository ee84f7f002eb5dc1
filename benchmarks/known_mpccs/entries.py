"""A problem of the catalogue, and two shorthands: pairs of nonnegative expressions, and an optimising follower."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import pyomo.environ as pyo
from pyomo.core.expr.calculus.derivatives import Modes, differentiate

from pyrobocop_pyomo.complementarity import Complementarity, complements


@dataclass(frozen=True, eq=False)
class MpccProblem:
    """A mathematical program with complementarity constraints whose solution is known.

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
    solution : mapping of str to float
        Values of variables at a best point, by name; may be empty or leave variables out.
    """

    name: str
    build: Callable[[], Any]
    best: float | None
    feasible: bool = True
    notes: str = ""
    source: str = ""
    tags: frozenset[str] = frozenset()
    solution: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

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


def state_pairs(block: Any, pairs: Sequence[tuple[Any, Any]]) -> None:
    """Add the pairs ``0 <= a ⟂ b >= 0`` as the component ``block.pairs``.

    Parameters
    ----------
    block : Block
        Gets the component.
    pairs : sequence of (a, b)
        Variables or expressions.
    """
    block.pairs = Complementarity(
        range(1, len(pairs) + 1), rule=lambda _, i: complements(pairs[i - 1][0] >= 0, pairs[i - 1][1] >= 0)
    )


def state_follower(
    model: Any, cost: Any, decides: Sequence[Any], where: Sequence[Any], name: str = "follower", multiplier: float = 0.0
) -> None:
    """Add the optimality conditions of "`decides` minimises `cost` where all of `where` are nonnegative".

    They hold at every optimum of a follower whose problem is convex and has a Slater point or linear constraints.

    Parameters
    ----------
    model : Block
        Gets a block with the variables ``multiplier``, the rows ``stationary`` and the ``pairs``.
    cost : expression
        What the follower minimises.
    decides : sequence of variables
        What the follower decides.
    where : sequence of variables or expressions
        Nonnegative at what the follower may choose.
    name : str
        Of the block.
    multiplier : float
        Where the multipliers start.
    """
    block = pyo.Block()
    model.add_component(name, block)
    rows = range(1, len(where) + 1)
    block.multiplier = pyo.Var(rows, bounds=(0, None), initialize=multiplier)
    lagrangian = cost - sum(block.multiplier[i] * where[i - 1] for i in rows)
    gradient = differentiate(lagrangian, wrt_list=list(decides), mode=Modes.reverse_symbolic)
    block.stationary = pyo.Constraint(range(1, len(decides) + 1), rule=lambda _, j: gradient[j - 1] == 0)
    state_pairs(block, [(block.multiplier[i], where[i - 1]) for i in rows])
