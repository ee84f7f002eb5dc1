"""Models like those that come with the documentation of pyomo.dae, small, written from their mathematics.

Each is a function that gives a model as a user of ``dae.collocation`` writes it: ``Constraint.Skip`` at initial and
boundary points, Mayer costs, conditions as constraint lists, sets that already have points, abstract models.
"""

from math import pi, sin

import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar
from pyomo.gdp import Disjunction

SKIP = pyo.Constraint.Skip


def optimal_control():
    """Least effort and deviation of an integrator; the cost is a state."""
    m = pyo.ConcreteModel(name="optimal control")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x1, m.x2 = pyo.Var(m.t, bounds=(0, 1)), pyo.Var(m.t, bounds=(0, 1))
    m.u = pyo.Var(m.t, initialize=0)
    m.x1dot, m.x2dot = DerivativeVar(m.x1), DerivativeVar(m.x2)
    m.first = pyo.Constraint(m.t, rule=lambda m, t: SKIP if t == 0 else m.x1dot[t] == m.u[t])
    m.second = pyo.Constraint(m.t, rule=lambda m, t: SKIP if t == 0 else m.x2dot[t] == m.x1[t] ** 2 + m.u[t] ** 2)

    def start(m):
        yield m.x1[0] == 1
        yield m.x2[0] == 0
        yield pyo.ConstraintList.End

    m.start = pyo.ConstraintList(rule=start)
    m.cost = pyo.Objective(expr=m.x2[1])
    return m


def path_constraint():
    """A state has to stay below a parabola in time."""
    m = pyo.ConcreteModel(name="path constraint")
    m.tf = pyo.Param(initialize=1)
    m.t = ContinuousSet(bounds=(0, m.tf))
    m.u = pyo.Var(m.t, initialize=0)
    m.x1, m.x2, m.x3 = pyo.Var(m.t), pyo.Var(m.t), pyo.Var(m.t)
    m.dx1, m.dx2, m.dx3 = (DerivativeVar(x, wrt=m.t) for x in (m.x1, m.x2, m.x3))
    m.ode1 = pyo.Constraint(m.t, rule=lambda m, t: SKIP if t == 0 else m.dx1[t] == m.x2[t])
    m.ode2 = pyo.Constraint(m.t, rule=lambda m, t: SKIP if t == 0 else m.dx2[t] == m.u[t] - m.x2[t])
    m.ode3 = pyo.Constraint(
        m.t, rule=lambda m, t: SKIP if t == 0 else m.dx3[t] == m.x1[t] ** 2 + m.x2[t] ** 2 + 0.005 * m.u[t] ** 2
    )
    m.path = pyo.Constraint(m.t, rule=lambda m, t: m.x2[t] - 8 * (t - 0.5) ** 2 + 0.5 <= 0)
    m.start = pyo.ConstraintList(rule=lambda m: (m.x1[0] == 0, m.x2[0] == -1, m.x3[0] == 0))
    m.cost = pyo.Objective(expr=m.x3[m.tf])
    return m


def parameter_estimation():
    """Initial values of a damped oscillator from measurements, as an abstract model with data."""
    m = pyo.AbstractModel(name="parameter estimation")
    m.t = ContinuousSet()
    m.measured = pyo.Set(within=m.t)
    m.data = pyo.Param(m.measured)
    m.x1, m.x2 = pyo.Var(m.t), pyo.Var(m.t)
    m.p1, m.p2 = pyo.Var(bounds=(-1.5, 1.5)), pyo.Var(bounds=(-1.5, 1.5))
    m.x1dot, m.x2dot = DerivativeVar(m.x1, wrt=m.t), DerivativeVar(m.x2)

    def start(m):
        yield m.x1[0] == m.p1
        yield m.x2[0] == m.p2

    m.start = pyo.ConstraintList(rule=start)
    m.ode1 = pyo.Constraint(m.t, rule=lambda m, t: m.x1dot[t] == m.x2[t])
    m.ode2 = pyo.Constraint(m.t, rule=lambda m, t: m.x2dot[t] == 1 - 2 * m.x2[t] - m.x1[t])
    m.misfit = pyo.Objective(rule=lambda m: sum((m.x1[t] - m.data[t]) ** 2 for t in m.measured))
    measured = {1: 0.264, 2: 0.594, 3: 0.801, 5: 0.959}
    return m.create_instance(
        {None: {"t": {None: [0, *measured, 6]}, "measured": {None: list(measured)}, "data": measured}}
    )


