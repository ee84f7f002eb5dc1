"""The hub method: the object is an agent with its dynamics and all wrenches; each robot holds a copy of its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .coordination import Coordination, Residuals, TeamState, extrapolated
from .messages import Order, ProblemFacts, Report
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
        single = np.array([self.object_first if shared.of_one_robot else 0.0 for shared in work.team.shared])
        work.begin_round()
        zero = np.zeros(work.facts[hub].values.size)
        weights = self._weights_in_time(work.facts[hub])
        order = self.order(work, hub, state, zero, single, first=True, tolerance=1e-6, weights=weights)
        state.target = work.consensus.of_team(hub, work.ask({hub: order}, until_all=True)[hub].values)
        return state

    def _weights_in_time(self, facts: ProblemFacts) -> Array:
        """Factors that fall along the index of each quantity to 1 at its end."""
        falling = [1.0 + self.early * np.linspace(1.0, 0.0, len(q.keys)) ** 2 for q in facts.quantities]
        return np.concatenate(falling)

    def order_of_robot(self, work: Coordination, name: str, state: TeamState, *, first: bool) -> Order:
        """Its objective with the pull of the hub's proposal."""
        proposal = work.consensus.of_agent(name, state.target)
        linear = state.multipliers[name] - work.facts[name].weighted(state.factors, proposal)
        start = proposal if first else None
        return self.order(work, name, state, linear, state.factors, first=first, values=start)

    def agree(self, work: Coordination, state: TeamState, reports: Mapping[str, Report]) -> Residuals:
        """The hub, then the multipliers."""
        at, before = _point(work, state), state.target
        state.target = self._hub_values(work, state)
        residuals, gaps = work.residuals(state, before)
        for name in reports:  # the multipliers of a robot without a new plan stay
            pull = work.facts[name].weighted(state.factors, gaps[name])
            state.multipliers[name] = state.multipliers[name] + pull
        if state.mu is None and len(reports) == len(work.robots):
            _go_to(work, state, extrapolated(state.steps, at, _point(work, state)))
        else:  # a round without all robots is no value of the map that the acceleration learns
            state.steps.clear()
        return residuals

    def _hub_values(self, work: Coordination, state: TeamState) -> Array:
        hub = work.hub
        linear_of_team, count = np.zeros((2, len(work.consensus.keys)))
        for name in work.robots:
            pull = work.facts[name].weighted(state.factors, state.values[name])
            linear_of_team += work.consensus.of_team(name, -state.multipliers[name] - pull)
            count += work.consensus.presence(name)
        holders = np.zeros(len(state.factors))
        np.maximum.at(holders, work.consensus.groups, count)
        linear = work.consensus.of_agent(hub, linear_of_team)
        order = self.order(work, hub, state, linear, state.factors * holders, iterations=FIRST_ITERATIONS)
        reports = work.ask({hub: order})
        return work.consensus.of_team(hub, reports[hub].values) if hub in reports else state.target


def _point(work: Coordination, state: TeamState) -> Array:
    """What a round maps to itself where the team agrees: the target and the multipliers, in comparable units."""
    return np.concatenate([state.target, *(state.multipliers[name] for name in work.robots)]) * _scales(work)


def _go_to(work: Coordination, state: TeamState, point: Array) -> None:
    ends = np.cumsum([state.target.size, *(state.multipliers[name].size for name in work.robots)])[:-1]
    state.target, *others = np.split(point / _scales(work), ends)
    state.multipliers.update(zip(work.robots, others, strict=True))


def _scales(work: Coordination) -> Array:
    """Square roots of the penalties as given, for the target; their inverses, for the robots' multipliers."""
    of_team = np.sqrt(work.consensus.of_team(work.hub, work.facts[work.hub].penalties))
    return np.concatenate([of_team, *(1.0 / np.sqrt(work.facts[name].penalties) for name in work.robots)])
