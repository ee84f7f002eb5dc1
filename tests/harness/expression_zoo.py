"""Models with every kind of expression, each with a box in which all of its functions are smooth."""

import math

import pyomo.environ as pyo
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from harness.small_problems import every_kind_of_row, fixed_variable, hock_schittkowski_71, maximisation, square_system

UNARY = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "atanh", "exp", "log", "log10",
    "sqrt",
)  # fmt: skip


def cart_pole(elements: int = 6, **phase_options) -> pyo.ConcreteModel:
    """Swing-up with fixed boundary values: the first and the last point differ in shape from all others."""
    m = pyo.ConcreteModel("cart-pole")
    m.length = pyo.Param(initialize=0.5, mutable=True)
    m.swing = b = rcp.PhaseBlock(**{"duration": 2.0, "elements": elements, **phase_options})
    b.q = rcp.State(initial=0, final=1, bounds=(-2, 2), initial_guess=lambda t: t / 2)
    b.theta = rcp.State(initial=0, final=math.pi, initial_guess=lambda t: math.pi * t / 2)
    b.v = rcp.State(initial=0, final=0)
    b.omega = rcp.State(initial=0, final=0)
    b.force = rcp.Control(bounds=(-20, 20))

    @b.ode
    def cart_pole(b, t):
        s, c, u, w = pyo.sin(b.theta[t]), pyo.cos(b.theta[t]), b.force[t], b.omega[t]
        inertia = 1 + 0.3 * s**2
        return {
            b.q: b.v[t],
            b.theta: w,
            b.v: (m.length * 0.3 * s * w**2 + u + 0.3 * 9.81 * c * s) / inertia,
            b.omega: -(m.length * 0.3 * c * s * w**2 + u * c + 1.3 * 9.81 * s) / (m.length * inertia),
        }

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2))
    return m


def free_duration() -> pyo.ConcreteModel:
    """A duration that multiplies a long sum and every rate."""
    m = cart_pole(8, duration=rcp.Duration(bounds=(1, 4), initial_guess=2.0))
    m.cost.set_value(m.cost.expr + 0.1 * m.swing.duration)
    return m


def unary_functions() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("unary")
    m.x = pyo.Var(range(3), initialize=0.4)
    m.rows = pyo.Constraint(
        range(len(UNARY)),
        rule=lambda m, i: getattr(pyo, UNARY[i])(0.5 + 0.4 * m.x[i % 3] * m.x[(i + 1) % 3]) + m.x[0] <= 3,
    )
    m.acosh = pyo.Constraint(expr=pyo.acosh(2 + m.x[0] * m.x[1]) + abs(m.x[2] + 3) ** 1.5 <= 9)
    m.cost = pyo.Objective(expr=sum(getattr(pyo, name)(0.3 + 0.5 * m.x[0]) for name in UNARY))
    return m


def powers_and_quotients() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("powers")
    m.x = pyo.Var(range(4), initialize=0.5)
    m.p = pyo.Param(initialize=2.5, mutable=True)
    x = [0.8 + 0.5 * m.x[i] for i in range(4)]
    exponents = (2, 3, -1, -2, 0.5, 1.5, -0.3, 1, 0)
    m.constant = pyo.Constraint(range(len(exponents)), rule=lambda m, i: x[i % 4] ** exponents[i] + m.x[1] <= 4)
    m.variable = pyo.Constraint(expr=x[0] ** x[1] + x[2] ** m.p + m.p ** x[3] + 2 ** m.x[0] == 5)
    m.quotients = pyo.Constraint(expr=m.x[0] / x[1] - 1 / x[2] / x[3] + (m.x[2] / 4 + m.x[1] / m.p) / x[0] >= -7)
    m.cost = pyo.Objective(expr=(x[0] / x[1]) ** m.p / 3)
    return m


