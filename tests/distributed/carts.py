"""A convex team: a cart that two robots pull to the origin, each paying for its own force."""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

GRID = {"duration": 2.0, "elements": 8, "scheme": "implicit_euler"}
PRICES = {"a": 1.0, "b": 2.0}


def pull(b, name: str) -> None:
    """The force of one robot, N."""
    b.f = rcp.Control()


def cart(q: float, u: float) -> pyo.ConcreteModel:
    """A mass of 2 kg under the forces of all robots."""
    m = pyo.ConcreteModel(name="cart")
    m.pull = rcp.PhaseBlock(list(PRICES), rule=pull, **GRID)
    m.body = rcp.PhaseBlock(**GRID)
    m.body.q = rcp.State(initial=q, final=0.0)
    m.body.u = rcp.State(initial=u, final=0.0)
    m.body.ode(lambda b, t: {"q": b.u[t], "u": sum(p.f[t] for p in m.pull.values()) / 2.0})
    return m


def puller(name: str) -> pyo.ConcreteModel:
    """A robot that pays for its force, and wears out with what it has given (a state of its own)."""
    m = pyo.ConcreteModel(name=name)
    m.pull = rcp.PhaseBlock([name], rule=pull, **GRID)
    m.me = rcp.PhaseBlock(**GRID)
    m.me.worn = rcp.State(initial=0.0)
    m.me.ode(lambda b, t: {"worn": m.pull[name].f[t]})
    m.cost = pyo.Objective(expr=PRICES[name] * m.pull[name].integral(lambda b, t: b.f[t] ** 2))
    return m


def pulling_team(q: float = 1.0, u: float = 0.0, penalty: float = 0.7) -> rcp.Team:
    """From where the cart is now."""
    return rcp.Team(
        hub=rcp.Agent("cart", cart, q, u),
        robots=[rcp.Agent(name, puller, name) for name in PRICES],
        shared=[rcp.Shared("pull[{robot}]", penalty=penalty)],
    )
