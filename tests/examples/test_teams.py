"""Examples of teams: their models, their sizes, and what their tasks are."""

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


def size(model: pyo.ConcreteModel) -> int:
    return sum(1 for _ in model.component_data_objects(pyo.Var))


def test_tasks_are_drawn_as_described() -> None:
    """Angle, distance, direction, turn, robots, in this order; robots near the rod and apart from each other."""
    random = np.random.default_rng(7)
    angle, distance, direction = (random.uniform(*ends) for ends in ((-np.pi, np.pi), (0.3, 1.0), (-np.pi, np.pi)))
    turn = random.uniform(-np.pi / 3, np.pi / 3)
    task = rod.task(7)
    assert task.start == (0.0, 0.0, angle)
    assert task.goal == pytest.approx((distance * np.cos(direction), distance * np.sin(direction), angle + turn))
    for robots in (4, 16, 32):
        for seed in range(5):
            task = rod.task(seed, robots)
            places = np.array(list(task.robots.values()))
            assert len(places) == robots
            gaps = [task.rod.shape.gap_to_disc(0.1, x, y, task.start).gap for x, y in places.tolist()]
            assert 0.099 < min(gaps) < max(gaps) < 0.6
            distances = np.linalg.norm(places[:, None] - places[None, :], axis=-1) + 9 * np.eye(robots)
            assert distances.min() > 0.35


def test_the_model_of_a_robot_or_a_quadrotor_does_not_grow_with_the_team() -> None:
    for n in (2, 4, 16):
        assert size(rod.robot(rod.task(0, n), "b")) == 1015
        assert size(rod.rod(rod.task(0, n))) == 6 * 43 + 3 * n * 42
    for n in (2, 12):
        assert size(sphere.quadrotor(sphere.task(0, n), "b")) == 9 * 43 + (6 + 3 + 6 + 6 + 4) * 42
        assert size(sphere.sphere(sphere.task(0, n))) == 18 * 43 + (4 + 6 * n) * 42


MODELS = {
    "rod": (rod.task(3), rod.rod, rod.robot, ("qx", "qy", "qth"), ("ux", "uy", "uth"), "fx"),
    **{
        f"ball of {robots}": (
            sphere.task(3, robots), sphere.sphere, sphere.quadrotor, ("qx", "qy", "qz"),
            ("ux", "uy", "uz", "wx", "wy", "wz"), "mz",
        )
        for robots in (3, 12)
    },
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


def test_the_score_reads_what_the_models_hold() -> None:
    """The initial guess is scored: it misses the goal, because nobody pushes, by as much as the goal is away."""
    task = rod.task(2)
    score = task.score(rod.plans_of(rod.build(2)))
    assert not score.practical
    assert score.goal_distance == pytest.approx(np.hypot(*task.goal[:2]), abs=0.05)
    time, bodies = task.score.paths(rod.plans_of(rod.build(2)))
    assert len(time) == 43
    assert [body.name for body in bodies] == ["", "a", "b", "c", "d"]
    assert isinstance(bodies[0], rcp.scenes.BodyPath)


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


def test_the_schedule_is_the_start_of_every_model() -> None:
    now = game.game(1)
    hub, a, b = game.puck(now), game.player(now, "a"), game.player(now, "d")
    for phase in (hub.body, a.body, a.me, b.me):
        phase.check()
    ends = [model.body.qx[model.body.time.last()].value for model in (hub, a, b)]
    assert ends == pytest.approx([game.GOAL[0]] * 3)
    # The kicker touches where it kicks; a player of the other row stays where it is.
    first = now.schedule.kicks[0][1]
    assert abs(list(a.me.gap.values())[first].value) < 1e-4
    assert list(a.me.c.values())[first].value == pytest.approx(np.linalg.norm(now.schedule.force[first]))
    assert {round(v.value, 9) for v in b.me.x.values()} == {round(now.players["d"][0], 9)}


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


def test_nodes_that_roll_have_the_lengths_that_they_were_given_and_do_not_slip():
    # An equilateral triangle that turns over its front foot, with edges that differ a little from the planned ones.
    foot = np.array([truss.SIDE, 0.0])
    corners = np.array([[0.0, 0.0], foot, [truss.SIDE / 2, truss.HEIGHT]]) - foot
    angles = np.linspace(0.0, -2 * np.pi / 3, 13)
    turns = np.array([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in angles])
    planned = corners @ turns + foot
    presses = np.tile([0.0, 47.0, 1.0], (13, 1))
    lengths = lengths_of(planned) + np.random.default_rng(1).uniform(-0.03, 0.03, (13, 3))
    nodes = truss.rolled(lengths, planned, presses)
    assert lengths_of(nodes) == pytest.approx(lengths, abs=1e-12)
    assert nodes[:, 1] == pytest.approx(np.tile(foot, (13, 1)), abs=1e-12)
    exact = truss.rolled(lengths_of(planned), planned, presses)
    assert exact == pytest.approx(planned, abs=1e-9)


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
