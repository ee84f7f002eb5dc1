"""Three robots carry a load, a convex team: it agrees with one planner to five digits, soon and for any penalty."""

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi
GRID = {"duration": 2.0, "elements": 20, "scheme": "implicit_euler"}
ARMS, PRICES = {"a": -1.0, "b": 0.2, "c": 1.0}, {"a": 0.01, "b": 0.02, "c": 0.005}


def force(b, name: str) -> None:
    b.f = rcp.Control(bounds=(-40, 40))


def tray() -> pyo.ConcreteModel:
    """The load is lifted and tilted under the forces of all."""
    m = pyo.ConcreteModel(name="tray")
    m.push = rcp.PhaseBlock(list(ARMS), rule=force, **GRID)
    m.body = b = rcp.PhaseBlock(**GRID)
    for name, final in {"y": 1.0, "w": 0.3, "v": 0.0, "r": 0.0}.items():
        setattr(b, name, rcp.State(initial=0.0, final=final))

    @b.ode
    def motion(b, t):
        lift = sum(p.f[t] for p in m.push.values())
        moment = sum(ARMS[name] * p.f[t] for name, p in m.push.items())
        return {"y": b.v[t], "w": b.r[t], "v": lift / 5.0 - 9.81, "r": moment / 2.0}

    return m


def carrier(name: str) -> pyo.ConcreteModel:
    """Pays for its force, for its speed, and for not being where its corner of the load is."""
    m = pyo.ConcreteModel(name=name)
    m.push = rcp.PhaseBlock([name], rule=force, **GRID)
    m.body, m.me = rcp.PhaseBlock(**GRID), rcp.PhaseBlock(**GRID)
    for position, speed in (("y", "v"), ("w", "r")):
        setattr(m.body, position, rcp.State(initial=0.0))
        setattr(m.body, speed, rcp.Control())
    m.body.ode(lambda b, t: {"y": b.v[t], "w": b.r[t]})
    m.me.z, m.me.u = rcp.State(initial=0.0), rcp.Control()
    m.me.ode(lambda me, t: {"z": me.u[t]})

    def price(me, t):
        away = me.z[t] - m.body.y[t] - ARMS[name] * m.body.w[t]
        return PRICES[name] * m.push[name].f[t] ** 2 + 100 * away**2 + me.u[t] ** 2

    m.cost = pyo.Objective(expr=m.me.integral(price))
    return m


def carriers(scale: float) -> rcp.Team:
    return rcp.Team(
        hub=rcp.Agent("tray", tray),
        robots=[rcp.Agent(name, carrier, name) for name in ARMS],
        shared=[
            rcp.Shared("body.y", "body.w", penalty=50.0 * scale),
            rcp.Shared("push[{robot}].f", penalty=0.02 * scale),
        ],
    )


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_five_digits_within_sixty_rounds(scale: float) -> None:
    team = carriers(scale)
    merged = team.central()
    rcp.solve(merged.model, progress=False)
    best = merged.objective_value()
    team.solve(rcp.teams.Hub(rounds=60, tolerance=0.0), on_round=(records := []).append, progress=False)
    errors = [abs(record.objective / best - 1.0) for record in records]
    assert max(errors[-10:]) < 1e-5
    assert records[-1].agrees(1e-4)
