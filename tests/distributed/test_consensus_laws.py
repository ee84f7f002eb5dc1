"""On convex problems consensus reaches the joint optimum, whatever the penalties and the method."""

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carts import pulling_team
from pushing_team import task, team
from quadratic_agents import joint_optimum, middle, quadratic, random_problems

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.closing import Closing
from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.execution.engine import AgentFailure
from pyrobocop_pyomo.teams import Hub, Sova

pytestmark = pytest.mark.casadi

N = 4
NAMES = ["a", "b", "c", "d", "e"]
EXACT = {"penalties": None, "tolerance": 3e-8, "rounds": 300, "closing": None}


def a_team(seed: int) -> tuple[rcp.Team, np.ndarray]:
    problems = random_problems(len(NAMES), N, seed)
    robots = [rcp.Agent(name, quadratic, *problem) for name, problem in zip(NAMES, problems, strict=True)]
    return rcp.Team(robots=robots, shared=[rcp.Shared("v", penalty=2.0)]), joint_optimum(problems)


def test_sova_reaches_the_joint_optimum() -> None:
    team, optimum = a_team(1)
    result = team.solve(Sova(**EXACT))
    assert result.success
    for values in result.values.values():
        assert values == pytest.approx(optimum, abs=1e-6)


def test_the_hub_reaches_the_joint_optimum() -> None:
    problems = random_problems(len(NAMES), N, 3)
    robots = [rcp.Agent(name, quadratic, *problem) for name, problem in zip(NAMES, problems, strict=True)]
    team = rcp.Team(hub=rcp.Agent("hub", middle, N), robots=robots, shared=[rcp.Shared("v", penalty=2.0)])
    result = team.solve(Hub(**EXACT))
    # On the plane where the values sum to one: a KKT system.
    total = sum(np.array(matrix) for matrix, _ in problems)
    right = sum(np.array(matrix) @ point for matrix, point in problems)
    system = np.block([[total, np.ones((N, 1))], [np.ones((1, N)), np.zeros((1, 1))]])
    optimum = np.linalg.solve(system, np.append(right, 1.0))[:N]
    assert result.success
    assert result.agreed["v"] == pytest.approx(optimum, abs=1e-6)
    merged = team.central()
    assert rcp.solve(merged.model).quality is rcp.Quality.OPTIMAL
    assert [variable.value for variable in merged.find("v").values()] == pytest.approx(optimum, abs=1e-6)


def test_penalties_may_change_without_moving_the_answer() -> None:
    team, optimum = a_team(4)
    result = team.solve(Sova(**{**EXACT, "penalties": rcp.teams.TargetedPenalties(largest=4.0)}))
    assert result.success
    assert all(values == pytest.approx(optimum, abs=1e-6) for values in result.values.values())


@pytest.mark.parametrize("penalty", [0.07, 7.0])
def test_a_team_of_phases_agrees_with_one_planner_to_five_digits_within_sixty_rounds(penalty: float) -> None:
    team = pulling_team(penalty=penalty)
    merged = team.central()
    rcp.solve(merged.model, progress=False)
    team.solve(Hub(rounds=60, tolerance=0.0, closing=None), on_round=(records := []).append, progress=False)
    assert max(abs(record.objective / merged.objective_value() - 1.0) for record in records[-10:]) < 1e-5
    assert records[-1].agrees(1e-4)


# --------------------------------------------------------------------
# The closing step: one planner makes exact what a team has nearly agreed on, and asks no more than the team did.


SMALL = task(seed=3, robots=2, steps=14)


@pytest.fixture(scope="module")
def closed() -> rcp.teams.TeamResult:
    return team(SMALL).solve(rcp.teams.Hub(rounds=60), progress=False)