def parameters_everywhere() -> pyo.ConcreteModel:
    """Mutable Params and fixed variables in coefficients, terms, constants, bounds and ranges."""
    m = pyo.ConcreteModel("parameters")
    m.p = pyo.Param(range(3), initialize={0: 0.5, 1: 2.0, 2: -1.5}, mutable=True)
    m.x = pyo.Var(range(6), initialize=0.2, bounds=lambda m, i: (-m.p[1], m.p[1]) if i == 4 else (None, 3))
    m.x[5].fix(0.7)
    p, x = m.p, m.x
    m.linear = pyo.Constraint(expr=p[0] * x[0] + p[0] * p[1] * x[1] + 3 * p[2] + 2 * x[5] - x[2] / p[1] == p[1] * p[2])
    m.terms = pyo.Constraint(
        range(5), rule=lambda m, i: pyo.sin(p[i % 3] * x[i]) * x[(i + 1) % 6] + p[0] * x[i] ** 2 <= p[1] + i
    )
    m.range = pyo.Constraint(expr=(-p[1], x[0] * x[5] + x[3], 2 * p[1]))
    m.only_numbers = pyo.Constraint(expr=p[0] * x[5] + pyo.exp(p[2]) <= 1 + p[1])
    m.constant_term = pyo.Constraint(expr=pyo.exp(p[2]) * p[0] + x[0] + pyo.cos(x[5]) >= -5)
    m.sleeping = pyo.Constraint(range(2), rule=lambda m, i: x[i] >= -9)
    m.sleeping[1].deactivate()
    m.cost = pyo.Objective(expr=p[1] * sum(x[i] ** 2 for i in range(6)) + pyo.exp(p[0] * x[5]) + 1)
    return m


def shared_expressions() -> pyo.ConcreteModel:
    """Named expressions within each other, common subexpressions, and rows that use one variable twice."""
    m = pyo.ConcreteModel("shared")
    m.x = pyo.Var(range(5), initialize=0.3)
    m.inner = pyo.Expression(range(4), rule=lambda m, i: pyo.sin(m.x[i]) * m.x[i + 1] + 2 * m.x[0])
    m.outer = pyo.Expression(expr=m.inner[0] ** 2 + m.inner[1])
    m.linear = pyo.Expression(expr=3 * m.x[0] - m.x[1] + 1)
    node = m.x[0] * m.x[1]
    for _ in range(6):
        node = 0.5 * pyo.cos(node) * node
    m.deep = pyo.Constraint(expr=node + m.linear <= 3)
    m.twice = pyo.Constraint(range(5), rule=lambda m, i: m.x[i] * m.x[(2 * i) % 5] * pyo.exp(m.x[i]) <= 4)
    m.rows = pyo.Constraint(range(4), rule=lambda m, i: m.inner[i] * m.outer + m.linear * m.inner[i] + m.linear <= 9)
    m.cost = pyo.Objective(expr=m.outer + m.linear**2, sense=pyo.maximize)
    return m


def choices() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("choices")
    m.x = pyo.Var(range(3), initialize=0.3)
    x = m.x
    m.a = pyo.Constraint(expr=pyo.Expr_if(x[0] <= 0.1, x[1] ** 2, pyo.sin(x[2])) + x[0] <= 2)
    m.b = pyo.Constraint(expr=pyo.Expr_if(pyo.inequality(-0.2, x[0], 0.3), x[1] * x[0], x[2] ** 3) >= -3)
    m.cost = pyo.Objective(expr=pyo.Expr_if(x[1] < 0.5, x[0] ** 2, x[0] ** 4) + x[1] ** 2)
    return m


def many_of_each() -> pyo.ConcreteModel:
    """Every function and operator often enough to be evaluated on arrays, next to each other in one row."""
    m = pyo.ConcreteModel("many")
    m.x = pyo.Var(range(40), initialize=0.3)
    m.p = pyo.Param(range(40), initialize=lambda m, i: 1.5 + i / 40, mutable=True)
    names = [name for name in UNARY if name not in ("asinh", "atanh")]  # that CasADi's reader of files knows

    def functions(m, i):
        return sum(getattr(pyo, name)(0.5 + 0.4 * m.x[i] * m.x[(i + 1) % 40]) for name in names) <= 40

    def operators(m, i):
        x, y, p = 0.7 + m.x[i], 0.8 + m.x[(i + 3) % 40] ** 2, m.p[i]
        powers = x**p + p**y + x**y + x**-1.5 + x**3 + (2 + 0.1 * i) ** x
        return powers - x / y / p + abs(x - 5) * abs(y) - (-x) * 3 / (1 + i) <= 50

    m.functions = pyo.Constraint(range(40), rule=functions)
    m.operators = pyo.Constraint(range(40), rule=operators)
    m.cost = pyo.Objective(expr=sum((m.x[i] - i) ** 2 / m.p[i] for i in m.x))
    return m


