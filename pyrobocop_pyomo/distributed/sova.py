"""SOVA, the method of the DisCo paper: every robot holds all shared quantities, and talks to its neighbours only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pyrobocop_pyomo.numerics import Array

from .coordination import Coordination, TeamState
from .local_problem import DELTA
from .messages import Order
from .method import Method
from .rounds import BarrierPath


@dataclass(frozen=True)
class Sova(Method):
    r"""Rounds among robots that each plan with a copy of everything that is shared.

    In each round robot i minimises its own objective plus
    :math:`p_i^T v_i + \sum_{j \in N_i} \| v_i - \tfrac12 (v_i^k + v_j^k) \|_W^2`, sends its values to its neighbours,
    and :math:`p_i \leftarrow p_i + W \sum_{j \in N_i} (v_i - v_j)`. The multipliers of all robots sum to zero in every
    round. A robot's problem holds the object's dynamics and the wrenches of all robots, so it grows with the team.

    Beside the fields of `Method`:

    Attributes
    ----------
    regularisation : float
        Factor on the penalties in the first round, which has no consensus terms: the copies of the others' wrenches
        would be free otherwise.
    follow_barrier : bool
        Whether a round solves the barrier problem of its mu, warm in primal and dual. Otherwise each round solves the
        problem with delta = 2 mu, from the primal point of the round before, as the paper does.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo, 2024, eq. 18-20 and algorithm 2, doi:10.48550/arXiv.2410.23283
    """

    regularisation: float = 0.1
    iterations: int = 300
    follow_barrier: bool = True

    @classmethod
    def paper(cls) -> Sova:
        """The preset of the paper: 12 rounds, constant penalties and delta = 1e-3, whatever the outcome."""
        return cls(
            BarrierPath(5e-4, turn=5e-4, floor=5e-4),
            None,
            rounds=12,
            until="rounds",
            iterations=5000,
            closing=None,
            follow_barrier=False,
        )

    def begin(self, work: Coordination) -> TeamState:
        """A first plan of each robot alone, as if the others did whatever helps it."""
        state = work.first_state(self.barrier.start)
        work.begin_round()
        weights = work.consensus.weights(state.factors * self.regularisation)
        orders = {name: self.order(work, name, state, state.target, weights, first=True) for name in work.robots}
        work.take(state, work.ask(orders, until_all=True))
        state.target = state.values.mean(axis=0)
        return state

    def pull(self, work: Coordination, state: TeamState) -> tuple[Array, Array]:
        """Towards what is between each robot's values and those of all others, which the mean of all tells."""
        weights, count = work.consensus.weights(state.factors), len(work.robots)
        between = count * state.target + (count - 2) * state.values
        return state.multipliers - weights * between, 2.0 * (count - 1) * weights

    def next_target(self, work: Coordination, state: TeamState) -> Array:
        """The mean of all."""
        return state.values.mean(axis=0)

    def order(self, work: Coordination, name: str, state: TeamState, *arguments: Any, **further: Any) -> Order:
        """As of `Method`; the paper solves the problem with its delta, from the primal point."""
        order = super().order(work, name, state, *arguments, **further)
        if self.follow_barrier or order.mu is None:
            return order
        return replace(order, mu=None, delta=DELTA.factor * order.mu, tolerance=1e-6)
