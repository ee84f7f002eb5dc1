"""Teams that no example has, as a user writes them: from defaults they plan as well as one planner for all."""

import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi

DRONES, TRUCKS = (tuple(f"{kind} {i}" for i in range(count)) for kind, count in (("drone", 6), ("truck", 5)))
FLIGHT = {"duration": 2.0, "elements": 12}
ROAD = {"duration": 60.0, "elements": 20}


def drone(name: str) -> pyo.ConcreteModel:
    """To the other side of a circle; the faster, the more of the bandwidth it needs."""
    m, angle = pyo.ConcreteModel(name=name), 2 * math.pi * DRONES.index(name) / len(DRONES)
    m.link = rcp.PhaseBlock([name], rule=bandwidth, **FLIGHT)
    m.me = b = rcp.PhaseBlock(**FLIGHT)
    for axis, start in (("x", 2 * math.cos(angle)), ("y", 2 * math.sin(angle))):
        b.declare(axis, rcp.State(initial=start, final=-start))
        b.declare(f"v{axis}", rcp.State(initial=0, final=0))
        b.declare(f"a{axis}", rcp.Control(bounds=(-20, 20)))
    b.ode(lambda b, t: {b.x: b.vx[t], b.y: b.vy[t], b.vx: b.ax[t], b.vy: b.ay[t]})
    b.constraint(lambda b, t: 0.05 * (b.vx[t] ** 2 + b.vy[t] ** 2) <= m.link[name].w[t])
    b.initialize_straight_lines()
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: 0.01 * (b.ax[t] ** 2 + b.ay[t] ** 2)))
    return m


def bandwidth(link: Any, name: str) -> None:
    link.w = rcp.Control(bounds=(0, None), initial_guess=1.0)


def station(budget: float) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="station")
    m.link = rcp.PhaseBlock(DRONES, rule=bandwidth, **FLIGHT)
    points = list(m.link[DRONES[0]].points)
    m.budget = pyo.Constraint(points, rule=lambda m, t: sum(link.w[t] for link in m.link.values()) <= budget)
    m.cost = pyo.Objective(expr=0.0)
    return m


def drones() -> rcp.Team:
    return rcp.Team(
        hub=rcp.Agent("station", station, 1.6),
        robots=[rcp.Agent(name, drone, name) for name in DRONES],
        shared=[rcp.Shared("link[{robot}]")],
        keep_apart=rcp.KeepApart(("me.x", "me.y"), distance=0.5),
    )


def start_of(name: str) -> float:
    return -25.0 * TRUCKS.index(name)


def truck(name: str) -> pyo.ConcreteModel:
    """Over hills, the heavier the later."""
    m, mass = pyo.ConcreteModel(name=name), 1.0 + 0.3 * TRUCKS.index(name)
    m.at = rcp.PhaseBlock([name], rule=place, **ROAD)
    m.me = b = rcp.PhaseBlock(**ROAD)
    b.v = rcp.State(initial=15, final=15, bounds=(5, 25))
    b.f = rcp.Control(bounds=(-3, 2))
    m.at[name].ode(lambda at, t: {at.s: b.v[t]})
    hill = 9.81 * 0.03
    b.ode(lambda b, t: {b.v: b.f[t] / mass - hill * pyo.sin(m.at[name].s[t] / 48.0) - 5e-4 * b.v[t] ** 2})
    m.at[name].initialize_straight_lines()
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.f[t] ** 2 / mass))
    return m


def place(at: Any, name: str) -> None:
    at.s = rcp.State(initial=start_of(name), final=900.0 + start_of(name))


def road() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="road")
    m.at = rcp.PhaseBlock(TRUCKS, rule=place_with_speed, **ROAD)
    places, points = list(m.at.values()), list(m.at[TRUCKS[0]].points)
    m.gap = pyo.Constraint(
        range(len(TRUCKS) - 1), points, rule=lambda m, i, t: places[i].s[t] - places[i + 1].s[t] >= 20.0
    )
    m.cost = pyo.Objective(expr=0.0)
    return m


def place_with_speed(at: Any, name: str) -> None:
    place(at, name)
    at.speed = rcp.Control()
    at.ode(lambda at, t: {at.s: at.speed[t]})
    at.initialize_straight_lines()


def trucks() -> rcp.Team:
    robots = [rcp.Agent(name, truck, name) for name in TRUCKS]
    return rcp.Team(hub=rcp.Agent("road", road), robots=robots, shared=[rcp.Shared("at[{robot}].s")])


@pytest.mark.parametrize("make", [drones, trucks])
def test_a_new_team_plans_as_well_as_one_planner_from_defaults(make: Callable[[], rcp.Team]) -> None:
    team = make()
    central = rcp.solve(team.central().model, progress=False, mesh_tolerance=None)
    result = team.solve(progress=False)
    assert result.success, str(result)
    assert len(result.rounds) <= 100
    assert result.objective <= 1.02 * central.objective
    # What is shared is the same in the plans of the hub and of the robots.
    for shared in team.shared:
        for robot in team.names:
            for name in shared.names_for(robot):
                of_hub = {k: v for k, v in result.plans[team.hub.name].items() if k.startswith(name)}
                for label, values in of_hub.items():
                    if label in result.plans[robot]:
                        assert values == pytest.approx(result.plans[robot][label], abs=1e-9)


def test_without_a_closing_step_a_team_that_does_not_agree_says_so() -> None:
    result = drones().solve(rcp.teams.Hub(rounds=3, closing=None), progress=False)
    assert not result.success
    assert "do not agree" in str(result)
