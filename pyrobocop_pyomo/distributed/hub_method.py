"""The hub method: the object is an agent with its dynamics and all wrenches; each robot holds a copy of its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import Array

from .coordination import Coordination, TeamState
from .messages import Order, ProblemFacts
from .method import FIRST_ITERATIONS, Method
from .rounds import Round


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
    (`AndersonAcceleration`).

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

    def begin(self, work: Coordination) -> TeamState:
        """Ask the hub for a first motion of the object, and start there."""
        hub, state = work.hub, work.first_state(self.barrier.start)
        single = np.array([self.object_first if shared.of_one_robot else 0.0 for shared in work.shared])
        work.begin_round()
        zero = np.zeros(work.facts[hub].values.size)
        weights = self._weights_in_time(work.facts[hub])
        order = self.order(work, hub, state, zero, single, first=True, tolerance=1e-6, weights=weights)
        found = work.ask_until_all({hub: order})
        work.refuse_missing(found, [hub])
        state.target = found[hub].values
        return state

    def _weights_in_time(self, facts: ProblemFacts) -> Array:
        """Factors that fall along the index of each quantity to 1 at its end."""
        falling = [1.0 + self.early * np.linspace(1.0, 0.0, len(q.keys)) ** 2 for q in facts.quantities]
        return np.concatenate(falling)

    def round(self, work: Coordination, state: TeamState) -> Round:
        """All robots, then the hub, then the multipliers."""
        work.begin_round()
        scored = self.is_scored(work, state)
        ask = work.ask if state.values else work.ask_until_all
        reports = ask(self._robots_orders(work, state, with_plan=scored))
        work.take(state, reports)
        work.refuse_missing(state.values, work.robots)
        # A round without all robots is no value of the map that the acceleration learns.
        accelerated = state.mu is None and len(reports) == len(work.robots)
        before, at = state.target, _point(work, state) if accelerated else None
        state.target = self._hub_values(work, state, with_plan=scored)
        hub = work.hub
        of_team = work.consensus.of_team
        residuals, gaps = work.residuals(state, of_team(hub, state.target), of_team(hub, before))
        for name in work.robots:
            if name in reports:  # the multipliers of a robot without a new plan stay
                pull = work.facts[name].weighted(state.factors, gaps[name])
                state.multipliers[name] = state.multipliers[name] + pull
        penalties = self.penalties
        if at is not None:
            _go_to(work, state, state.acceleration.next(at, _point(work, state)))
            penalties = None  # the acceleration learns the map of these
        else:
            state.acceleration.steps.clear()
        return work.end_round(state, residuals, self.barrier, penalties, scored=scored)

    def _robots_orders(self, work: Coordination, state: TeamState, *, with_plan: bool) -> dict[str, Order]:
        others = work.others(state.positions)
        hub = work.hub
        proposal = work.consensus.of_team(hub, state.target)
        first = not state.values
        orders = {}
        for name in work.robots:
            fact = work.facts[name]
            linear = state.multipliers[name] - fact.weighted(state.factors, work.consensus.of_agent(name, proposal))
            start = work.consensus.seen_by(name, hub, {hub: state.target, name: fact.values}) if first else None
            orders[name] = self.order(
                work,
                name,
                state,
                linear,
                state.factors,
                first=first,
                values=start,
                others=others.get(name),
                with_plan=with_plan,
            )
        return orders

    def _hub_values(self, work: Coordination, state: TeamState, *, with_plan: bool) -> Array:
        hub = work.hub
        linear_of_team, count = np.zeros((2, len(work.consensus.keys)))
        for name in work.robots:
            pull = work.facts[name].weighted(state.factors, state.values[name])
            linear_of_team += work.consensus.of_team(name, -state.multipliers[name] - pull)
            count += work.consensus.presence(name)
        holders = np.array(
            [count[work.consensus.groups == group].max(initial=0.0) for group in range(len(work.shared))]
        )
        linear = work.consensus.of_agent(hub, linear_of_team)
        order = self.order(
            work, hub, state, linear, state.factors * holders, iterations=FIRST_ITERATIONS, with_plan=with_plan
        )
        reports = work.ask({hub: order})
        return reports[hub].values if hub in reports else state.target


def _point(work: Coordination, state: TeamState) -> Array:
    """What a round maps to itself where the team agrees: the target and the multipliers, in comparable units."""
    scales = _scales(work)
    parts = [state.target, *(state.multipliers[name] for name in work.robots)]
    return np.concatenate([scale * part for scale, part in zip(scales, parts, strict=True)])


def _go_to(work: Coordination, state: TeamState, point: Array) -> None:
    scales = _scales(work)
    ends = np.cumsum([scale.size for scale in scales])[:-1]
    state.target, *others = (part / scale for scale, part in zip(scales, np.split(point, ends), strict=True))
    state.multipliers.update(zip(work.robots, others, strict=True))


def _scales(work: Coordination) -> list[Array]:
    """Square roots of the penalties as given, for the target; their inverses, for the robots' multipliers."""
    of_hub = np.sqrt(work.facts[work.hub].penalties)
    return [of_hub, *(1.0 / np.sqrt(work.facts[name].penalties) for name in work.robots)]
