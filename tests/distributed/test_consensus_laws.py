"""On convex problems consensus reaches the joint optimum, whatever the penalties and the method."""

from __future__ import annotations

import numpy as np
import pytest
from quadratic_agents import joint_optimum, middle, quadratic, random_problems

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.coordination import Coordination
from pyrobocop_pyomo.teams import Hub, Sova

pytestmark = pytest.mark.casadi

N = 4
NAMES = ["a", "b", "c", "d", "e"]
EXACT = {"penalties": None, "tolerance": 3e-8, "rounds": 300}


def a_team(seed: int) -> tuple[rcp.Team, np.ndarray]:
    problems = random_problems(len(NAMES), N, seed)
    robots = [rcp.Agent(name, quadratic, *problem) for name, problem in zip(NAMES, problems, strict=True)]
    return rcp.Team(robots=robots, shared=[rcp.Shared("v", penalty=2.0)]), joint_optimum(problems)


def test_sova_reaches_the_joint_optimum() -> None:
    team, optimum = a_team(1)
    sums = []

    class Watched(Sova):
        def round(self, work: Coordination, state):
            record = super().round(work, state)
            sums.append(np.abs(sum(state.multipliers.values())).max())
            return record

    result = team.solve(Watched(**EXACT))
    assert result.success
    for values in result.values.values():
        assert values == pytest.approx(optimum, abs=1e-6)
    assert max(sums) < 1e-10


def test_the_joint_optimum_with_its_multipliers_is_a_fixed_point() -> None:
    team, optimum = a_team(2)
    problems = random_problems(len(NAMES), N, 2)
    apart = []

    class AtTheOptimum(Sova):
        def begin(self, work: Coordination):
            state = super().begin(work)
            for name, (matrix, point) in zip(NAMES, problems, strict=True):
                state.values[name] = optimum.copy()
                state.multipliers[name] = -np.array(matrix) @ (optimum - point)
            state.target = optimum.copy()
            return state

        def round(self, work: Coordination, state):
            record = super().round(work, state)
            apart.append(max(np.abs(values - optimum).max() for values in state.values.values()))
            return record

    team.solve(AtTheOptimum(penalties=None, rounds=5, tolerance=0.0))
    assert len(apart) == 5
    assert max(apart) < 1e-6


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
    result = team.solve(Sova(penalties=rcp.teams.TargetedPenalties(largest=4.0), tolerance=3e-8, rounds=300))
    assert result.success
    assert all(values == pytest.approx(optimum, abs=1e-6) for values in result.values.values())
