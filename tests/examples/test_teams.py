"""Examples of teams: their models, their schedules, and plans for all of them."""

import pickle
from itertools import pairwise

import hit_and_catch as game
import numpy as np
import pyomo.environ as pyo
import pytest
import rod
import sphere
import truss_robot as truss

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mechanics.bodies import SPACE
from pyrobocop_pyomo.mechanics.plan_score import PlannedBody

MODELS = {
    "rod": (rod.task(3), rod.rod, rod.robot, ("qx", "qy", "qth"), ("ux", "uy", "uth"), "fx"),
    "ball": (
        sphere.task(3, 12), sphere.sphere, sphere.quadrotor, ("qx", "qy", "qz"), ("ux", "uy", "uz", "wx", "wy", "wz"),
        "mz",
    ),
}  # fmt: skip


@pytest.mark.parametrize("team", MODELS)
def test_models_are_complete_builders_travel_and_shared_components_have_the_same_name_and_grid(team: str) -> None:
    """What a team agrees on: pose and velocity of the body, and each robot's push."""
    task, *builders, poses, velocities, push = MODELS[team]
    build_body, build_robot, sent = pickle.loads(pickle.dumps((*builders, task)))
    assert sent == task
    hub, robot = build_body(sent), build_robot(sent, "a")
    for phase in (hub.body, robot.body, robot.me):
        phase.check()
    for name in poses:
        assert list(hub.body.component(name)) == list(robot.body.component(name))
    for name in velocities:  # a copy's velocity lives on elements; that of the body has its start beside
        assert list(hub.body.component(name))[1:] == list(robot.body.component(name))
    assert list(hub.push["a"].component(push)) == list(robot.push["a"].component(push))


def test_a_team_has_an_agent_for_the_rod_and_one_for_each_robot() -> None:
    """Its central model holds the plans of all, and is scored like the example's own one."""
    task = rod.task(4, steps=7)
    team = rod.team(task)
    assert team.names == list("abcd")
    assert team.physics == task.score
    merged = team.central()
    assert sum(not v.fixed for v in merged.model.component_data_objects(pyo.Var)) > 0
    plans = team.plans_of(merged)
    assert set(plans) == {"rod", *"abcd"}
    assert task.score(plans).goal_distance == pytest.approx(np.hypot(*task.goal[:2]), abs=0.05)


# ----------------------------------------------------------------- hit and catch


@pytest.mark.parametrize("kicks", range(3))
def test_the_schedule_brings_the_puck_to_the_goal_by_the_law_of_the_score(kicks: int) -> None:
    now = game.game(0, kicks=kicks)
    schedule = now.schedule
    wrench = np.column_stack([schedule.force, np.zeros(now.steps)])
    start = PlannedBody(np.array([game.START[:2]]), np.eye(2)[None], np.zeros(3))
    assert now.score.simulate(start, wrench).position == pytest.approx(schedule.place, abs=1e-9)
    assert schedule.place[-1] == pytest.approx(game.GOAL)
    assert schedule.speed[-1] == pytest.approx((0.0, 0.0), abs=1e-9)
    meeting = sum(schedule.kicks[1][1:]) // 2
    assert schedule.place[meeting + 1] == pytest.approx(game.KICKS[kicks][1])
    pushed = {k for _, first, last in schedule.kicks for k in range(first, last)}
    assert set(np.flatnonzero(np.abs(schedule.force).sum(axis=1))) == pushed


# --------------------------------------------------------------------
# The ball and its quadrotors: their models, their sizes, their tasks, and a plan for all of them.


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


# --------------------------------------------------------------------
# The truss robot rolls over on a tube of one length, and motors can follow its shapes.


Figure = pytest.importorskip("matplotlib.figure").Figure


def lengths_of(nodes: np.ndarray) -> np.ndarray:
    return np.stack(
        [
            np.linalg.norm(nodes[:, truss.NODES.index(i)] - nodes[:, truss.NODES.index(j)], axis=1)
            for i, j in truss.EDGES
        ],
        axis=1,
    )


@pytest.mark.ipopt
@pytest.mark.slow
def test_the_truss_walks_and_motors_follow(tmp_path):
    m, result = truss.search(steps=30, backend=None, tee=False)
    assert result.quality is rcp.Quality.OPTIMAL
    plan = m.truss.trajectory()
    assert plan.verify().largest_violation < 1e-5
    nodes, lengths, _, presses = truss.plan_of(m)
    assert lengths.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-6)
    assert lengths_of(nodes) == pytest.approx(lengths, abs=1e-6)
    assert nodes[-1, :, 0].mean() - nodes[0, :, 0].mean() == pytest.approx(1.0, abs=1e-6)
    assert nodes[..., 1].min() > -1e-6
    # It rolls over: other nodes carry it in the end.
    assert {k for k in range(3) if presses[0, k] > 1.0} == {0, 1}
    assert {k for k in range(3) if presses[-1, k] > 1.0} != {0, 1}
    tracking = truss.track(m)
    assert tracking.error < 0.05
    assert tracking.reached.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-9)
    assert all(np.abs(after - before).max() <= 2 * 0.04 + 1e-9 for before, after in pairwise(tracking.reached))
    assert tracking.progress > 0.8
    figure = Figure(layout="constrained")
    truss.draw(figure, m)
    figure.savefig(tmp_path / "truss.png")
    assert (tmp_path / "truss.png").stat().st_size > 10_000
    assert truss.animate(m, tmp_path / "truss.gif").stat().st_size > 10_000


@pytest.mark.casadi
def test_nodes_walk_as_a_team():
    """What the team agrees on holds by the equations of motion and Coulomb's law, recomputed."""
    m, result = truss.search(together=True, steps=30, backend=None, tee=False)
    score = result.score
    assert result.success
    assert score.strict
    assert score.distance < 1e-6
    _, lengths, _, presses = truss.plan_of(m)
    assert lengths.sum(axis=1) == pytest.approx(truss.TUBE, abs=1e-4)
    assert {k for k in range(3) if presses[0, k] > 1.0} == {0, 1}
    spoilt = {name: values.copy() for name, values in m.plans.items()}
    spoilt["ground['a'].press"][3] += 5.0
    found = truss.WalkPhysics(truss.Walk(30))({"robot": spoilt})
    assert (found.practical, found.force) == (False, pytest.approx(5.0, abs=0.1))