def car():
    """The shortest time to a place at rest, in scaled time."""
    m = pyo.ConcreteModel(name="car")
    m.drag, m.length = pyo.Param(initialize=0.001), pyo.Param(initialize=100.0)
    m.tau = ContinuousSet(bounds=(0, 1))
    m.time, m.tf = pyo.Var(m.tau, initialize=10), pyo.Var(initialize=20, bounds=(0, None))
    m.x, m.v = pyo.Var(m.tau, bounds=(0, m.length + 50), initialize=50), pyo.Var(m.tau, bounds=(0, None), initialize=5)
    m.a = pyo.Var(m.tau, bounds=(-3.0, 1.0), initialize=0)
    m.dtime, m.dx, m.dv = DerivativeVar(m.time), DerivativeVar(m.x), DerivativeVar(m.v)
    m.ode1 = pyo.Constraint(m.tau, rule=lambda m, i: SKIP if i == 0 else m.dx[i] == m.tf * m.v[i])
    m.ode2 = pyo.Constraint(
        m.tau, rule=lambda m, i: SKIP if i == 0 else m.dv[i] == m.tf * (m.a[i] - m.drag * m.v[i] ** 2)
    )
    m.ode3 = pyo.Constraint(m.tau, rule=lambda m, i: SKIP if i == 0 else m.dtime[i] == m.tf)

    def ends(m):
        yield m.x[0] == 0
        yield m.x[1] == m.length
        yield m.v[0] == 0
        yield m.v[1] == 0
        yield m.time[0] == 0

    m.ends = pyo.ConstraintList(rule=ends)
    m.cost = pyo.Objective(expr=m.tf)
    return m


def distillation(trays=6, feed=3):
    """Counter-current trays with constant relative volatility; the reflux steers the distillate to a purity."""
    m = pyo.ConcreteModel(name="distillation")
    m.trays = pyo.RangeSet(trays)
    m.t = ContinuousSet(initialize=range(1, 12))
    m.x = pyo.Var(m.trays, m.t, initialize=lambda m, n, t: 0.9 - 0.8 * (n - 1) / (trays - 1))
    m.y = pyo.Var(m.trays, m.t, initialize=0.5)
    m.dx = DerivativeVar(m.x)
    m.u = pyo.Var(m.t, initialize=3.0, bounds=(1, 5))
    m.flow, m.vapour, m.below = pyo.Var(m.t, initialize=0.6), pyo.Var(m.t, initialize=0.8), pyo.Var(m.t, initialize=1)
    m.reflux = pyo.Constraint(m.t, rule=lambda m, t: m.flow[t] == 0.2 * m.u[t])
    m.rising = pyo.Constraint(m.t, rule=lambda m, t: m.vapour[t] == m.flow[t] + 0.2)
    m.falling = pyo.Constraint(m.t, rule=lambda m, t: m.below[t] == 0.4 + m.flow[t])
    m.equilibrium = pyo.Constraint(
        m.trays, m.t, rule=lambda m, n, t: m.y[n, t] * (1 + 0.6 * m.x[n, t]) == 1.6 * m.x[n, t]
    )

    def balance(m, n, t):
        if t == 1:
            return SKIP
        if n == 1:
            return m.dx[n, t] == 2 * m.vapour[t] * (m.y[n + 1, t] - m.x[n, t])
        liquid = m.flow if n <= feed else m.below
        into = m.flow[t] * m.x[n - 1, t] + 0.2 if n == feed + 1 else liquid[t] * m.x[n - 1, t]
        if n == trays:
            return m.dx[n, t] == into - 0.2 * m.x[n, t] - m.vapour[t] * m.y[n, t]
        return m.dx[n, t] == 4 * (into - liquid[t] * m.x[n, t] - m.vapour[t] * (m.y[n, t] - m.y[n + 1, t]))

    m.balance = pyo.Constraint(m.trays, m.t, rule=balance)
    m.start = pyo.Constraint(m.trays, rule=lambda m, n: m.x[n, 1] == 0.9 - 0.8 * (n - 1) / (trays - 1))
    m.cost = pyo.Objective(rule=lambda m: sum((m.x[1, t] - 0.8) ** 2 + 1e-3 * (m.u[t] - 2) ** 2 for t in range(2, 12)))
    return m


