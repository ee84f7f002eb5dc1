"""Two shorthands for stating the problems: pairs of nonnegative expressions, and an optimising follower."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyomo.environ as pyo
from pyomo.core.expr.calculus.derivatives import Modes, differentiate

from pyrobocop_pyomo.complementarity import Complementarity, complements


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
