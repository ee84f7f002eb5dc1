"""The central model of a team states what its agents state, and nothing else: the same rows, pairs and objective."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from carts import pulling_team
from pushing_team import pushing_team
from pyomo.common.collections import ComponentSet
from quadratic_agents import crossing, middle, quadratic, random_problems

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.modeling.shared_nodes import variables_in

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import sphere


def quadratic_team() -> rcp.Team:
    robots = [rcp.Agent(f"r{i}", quadratic, *problem) for i, problem in enumerate(random_problems(3, 4, 5))]
    return rcp.Team(hub=rcp.Agent("hub", middle, 4), robots=robots, shared=[rcp.Shared("v")])


TEAMS: dict[str, Callable[[], rcp.Team]] = {
    "quadratic agents": quadratic_team,
    "a cart": pulling_team,
    "a rod and two discs": lambda: pushing_team(2, 5, seed=0),
    "a ball and three quadrotors": lambda: sphere.team(sphere.task(2, 3, 5)),
}


def statements(model: pyo.Block) -> dict[str, float]:
    """Every row and side of a pair by name, at the values that stand on the model."""
    rows = {row.name: pyo.value(row.body) for row in model.component_data_objects(pyo.Constraint, active=True)}
    for pair in model.component_data_objects(Complementarity, active=True):
        rows |= {f"{pair.name} {side}": pyo.value(pair.args[side]) for side in (0, 1)}
    return rows


@pytest.mark.parametrize("name", TEAMS)
def test_the_central_model_states_what_its_agents_state(name: str) -> None:
    team = TEAMS[name]()
    merged = team.central()
    unknown = list(merged.model.component_data_objects(pyo.Var))
    random = np.random.default_rng(0)
    for variable in unknown:
        if not variable.fixed:
            variable.set_value(float(random.uniform(0.2, 1.5)), skip_validation=True)
    known = ComponentSet(unknown)
    expressions = [row.body for row in merged.model.component_data_objects(pyo.Constraint, active=True)]
    expressions += [side for pair in merged.model.component_data_objects(Complementarity) for side in pair.args]
    expressions.append(merged.model.objective.expr)
    assert all(v in known for expression in expressions for v in variables_in(expression, include_fixed=False))
    stated = np.sort(np.array(list(statements(merged.model).values())))
    total = 0.0
    for agent in (team.hub, *team.robots):
        own = agent.builder(*agent.data)
        for component in own.component_objects(pyo.Var):
            for index, variable in component.items():
                variable.set_value(merged.find(component.name, agent.name)[index].value, skip_validation=True)
        total += sum(pyo.value(cost) for cost in own.component_data_objects(pyo.Objective, active=True))
        for row, expected in statements(own).items():
            at = int(np.searchsorted(stated, expected))
            near = stated[max(at - 1, 0) : at + 1]
            assert np.abs(near - expected).min() <= 1e-9 * max(1.0, abs(expected)), f"{agent.name}: {row}"
    assert pyo.value(merged.model.objective) == pytest.approx(total, rel=1e-9)


def test_what_agents_pay_follows_them_onto_another_mesh() -> None:
    """A way of 2 in 2 s costs 2 on any mesh; the integrals were sums over the points of the first."""
    agents = [rcp.Agent(f"d{i}", crossing, i, 3) for i in range(3)]
    merged = rcp.Team(robots=agents, shared=[rcp.Shared("pace")]).central()
    for part in merged.parts.values():
        part.pace.fix(1.0)
        rcp.remesh_phases({part.me: 4})
        for control in (part.me.u, part.me.v):
            for variable in control.values():
                variable.set_value(1.0)
    assert pyo.value(merged.model.objective) == pytest.approx(3 * 4 + 1 + 0 + 1)
