"""Six models in plain `pyomo.dae`, with known answers. Nothing here knows this package but for one kind of pairs.

Each case builds a fresh model; ``errors(model)`` compares a solved model with the answer: the largest error of the
states at element boundaries, and the error of the integral or estimate that the model is about.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, cosh, exp, pi, sin, tanh
from typing import Any

import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from pyomo.mpec import Complementarity, complements


@dataclass(frozen=True)
class Case:
    """A model and what is known about its solution.

    Attributes
    ----------
    build : callable
        Makes the model.
    sets : tuple of str
        Names of its continuous sets.
    states : callable
        ``states(model)`` yields (variable, continuous set, function of time).
    quantity : callable
        ``quantity(model)`` is the integral or estimate that the model is about.
    exact : float
        Its value.
    """

    build: Callable[[], Any]
    sets: tuple[str, ...]
    states: Callable[[Any], Iterator[tuple[Any, Any, Callable[[float], float]]]]
    quantity: Callable[[Any], float]
    exact: float

    def errors(self, model: Any) -> tuple[float, float]:
        """Errors of the states and of the quantity."""
        worst = max(
            abs(variable[t].value - truth(t))
            for variable, along, truth in self.states(model)
            for t in along.get_finite_elements()
        )
        return worst, abs(self.quantity(model) - self.exact)


# -------------------------------------------------------------------- index one: a reactor with an equilibrium

HEATING = 3.0


def reactor() -> Any:
    """A and B in fast equilibrium, b = a / 2; A reacts on at a rate that is heated: total' = -(1 + sin t) a."""
    m = pyo.ConcreteModel(name="reactor")
    m.t = ContinuousSet(bounds=(0, HEATING))
    m.total = pyo.Var(m.t, bounds=(0, None), initialize=1)
    m.a = pyo.Var(m.t, bounds=(0, None), initialize=0.5)
    m.b = pyo.Var(m.t, bounds=(0, None), initialize=0.5)
    m.dtotal = DerivativeVar(m.total, wrt=m.t)
    m.rate = pyo.Expression(m.t, rule=_heated_rate)
    m.reaction = pyo.Constraint(m.t, rule=_reaction)
    m.equilibrium = pyo.Constraint(m.t, rule=_equilibrium)
    m.balance = pyo.Constraint(m.t, rule=_balance)
    m.total[0].fix(1)
    m.product = Integral(m.t, wrt=m.t, rule=_heated_rate)
    m.cost = pyo.Objective(expr=m.product)
    return m


def _heated_rate(m: Any, t: float) -> Any:
    return (1 + sin(t)) * m.a[t]


def _reaction(m: Any, t: float) -> Any:
    return m.dtotal[t] == -m.rate[t]


def _equilibrium(m: Any, t: float) -> Any:
    return m.b[t] == m.a[t] / 2


def _balance(m: Any, t: float) -> Any:
    return m.a[t] + m.b[t] == m.total[t]


def _total(t: float) -> float:
    return exp(-(t + 1 - cos(t)) * 2 / 3)


# -------------------------------------------------------------------- parameter estimation

MEASURED_AT = (0.35, 0.9, 1.7, 2.05, 3.0)
DECAY = 0.8


def _forced_decay(t: float, p: float = DECAY) -> float:
    return exp(-p * t) * (1 - p / (1 + p**2)) + (p * cos(t) + sin(t)) / (1 + p**2)


def estimation() -> Any:
    """Find p in x' = -p x + cos t from values without noise, at times that become element boundaries."""
    m = pyo.ConcreteModel(name="estimation")
    m.measured = pyo.Set(initialize=MEASURED_AT)
    m.t = ContinuousSet(bounds=(0, 3), initialize=MEASURED_AT)
    m.data = pyo.Param(m.measured, initialize={t: _forced_decay(t) for t in MEASURED_AT})
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = DerivativeVar(m.x, wrt=m.t)
    m.p = pyo.Var(bounds=(0, 5), initialize=0.3)
    m.ode = pyo.Constraint(m.t, rule=_decay)
    m.x[0].fix(1)
    m.misfit = pyo.Objective(rule=_misfit)
    return m


def _decay(m: Any, t: float) -> Any:
    return m.dx[t] == -m.p * m.x[t] + cos(t)


def _misfit(m: Any) -> Any:
    return sum((m.x[t] - m.data[t]) ** 2 for t in m.measured)


# -------------------------------------------------------------------- two continuous sets