def disease(periods=8):
    """Infections per period of two weeks; the rules ask which element a time is in."""
    m = pyo.AbstractModel(name="disease")
    m.period = pyo.RangeSet(1, periods)
    m.time = ContinuousSet(initialize=lambda m: (14.0 * i for i in m.period), bounds=(0, None))
    m.cases = pyo.Param(m.period, initialize=lambda m, i: 10 + 3 * i)
    m.beta = pyo.Var(initialize=1.0, bounds=(0.01, 5))
    m.noise = pyo.Var(m.period, initialize=0)
    m.s, m.i, m.phi = (pyo.Var(m.time, bounds=(0, 1e6), initialize=value) for value in (1e5, 100, 10))
    m.sdot, m.idot, m.phidot = DerivativeVar(m.s), DerivativeVar(m.i), DerivativeVar(m.phi, bounds=(-10, None))

    def period_of(m, t):
        return m.time._fe.index(m.time.get_upper_element_boundary(t))

    m.infection = pyo.Constraint(
        m.time,
        rule=lambda m, t: SKIP if t == 0 else m.phidot[t] == m.beta * m.i[t] * m.s[t] / 1e6 + m.noise[period_of(m, t)],
    )
    m.recovery = pyo.Constraint(m.time, rule=lambda m, t: SKIP if t == 0 else m.idot[t] == m.phidot[t] - m.i[t] / 14)
    m.births = pyo.Constraint(m.time, rule=lambda m, t: SKIP if t == 0 else m.sdot[t] == 5 - m.phidot[t])
    m.start = pyo.ConstraintList(rule=lambda m: (m.i[0] == 20, m.s[0] == 1e5, m.phi[0] == 0))
    m.reported = pyo.Constraint(
        m.period, rule=lambda m, i: m.cases[i] >= 0.4 * (m.phi[m.time._fe[i]] - m.phi[m.time._fe[i - 1]])
    )
    m.fit = pyo.Objective(
        rule=lambda m: sum(
            m.noise[i] ** 2 + (m.cases[i] - 0.4 * (m.phi[14.0 * i] - m.phi[14.0 * (i - 1)])) ** 2 for i in m.period
        )
    )
    return m.create_instance()


def heat():
    """A rod that is cold at one end and loses heat at the other: exp(-t) sin(pi x)."""
    m = pyo.ConcreteModel(name="heat")
    m.t, m.x = ContinuousSet(bounds=(0, 1)), ContinuousSet(bounds=(0, 1))
    m.u = pyo.Var(m.x, m.t)
    m.dudx, m.dudx2 = DerivativeVar(m.u, wrt=m.x), DerivativeVar(m.u, wrt=(m.x, m.x))
    m.dudt = DerivativeVar(m.u, wrt=m.t)
    m.pde = pyo.Constraint(
        m.x, m.t, rule=lambda m, x, t: SKIP if x in (0, 1) or t == 0 else pi**2 * m.dudt[x, t] == m.dudx2[x, t]
    )
    m.start = pyo.Constraint(m.x, rule=lambda m, x: SKIP if x in (0, 1) else m.u[x, 0] == sin(pi * x))
    m.cold = pyo.Constraint(m.t, rule=lambda m, t: m.u[0, t] == 0)
    m.loss = pyo.Constraint(m.t, rule=lambda m, t: pi * pyo.exp(-t) + m.dudx[1, t] == 0)
    m.cost = pyo.Objective(expr=1)
    return m


def steady_exchanger():
    """Two streams in opposite directions: ``up' = down' = -(up - down) / 2`` with ``up(0) = 1`` and ``down(1) = 0``."""
    m = pyo.ConcreteModel(name="steady exchanger")
    m.z = ContinuousSet(bounds=(0, 1))
    m.up, m.down = pyo.Var(m.z, initialize=0.5), pyo.Var(m.z, initialize=0.5)
    m.up_z, m.down_z = DerivativeVar(m.up), DerivativeVar(m.down)
    m.rises = pyo.Constraint(m.z, rule=lambda m, z: SKIP if z == 0 else 2 * m.up_z[z] == m.down[z] - m.up[z])
    m.falls = pyo.Constraint(m.z, rule=lambda m, z: SKIP if z == 1 else -2 * m.down_z[z] == m.up[z] - m.down[z])
    m.hot, m.cool = pyo.Constraint(expr=m.up[0] == 1), pyo.Constraint(expr=m.down[1] == 0)
    m.cost = pyo.Objective(expr=1)
    return m


