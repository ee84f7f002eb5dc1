"""Markets and traffic: somebody leads, the others settle in an equilibrium."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyomo.environ as pyo

from .entries import MpccProblem, state_follower, state_pairs

EQUILIBRIUM = frozenset({"equilibrium"})
MURPHY = "data of Murphy, Sherali & Soyster, Math. Programming 24 (1982)"
FIRMS = {1: (10.0, 1.2), 2: (8.0, 1.1), 3: (6.0, 1.0), 4: (4.0, 0.9), 5: (2.0, 0.8)}


def _oligopoly(gamma: float, capacity: float) -> Any:
    """Firm 1 leads a Cournot market with the price ``(5000 / Q)^(1 / gamma)``."""
    m = pyo.ConcreteModel()
    m.q = pyo.Var(FIRMS, bounds=(0, capacity), initialize=capacity / 2)
    total = sum(m.q.values())
    price = (5000 / total) ** (1 / gamma)
    slope = -price / (gamma * total)

    def production(firm: int) -> Any:
        unit, exponent = FIRMS[firm]
        power = (1 + exponent) / exponent
        return unit * m.q[firm] + (5.0 ** (-1 / exponent) / power) * m.q[firm] ** power

    m.loss = pyo.Objective(expr=production(1) - m.q[1] * price)
    m.full = pyo.Var([2, 3, 4, 5], bounds=(0, None), initialize=0)
    pairs = []
    for firm in m.full:
        unit, exponent = FIRMS[firm]
        marginal = unit + (m.q[firm] / 5.0) ** (1 / exponent)
        pairs.append((m.q[firm], marginal - price - m.q[firm] * slope + m.full[firm]))
        pairs.append((m.full[firm], capacity - m.q[firm]))
    state_pairs(m, pairs)
    return m


def _toll() -> Any:
    """One toll road beside a free road and walking; the owner of the toll road wants revenue."""
    m = pyo.ConcreteModel()
    m.toll = pyo.Var(bounds=(0, 10), initialize=1)
    m.flow = pyo.Var(["toll", "free", "walk"], bounds=(0, 1), initialize=1 / 3)
    m.price = pyo.Var(initialize=3)
    costs = {"toll": 2 + m.toll, "free": 5 + 2 * m.flow["free"], "walk": 9.0}
    m.revenue = pyo.Objective(expr=m.toll * m.flow["toll"], sense=pyo.maximize)
    m.demand = pyo.Constraint(expr=sum(m.flow.values()) == 1)
    state_pairs(m, [(m.flow[way], cost - m.price) for way, cost in costs.items()])
    return m


def _braess() -> Any:
    """Three routes of which one uses the shortcut; closing it (capacity zero) is best for everybody."""
    m = pyo.ConcreteModel()
    m.shortcut = pyo.Var(bounds=(0, 10), initialize=5)
    m.route = pyo.Var(["upper", "lower", "through"], bounds=(0, 6), initialize=2)
    m.time = pyo.Var(initialize=80)
    m.queue = pyo.Var(bounds=(0, None), initialize=0)
    upper, lower, through = m.route.values()
    first, last = upper + through, lower + through
    m.total = pyo.Objective(expr=6 * m.time)
    m.demand = pyo.Constraint(expr=upper + lower + through == 6)
    state_pairs(
        m,
        [
            (upper, 10 * first + 50 + upper - m.time),
            (lower, 10 * last + 50 + lower - m.time),
            (through, 10 * first + 10 * last + 10 + through + m.queue - m.time),
            (m.queue, m.shortcut - through),
        ],
    )
    return m


def _network_design() -> Any:
    """Widening two of three parallel roads: cost of building against travel times that are linear in the flow."""
    m = pyo.ConcreteModel()
    roads = [1, 2, 3]
    m.width = pyo.Var(roads, bounds=(0, 2), initialize=0.5)
    m.flow = pyo.Var(roads, bounds=(0, 10), initialize=10 / 3)
    m.time = pyo.Var(initialize=10)
    free, slope, price = {1: 2.0, 2: 6.0, 3: 12.0}, {1: 3.0, 2: 2.0, 3: 1.0}, {1: 12.0, 2: 7.0, 3: 5.0}
    m.cost = pyo.Objective(
        expr=sum(m.flow[r] * (free[r] + slope[r] * m.flow[r] / (1 + m.width[r])) + price[r] * m.width[r] for r in roads)
    )
    m.demand = pyo.Constraint(expr=sum(m.flow.values()) == 10)
    state_pairs(m, [(m.flow[r], free[r] + slope[r] * m.flow[r] / (1 + m.width[r]) - m.time) for r in roads])
    return m


def _two_node_electricity() -> Any:
    """A generator bids its price; the operator dispatches two plants over a line of limited capacity."""
    m = pyo.ConcreteModel()
    m.bid = pyo.Var(bounds=(10, 60), initialize=20)
    m.own, m.rival = pyo.Var(bounds=(0, 80), initialize=40), pyo.Var(bounds=(0, 100), initialize=40)
    m.line = pyo.Var(initialize=0)
    m.price = pyo.Var(["here", "there"], initialize=20)
    m.profit = pyo.Objective(expr=(m.price["here"] - 10) * m.own, sense=pyo.maximize)
    m.here = pyo.Constraint(expr=m.own - m.line == 30)
    m.there = pyo.Constraint(expr=m.rival + m.line == 60)
    m.rent = pyo.Var(["plant", "rival", "out", "back"], bounds=(0, None), initialize=0)
    m.flow = pyo.Constraint(expr=m.price["there"] - m.price["here"] == m.rent["out"] - m.rent["back"])
    state_pairs(
        m,
        [
            (m.own, m.bid - m.price["here"] + m.rent["plant"]),
            (m.rival, 25 + 0.2 * m.rival - m.price["there"] + m.rent["rival"]),
            (m.rent["plant"], 80 - m.own),
            (m.rent["rival"], 100 - m.rival),
            (m.rent["out"], 25 - m.line),
            (m.rent["back"], 25 + m.line),
        ],
    )
    return m


def _spatial_price() -> Any:
    """A subsidy of one supplier, limited by a budget, against the price in the dearer of two markets."""
    m = pyo.ConcreteModel()
    m.subsidy = pyo.Var(bounds=(0, 3), initialize=0)
    ways = {(i, j): 1.0 + abs(i - j) for i in (1, 2) for j in (1, 2)}
    m.ship = pyo.Var(list(ways), bounds=(0, None), initialize=1)
    supply = {i: m.ship[i, 1] + m.ship[i, 2] for i in (1, 2)}
    demand = {j: m.ship[1, j] + m.ship[2, j] for j in (1, 2)}
    price = {1: 20 - demand[1], 2: 26 - 2 * demand[2]}
    m.cost = pyo.Objective(expr=price[2] + 0.5 * m.subsidy**2)
    state_pairs(
        m,
        [
            (m.ship[i, j], 2 + supply[i] - (m.subsidy if i == 1 else 0) + distance - price[j])
            for (i, j), distance in ways.items()
        ],
    )
    return m


def _nash1() -> Any:
    m = pyo.ConcreteModel()
    m.x = pyo.Var([1, 2], bounds=(0, 10), initialize=0)
    m.y = pyo.Var([1, 2], bounds=(0, None), initialize=0)
    x, y = m.x, m.y
    m.cost = pyo.Objective(expr=0.5 * sum((x[i] - y[i]) ** 2 for i in x))
    state_follower(m, y[1] ** 2 + 8 / 3 * y[1] * y[2] - 34 * y[1], [y[1]], [15 - x[2] - y[1]], "first")
    state_follower(m, y[2] ** 2 + 5 / 4 * y[1] * y[2] - 24.25 * y[2], [y[2]], [15 - x[1] - y[2]], "second")
    return m


def _ration() -> Any:
    """A leader sells at a price to three customers with linear demand, each of whom may stay away."""
    m = pyo.ConcreteModel()
    m.price = pyo.Var(bounds=(0, 20), initialize=5)
    m.sold = pyo.Var([1, 2, 3], bounds=(0, None), initialize=1)
    m.revenue = pyo.Objective(expr=m.price * sum(m.sold.values()), sense=pyo.maximize)
    limits = {1: 4.0, 2: 10.0, 3: 19.0}
    state_pairs(m, [(m.sold[i], m.price + m.sold[i] - limits[i]) for i in limits])
    return m


PROBLEMS = (
    *(
        MpccProblem(f"oligopoly {gamma}, {capacity:g}", partial(_oligopoly, gamma, capacity), best, tags=EQUILIBRIUM,
                    source=MURPHY, notes="Firm 1 leads; fractional powers, bounds of the followers in the pairs.")
        for gamma, capacity, best in (
            (1.0, 150.0, -343.345262),
            (1.0, 20.0, -765.365809),
            (1.1, 60.0, -203.155074),
            (1.3, 30.0, -80.7859718),
        )
    ),
    MpccProblem("toll road", _toll, 3.0, tags=EQUILIBRIUM | {"maximise"}, source="written for this catalogue"),
    MpccProblem("braess", _braess, 498.0, tags=EQUILIBRIUM | {"convex", "linear"},
                source="Braess, Unternehmensforschung 12 (1968), doi:10.1007/BF01918335"),
    MpccProblem("network design", _network_design, 119.789327, tags=EQUILIBRIUM,
                source="own; kind: Marcotte, Math. Programming 34 (1986)"),
    MpccProblem("electricity, two nodes", _two_node_electricity, 1210.0, tags=EQUILIBRIUM | {"maximise"},
                source="written for this catalogue; kind: Hobbs, Metzler & Pang, IEEE Trans. Power Systems 15 (2000), "
                "doi:10.1109/59.867153"),
    MpccProblem("spatial prices", _spatial_price, 32 / 3, tags=EQUILIBRIUM | {"convex"},
                source="written for this catalogue"),
    MpccProblem("nash1", _nash1, 0.0, tags=EQUILIBRIUM, source="MacMPEC (S. Leyffer), problem nash1; Harker, "
                "European J. Oper. Res. 54 (1991)"),
    MpccProblem("three customers", _ration, 105.125, tags=EQUILIBRIUM | {"maximise"},
                source="written for this catalogue"),
)  # fmt: skip