def two_phases() -> Any:
    """The regulator, minimise the integral of x^2 + u^2 with x' = u, cut at t = 1 into two sets that are linked."""
    m = pyo.ConcreteModel(name="two_phases")
    m.first = ContinuousSet(bounds=(0, 1))
    m.second = ContinuousSet(bounds=(1, 3))
    m.x1, m.u1 = pyo.Var(m.first, initialize=1), pyo.Var(m.first, initialize=0)
    m.x2, m.u2 = pyo.Var(m.second, initialize=0), pyo.Var(m.second, initialize=0)
    m.dx1, m.dx2 = DerivativeVar(m.x1, wrt=m.first), DerivativeVar(m.x2, wrt=m.second)
    m.ode1 = pyo.Constraint(m.first, rule=lambda m, t: m.dx1[t] == m.u1[t])
    m.ode2 = pyo.Constraint(m.second, rule=lambda m, t: m.dx2[t] == m.u2[t])
    m.x1[0].fix(1)
    m.link = pyo.Constraint(expr=m.x1[1] == m.x2[1])
    m.effort1 = Integral(m.first, wrt=m.first, rule=lambda m, t: m.x1[t] ** 2 + m.u1[t] ** 2)
    m.effort2 = Integral(m.second, wrt=m.second, rule=lambda m, t: m.x2[t] ** 2 + m.u2[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort1 + m.effort2)
    return m


def _regulated(t: float) -> float:
    return cosh(3 - t) / cosh(3)


# -------------------------------------------------------------------- second derivatives


def oscillator() -> Any:
    """x'' = -4 x + cos t from rest at 1, with the integral of x^2."""
    m = pyo.ConcreteModel(name="oscillator")
    m.t = ContinuousSet(bounds=(0, 3))
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = DerivativeVar(m.x, wrt=m.t)
    m.ddx = DerivativeVar(m.x, wrt=(m.t, m.t))
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.ddx[t] == -4 * m.x[t] + cos(t))
    m.x[0].fix(1)
    m.dx[0].fix(0)
    m.energy = Integral(m.t, wrt=m.t, rule=lambda m, t: m.x[t] ** 2)
    m.cost = pyo.Objective(expr=m.energy)
    return m


def _swing(t: float) -> float:
    return (2 * cos(2 * t) + cos(t)) / 3


def _swing_rate(t: float) -> float:
    return -(4 * sin(2 * t) + sin(t)) / 3


def _swing_energy(t: float) -> float:
    return (2.5 * t + sin(4 * t) / 2 + 2 * sin(3 * t) / 3 + 2 * sin(t) + sin(2 * t) / 4) / 9


# -------------------------------------------------------------------- a block at each time


def tank_blocks() -> Any:
    """The rate of x' = -rate comes from a block at each time, where rate = (1 + sin t) x is an equation."""
    m = pyo.ConcreteModel(name="blocks")
    m.t = ContinuousSet(bounds=(0, 3))
    m.x = pyo.Var(m.t, initialize=1)
    m.dx = DerivativeVar(m.x, wrt=m.t)
    m.kinetics = pyo.Block(m.t, rule=_kinetics)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == -m.kinetics[t].rate)
    m.x[0].fix(1)
    m.reacted = Integral(m.t, wrt=m.t, rule=lambda m, t: m.kinetics[t].rate)
    m.cost = pyo.Objective(expr=m.reacted)
    return m


def _kinetics(b: Any, t: float) -> None:
    m = b.model()
    b.rate = pyo.Var(initialize=1)
    b.law = pyo.Constraint(expr=b.rate == (1 + sin(t)) * m.x[t])


def _reacted(t: float) -> float:
    return exp(-(t + 1 - cos(t)))


# -------------------------------------------------------------------- complementarity

QUARTERS = (pi / 2, 3 * pi / 2)


def rectifier(pair: Any = Complementarity, say: Any = complements) -> Any:
    """A rectified cosine: p - n = cos t with 0 <= p ⟂ n >= 0, and y' = p + n = |cos t|, to be maximised.

    Without the pairs p and n would grow together without limit. The kinks are points of the set.
    """
    m = pyo.ConcreteModel(name="rectifier")
    m.t = ContinuousSet(bounds=(0, 2 * pi), initialize=QUARTERS)
    m.y = pyo.Var(m.t, initialize=0)
    m.p = pyo.Var(m.t, bounds=(0, None), initialize=0.5)
    m.n = pyo.Var(m.t, bounds=(0, None), initialize=0.5)
    m.dy = DerivativeVar(m.y, wrt=m.t)
    m.ode = pyo.Constraint(m.t, rule=lambda m, t: m.dy[t] == m.p[t] + m.n[t])
    m.split = pyo.Constraint(m.t, rule=lambda m, t: m.p[t] - m.n[t] == cos(t))
    m.pairs = pair(m.t, rule=lambda m, t: say(m.p[t] >= 0, m.n[t] >= 0))
    m.y[0].fix(0)
    m.swept = Integral(m.t, wrt=m.t, rule=lambda m, t: m.p[t] + m.n[t])
    m.cost = pyo.Objective(expr=m.swept, sense=pyo.maximize)
    return m


def _swept(t: float) -> float:
    return sin(t) if t <= pi / 2 else 2 - sin(t) if t <= 3 * pi / 2 else 4 + sin(t)


CASES = {
    "reactor, index 1": Case(
        reactor, ("t",), lambda m: iter([(m.total, m.t, _total)]), lambda m: pyo.value(m.product), 1 - _total(HEATING)
    ),
    "estimation": Case(estimation, ("t",), lambda m: iter([(m.x, m.t, _forced_decay)]), lambda m: m.p.value, DECAY),
    "two sets": Case(
        two_phases,
        ("first", "second"),
        lambda m: iter([(m.x1, m.first, _regulated), (m.x2, m.second, _regulated)]),
        lambda m: pyo.value(m.cost),
        tanh(3),
    ),
    "second derivative": Case(
        oscillator,
        ("t",),
        lambda m: iter([(m.x, m.t, _swing), (m.dx, m.t, _swing_rate)]),
        lambda m: pyo.value(m.energy),
        _swing_energy(3),
    ),
    "block per time": Case(
        tank_blocks, ("t",), lambda m: iter([(m.x, m.t, _reacted)]), lambda m: pyo.value(m.reacted), 1 - _reacted(3)
    ),
    "complementarity": Case(rectifier, ("t",), lambda m: iter([(m.y, m.t, _swept)]), lambda m: pyo.value(m.swept), 4.0),
}
