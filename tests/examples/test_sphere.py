"""The ball and its quadrotors: their models, their sizes, their tasks, and a plan for all of them."""

from __future__ import annotations

import pickle

import numpy as np
import pyomo.environ as pyo
import pytest
import sphere

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mechanics.bodies import SPACE


def size(model: pyo.ConcreteModel) -> int:
    return sum(1 for _ in model.component_data_objects(pyo.Var))


def test_a_quadrotors_model_does_not_grow_with_the_team() -> None:
    sizes = {
        n: (size(sphere.sphere(sphere.task(0, n))), size(sphere.quadrotor(sphere.task(0, n), "b"))) for n in (2, 12)
    }
    assert [robot for _, robot in sizes.values()] == [9 * 43 + (6 + 3 + 6 + 6 + 4) * 42] * 2
    assert [hub for hub, _ in sizes.values()] == [18 * 43 + (4 + 6 * n) * 42 for n in sizes]


@pytest.mark.parametrize("robots", [3, 12])
def test_the_models_are_complete_and_builders_travel(robots: int) -> None:
    task = sphere.task(3, robots)
    build_sphere, build_quadrotor, sent = pickle.loads(pickle.dumps((sphere.sphere, sphere.quadrotor, task)))
    assert sent == task
    hub, robot = build_sphere(sent), build_quadrotor(sent, "a")
    for phase in (hub.body, robot.body, robot.me):
        phase.check()
    for name in ("qx", "qy", "qz"):
        assert list(hub.body.component(name)) == list(robot.body.component(name))
    for name in ("ux", "uy", "uz", "wx", "wy", "wz"):
        assert list(hub.body.component(name))[1:] == list(robot.body.component(name))
    assert list(hub.push["a"].mz) == list(robot.push["a"].mz)


@pytest.mark.parametrize("robots", [3, 12])
def test_tasks_have_room_for_everybody(robots: int) -> None:
    for seed in range(5):
        task = sphere.task(seed, robots)
        places = np.array(list(task.robots.values()))
        gaps = [task.ball.shape.gap_to_sphere(0.12, place, task.start[:3]).gap for place in places]
        assert min(gaps) > 0.1
        distances = np.linalg.norm(places[:, None] - places[None, :], axis=-1) + 9 * np.eye(robots)
        assert distances.min() > sphere.APART
        assert np.linalg.norm(np.subtract(task.goal, task.start)[:2]) == pytest.approx(0.4)
        assert 20 <= np.degrees(np.linalg.norm(task.goal[3:])) <= 60


def test_the_guess_touches_the_ball_from_below_and_keeps_apart() -> None:
    for robots in (3, 12):
        m = sphere.build(1, robots)
        late = [t for t in m.body.points if t > sphere.MEETING]
        for me in m.me.values():
            assert max(abs(me.gap[t].value) for t in late) < 1e-6
            assert all(me.normal_z[t].value < -0.25 for t in late)
        assert min(pyo.value(row.body) for row in m.apart.values()) > sphere.APART**2
        score = m.score(sphere.plans_of(m))
        assert not score.practical


def test_the_team_shares_what_its_models_have() -> None:
    """One model for all, made from the builders of the agents, has the guess of the example's own, and scores it."""
    task = sphere.task(2)
    team = sphere.team(task)
    merged = team.central()
    plans = team.plans_of(merged)
    assert set(plans) == {"sphere", "a", "b", "c"}
    np.testing.assert_allclose(plans["a"]["me.z"], list(sphere.quadrotor(task, "a").me.z.extract_values().values()))
    assert not team.physics(plans).practical


@pytest.mark.ipopt
@pytest.mark.slow
def test_three_quadrotors_catch_the_ball() -> None:
    """Strict by physics, its pairs met, and its rotations rotations."""
    m = sphere.build(1)
    result = rcp.solve(m, strategies=rcp.Strategy("barrier", polish=False, exploration=0), backend="vectorised")
    assert result.solved
    assert result.largest_product < 1e-7
    score = m.score(sphere.plans_of(m))
    assert score.strict, str(score)
    entries = [list(m.body.component(name).extract_values().values()) for name in SPACE.orientation]
    rotations = np.array(entries).T.reshape(-1, 3, 3)
    assert np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max() < 1e-10
    # Pairs are met within the barrier's last bound; the rest holds to rounding.
    verdict = m.body.trajectory().verify()
    assert verdict.largest_violation < 1e-6
