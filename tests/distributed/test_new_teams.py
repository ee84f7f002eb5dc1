"""A team that no example has, as a user writes it: from defaults it plans as well as one planner for all."""

import math
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi

DRONES = tuple(f"drone {i}" for i in range(6))
FLIGHT = {"duration": 2.0, "elements": 12}


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


def test_a_new_team_plans_as_well_as_one_planner_from_defaults() -> None:
    team = drones()
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
