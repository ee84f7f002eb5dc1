"""The hub method: the object is an agent with its dynamics and all wrenches; each robot holds a copy of its motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .coordination import Coordination, TeamState
from .method import FIRST_ITERATIONS, Method


@dataclass(frozen=True)
class Hub(Method):
    r"""Rounds between the hub and the robots.

    In each round every robot i minimises its own objective plus
    :math:`\lambda_i^T s_i + \tfrac12 \|s_i - z_i\|_R^2` over its plan, with s_i its shared values and z_i what the hub
    proposes. The hub then minimises its own objective plus :math:`\sum_i -\lambda_i^T z_i + \tfrac12 \|s_i -
    z_i\|_R^2`, and :math:`\lambda_i \leftarrow \lambda_i + R (s_i - z_i)`. The rounds follow the barrier path: pairs
    are relaxed with delta = 2 mu, and each round solves the barrier problem of its mu, warm in primal and dual. A
    robot's problem does not grow with the team.

    Beside the fields of `Method`; without pairs penalties stay as they are given, and the rounds are accelerated
    (`extrapolated`).

    Attributes
    ----------
    object_first : float
        Factor on the penalties of what a single robot shares with the hub in the hub's first problem, before any round:
        the wrenches that alone would move the object to its goal are kept small.
    early : float
        How much more than a late one an early value costs in that first problem: robots have to arrive before they
        push, while the object alone may move at any time.

    Notes
    -----
    A heuristic for problems with contact: no theorem covers consensus among local solutions of relaxed problems. What
    holds is what the physical score recomputes.

    References
    ----------
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, doi:10.48550/arXiv.2410.23283; Boyd et al., Distributed optimization and
    statistical learning via the alternating direction method of multipliers, sec. 7.2, doi:10.1561/2200000016
    """

    object_first: float = 0.28
    early: float = 4.0

    has_hub: ClassVar[bool] = True

    def begin(self, work: Coordination) -> TeamState:
        """Ask the hub for a first motion of the object, and start there."""
        hub, state = work.hub, work.first_state(self.barrier.start)
        work.begin_round()
        single = np.array([self.object_first if shared.of_one_robot else 0.0 for shared in work.team.shared])
        # Factors that fall along the index of each quantity to 1 at its end.
        lengths = [len(quantity.keys) for quantity in work.facts[hub].quantities]
        falling = np.concatenate([1.0 + self.early * np.linspace(1.0, 0.0, length) ** 2 for length in lengths])
        diagonal = work.consensus.weights(single) * work.consensus.of_team(hub, falling)
        order = self.order(work, hub, state, np.zeros_like(diagonal), diagonal, first=True, tolerance=1e-6)
        state.target = work.consensus.of_team(hub, work.ask({hub: order}, until_all=True)[hub].values)
        return state

    def pull(self, work: Coordination, state: TeamState) -> tuple[Array, Array]:
        """Towards the hub's proposal."""
        weights = work.consensus.weights(state.factors)
        return state.multipliers - weights * state.target, weights

    def next_target(self, work: Coordination, state: TeamState) -> Array:
        """The hub's answer to the robots' values."""
        hub, weights = work.hub, work.consensus.weights(state.factors)
        linear = (-state.multipliers - weights * state.values).sum(axis=0)
        diagonal = weights * work.held.sum(axis=0)
        reports = work.ask({hub: self.order(work, hub, state, linear, diagonal, iterations=FIRST_ITERATIONS)})
        return work.consensus.of_team(hub, reports[hub].values) if hub in reports else state.target