def test_a_closed_plan_is_exact(closed: rcp.teams.TeamResult) -> None:
    """Physics recomputes the forces: rounds leave some per cent missing, a model of all agents nothing."""
    score = closed.score
    assert score is not None
    assert score.strict
    assert closed.closings
    assert max(score.object_force, score.object_moment, score.robot_force) < 1e-4
    assert "closing step" in str(closed)
    assert closed.cpu_seconds > sum(c.cpu_seconds for c in closed.closings) > 0


def test_its_plans_are_those_of_one_model(closed: rcp.teams.TeamResult) -> None:
    """What all share is the same in all of their plans, and robots are apart at each time."""
    places = [np.stack([closed.plans[name]["me.x"], closed.plans[name]["me.y"]]) for name in SMALL.robots]
    for one, other in combinations(places, 2):
        assert np.linalg.norm(one - other, axis=0)[1:].min() > 0.25 * 0.98
    assert closed.objective == pytest.approx(closed.closings[-1].objective)


def test_without_it_the_rounds_go_on() -> None:
    result = team(SMALL).solve(rcp.teams.Hub(rounds=13, closing=None), progress=False)
    assert (len(result.rounds), list(result.closings)) == (13, [])


def test_all_rounds_are_carried_out_where_they_are_asked_for() -> None:
    """A closed plan is kept, and ends nothing."""
    result = team(SMALL).solve(rcp.teams.Hub(rounds=13, until="rounds"), progress=False)
    assert len(result.rounds) == 13
    assert result.closings


def test_engines_close_alike() -> None:
    """The closing step starts from numbers that travel, so where agents live does not show."""
    method = rcp.teams.Hub(rounds=12, closing=Closing(path=(1e-3,), iterations=3))
    here, there = (team(SMALL).solve(method, engine=engine, progress=False) for engine in ("serial", "process"))
    assert len(here.closings) == 1
    for one, other in zip(here.closings, there.closings, strict=True):
        for name, plan in one.plans.items():
            assert all((values == other.plans[name][label]).all() for label, values in plan.items())


def test_a_checkpoint_remembers_when_it_was_tried(tmp_path: Path) -> None:
    """A try that gives nothing is not repeated at once by the call that goes on."""
    method = rcp.teams.Hub(rounds=14, closing=Closing(path=(1e-3,), iterations=1, every=100))
    path = tmp_path / "team.npz"
    first = team(SMALL).solve(method, checkpoint=path, on_round=lambda record: record.number < 11, progress=False)
    rest = team(SMALL).solve(method, checkpoint=path, progress=False)
    assert (len(first.closings), len(rest.closings), len(rest.rounds)) == (1, 0, 2)


@pytest.mark.parametrize("wrong", [{"below": 0.0}, {"every": 0}, {"path": ()}, {"path": (1e-3, 0.0)}])
def test_numbers_that_make_no_step(wrong: dict) -> None:
    with pytest.raises(TeamError, match="expected below > 0"):
        Closing(**wrong)


def test_a_team_that_agrees_by_itself_is_not_closed() -> None:
    result = pulling_team(penalty=0.7).solve(Hub(rounds=40, tolerance=1e-3), progress=False)
    assert result.success
    assert (len(result.rounds) <= 12, list(result.closings)) == (True, [])


class LossyEngine(rcp.teams.SerialEngine):
    """Of one robot only each fourth exchange brings a report, of the others four in five."""

    def solve(self, orders: Mapping[str, Any]) -> dict[str, Any]:
        self.round, random = self.round + 1, np.random.default_rng(self.round)
        lost = {name for name in orders if name not in ("rod", "a") and random.random() < 0.2}
        lost |= {"a"} & set(orders) if self.round % 4 else set()
        reports = super().solve({name: order for name, order in orders.items() if name not in lost})
        return {name: reports.get(name, AgentFailure(name, "its report was lost")) for name in orders}

    round = 0


def test_lost_reports() -> None:
    """Rounds go on with what has arrived; the plan is strict all the same."""
    result = team(SMALL).solve(engine=LossyEngine(), progress=False)
    assert sum(len(record.failures) for record in result.rounds) > 1
    assert result.score is not None
    assert result.score.strict