def gas_pipe():
    """A pipe with two scenarios of demand: steady at first, one decision before the scenarios part."""
    m = pyo.ConcreteModel(name="gas pipe")
    m.scenario = pyo.RangeSet(1, 2)
    m.t, m.z = ContinuousSet(initialize=range(5)), ContinuousSet(bounds=(0, 1))
    m.p = pyo.Var(m.scenario, m.t, m.z, bounds=(1, 100), initialize=50)
    m.f = pyo.Var(m.scenario, m.t, m.z, bounds=(0, 100), initialize=10)
    m.demand = pyo.Param(
        m.scenario, m.t, mutable=True, default=lambda m, k, t: 10 + 2 * k * min(max(t - 1.0, 0.0), 1.0)
    )
    m.pt, m.pz = DerivativeVar(m.p, wrt=m.t, initialize=0), DerivativeVar(m.p, wrt=m.z, initialize=0)
    m.ft, m.fz = DerivativeVar(m.f, wrt=m.t, initialize=0), DerivativeVar(m.f, wrt=m.z, initialize=0)

    def mass(m, k, t, z):
        return SKIP if t == m.t.first() or z == m.z.last() else m.pt[k, t, z] + 4 * m.fz[k, t, z] == 0

    def momentum(m, k, t, z):
        if t == m.t.first() or z == m.z.last():
            return SKIP
        return 0.1 * m.ft[k, t, z] == -m.pz[k, t, z] - m.f[k, t, z] ** 2 / m.p[k, t, z]

    m.mass = pyo.Constraint(m.scenario, m.t, m.z, rule=mass)
    m.momentum = pyo.Constraint(m.scenario, m.t, m.z, rule=momentum)
    first = m.t.first()
    m.steady_flow = pyo.Constraint(
        m.scenario, m.z, rule=lambda m, k, z: SKIP if z == m.z.last() else m.fz[k, first, z] == 0
    )
    m.steady_pressure = pyo.Constraint(
        m.scenario,
        m.z,
        rule=lambda m, k, z: (
            SKIP if z == m.z.last() else m.pz[k, first, z] == -(m.f[k, first, z] ** 2) / m.p[k, first, z]
        ),
    )
    m.outlet = pyo.Constraint(m.scenario, m.t, rule=lambda m, k, t: m.f[k, t, 1] == m.demand[k, t])
    m.same = pyo.Constraint(m.t, rule=lambda m, t: SKIP if t > 1 else m.p[2, t, 0] == m.p[1, t, 0])
    m.smooth = pyo.Var(m.scenario, m.t, initialize=0)
    m.smooth_t = DerivativeVar(m.smooth, wrt=m.t)
    m.track = pyo.Constraint(
        m.scenario,
        m.t,
        rule=lambda m, k, t: (
            SKIP if t == first else m.smooth_t[k, t] == (m.p[k, t, 1] - 45) ** 2 + 0.1 * (m.p[k, t, 0] - 50) ** 2
        ),
    )
    m.zero = pyo.Constraint(m.scenario, rule=lambda m, k: m.smooth[k, first] == 0)
    m.cost = pyo.Objective(expr=0.5 * sum(m.smooth[k, 4] for k in m.scenario))
    return m


def scheduling():
    """Two jobs in one reactor, in an order that is still to be chosen."""
    m = pyo.ConcreteModel(name="scheduling")
    m.jobs = pyo.Set(initialize=["a", "b"])
    m.tau = ContinuousSet(bounds=(0, 1))
    m.rate = pyo.Param(m.jobs, initialize={"a": 1, "b": 5})
    m.start, m.length = pyo.Var(m.jobs, bounds=(0, 20)), pyo.Var(m.jobs, bounds=(0, 20), initialize=3)
    m.c = pyo.Var(m.jobs, m.tau, bounds=(0, None), initialize=1)
    m.dc = DerivativeVar(m.c, wrt=m.tau)
    m.c["a", 0].fix(4)
    m.c["b", 0].fix(3)
    m.reaction = pyo.Constraint(m.jobs, m.tau, rule=lambda m, p, t: m.dc[p, t] == -m.length[p] * m.rate[p] * m.c[p, t])
    m.pure = pyo.Constraint(m.jobs, rule=lambda m, p: m.c[p, 1] <= 0.01)
    m.total = pyo.Var(initialize=10)
    m.end = pyo.Constraint(m.jobs, rule=lambda m, p: m.total >= m.start[p] + m.length[p])
    m.order = Disjunction(
        expr=[m.start["a"] + m.length["a"] <= m.start["b"], m.start["b"] + m.length["b"] <= m.start["a"]]
    )
    m.cost = pyo.Objective(expr=m.total)
    return m


def pendulum():
    """A damped pendulum from rest, without anything to choose."""
    m = pyo.ConcreteModel(name="pendulum")
    m.t = ContinuousSet(bounds=(0.0, 4.0))
    m.angle, m.speed = pyo.Var(m.t), pyo.Var(m.t)
    m.rate, m.acceleration = DerivativeVar(m.angle), DerivativeVar(m.speed)
    m.angle[0].fix(1.0)
    m.speed[0].fix(0.0)
    m.turns = pyo.Constraint(m.t, rule=lambda m, t: m.rate[t] == m.speed[t])
    m.swings = pyo.Constraint(m.t, rule=lambda m, t: m.acceleration[t] == -0.25 * m.speed[t] - 5 * pyo.sin(m.angle[t]))
    m.cost = pyo.Objective(expr=1)
    return m