def many_choices() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("many choices")
    m.x = pyo.Var(range(20), initialize=0.3)

    def choice(m, i):
        x, y = m.x[i], m.x[(i + 1) % 20]
        inner = pyo.Expr_if(pyo.inequality(0.1, y, 0.3), x**2, pyo.exp(y))
        return pyo.Expr_if(x <= 0.2, inner * x, pyo.asinh(y) + pyo.atanh(y / 2) + pyo.acosh(1.5 + x)) <= 9

    m.rows = pyo.Constraint(range(20), rule=choice)
    m.cost = pyo.Objective(expr=sum(m.x[i] ** 4 for i in m.x))
    return m


def long_sums() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("sums")
    m.x = pyo.Var(range(40), initialize=0.1)
    m.t = pyo.Var(initialize=1.5)
    terms = [(m.x[i] - 0.01 * i) ** 2 * (1 + m.x[(i + 1) % 40]) for i in range(40)]
    m.cost = pyo.Objective(expr=0.5 * (m.t * (2 * sum(terms)) + sum(m.x[i] for i in m.x) * m.t) - sum(terms) / 7)
    m.row = pyo.Constraint(expr=sum(pyo.sin(m.x[i]) * m.t for i in m.x) + sum(m.x[i] for i in m.x) == 1)
    m.product = pyo.Constraint(expr=sum(m.x[i] for i in m.x) * sum(m.x[i] ** 2 for i in m.x) <= 60)
    return m


def all_different() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel("different")
    m.x = pyo.Var(range(30), initialize=0.2)

    def row(m, i):
        node = m.x[i]
        for k in range(1 + i % 7):
            node = pyo.sin(node) * m.x[(i + k) % 30] if (i >> k) & 1 else pyo.exp(node / 2) - m.x[(3 * i + k) % 30]
        return node <= 5

    m.rows = pyo.Constraint(range(30), rule=row)
    m.cost = pyo.Objective(expr=sum(m.x[i] ** 2 for i in m.x))
    return m


ZOO = [
    cart_pole,
    free_duration,
    lambda: cart_pole(4, scheme="gauss", stages=2),
    unary_functions,
    powers_and_quotients,
    parameters_everywhere,
    shared_expressions,
    choices,
    many_of_each,
    many_choices,
    long_sums,
    all_different,
    lambda: hock_schittkowski_71()[0],
    lambda: maximisation()[0],
    lambda: square_system()[0],
    lambda: fixed_variable()[0],
    every_kind_of_row,
]
ZOO_NAMES = [
    "cart-pole", "free-duration", "gauss", "unary", "powers", "parameters", "shared", "choices", "many",
    "many-choices", "long-sums",
    "all-different", "hs71", "maximisation", "square", "fixed", "rows",
]  # fmt: skip


def trees(leaves: st.SearchStrategy) -> st.SearchStrategy:
    """Random smooth expressions: no domain is left and no value explodes."""

    def extend(children):
        pairs = st.tuples(children, children)
        return st.one_of(
            pairs.map(lambda pair: pair[0] + pair[1]),
            pairs.map(lambda pair: pair[0] - pair[1]),
            pairs.map(lambda pair: pyo.sin(pair[0]) * pyo.tanh(pair[1])),
            pairs.map(lambda pair: pair[0] / (2 + pair[1] ** 2)),
            children.map(lambda child: -child),
            children.map(lambda child: pyo.sqrt(1 + pyo.cos(child) ** 2)),
            children.map(lambda child: pyo.exp(pyo.sin(child))),
            children.map(lambda child: 3 * pyo.atan(child) + 1),
            children.map(lambda child: child * pyo.cos(child)),
        )

    return st.recursive(leaves, extend, max_leaves=12)
