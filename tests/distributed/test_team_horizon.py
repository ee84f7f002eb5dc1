"""Receding horizons of teams: moved ahead exactly, and in many rounds the same as planning anew."""

from itertools import combinations

import numpy as np
import pyomo.environ as pyo
import pytest
from carts import GRID, pulling_team
from pushing_team import task, team
from test_engine_laws import FragileEngine

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.local_problem import later_times
from pyrobocop_pyomo.errors import TeamError

pytestmark = pytest.mark.casadi
PRECISE = rcp.teams.Hub(rounds=40, tolerance=1e-9, penalties=None)
H = GRID["duration"] / GRID["elements"]


def forces(horizon: rcp.teams.TeamHorizon) -> np.ndarray:
    return np.array([plan["pull[{robot}].f"] for plan in horizon.read("pull[{robot}].f").values()])


def world(horizon: rcp.teams.TeamHorizon, push: float = 0.0) -> dict[str, dict[str, float]]:
    """The cart after the first element of all forces and of a push that nobody planned."""
    start, f = horizon.predicted(0), forces(horizon)[:, 0]
    u = start["cart"]["body.u"] + H * (f.sum() + push) / 2.0
    worn = {name: {"me.worn": start[name]["me.worn"] + H * f[i]} for i, name in enumerate("ab")}
    return {"cart": {"body.u": u, "body.q": start["cart"]["body.q"] + H * u}, **worn}


def test_a_step_with_many_rounds_is_planning_anew() -> None:
    with rcp.teams.TeamHorizon(pulling_team(), PRECISE, rounds=40) as horizon:
        first = horizon.plan()
        assert (first.number, first.disagreement.max() < 1e-6) == (0, True)
        measured = world(horizon, push=1.5)
        tick = horizon.step(measured)
        assert (tick.number, len(tick.rounds), dict(tick.failures)) == (1, 40, {})
        found = forces(horizon)
    cart = measured["cart"]
    anew = pulling_team(cart["body.q"], cart["body.u"]).solve(PRECISE, progress=False)
    expected = np.array([anew.agreed["pull[a].f"], anew.agreed["pull[b].f"]])
    assert np.abs(found - expected).max() < 1e-5


def test_a_team_that_agrees_stays_where_it_is() -> None:
    """However many rounds follow: what rounding leaves of their differences is not extrapolated."""
    result = pulling_team().solve(rcp.teams.Hub(rounds=80, tolerance=0.0, penalties=None, closing=None), progress=False)
    objectives = np.array([made.objective for made in result.rounds[20:]])
    assert np.ptp(objectives) < 1e-7


def test_disturbances_are_answered() -> None:
    random = np.random.default_rng(1)
    with rcp.teams.TeamHorizon(pulling_team(), PRECISE, rounds=5) as horizon:
        horizon.plan()
        path = []
        for _ in range(16):
            measured = world(horizon, push=0.05 * random.normal())
            path.append(measured["cart"]["body.q"])
            assert not horizon.step(measured).failures
    assert abs(path[-1]) < 0.1
    assert max(np.abs(path[8:])) < max(np.abs(path[:8]))


def test_a_robot_leaves_and_comes_back() -> None:
    """With many rounds, those that are left plan as a team that never knew it."""
    whole = pulling_team()
    with rcp.teams.TeamHorizon(whole, PRECISE, rounds=40) as horizon:
        horizon.plan()
        measured = world(horizon)
        horizon.step(measured)
        horizon.change_team(whole.without("b"))
        cart = measured["cart"]
        horizon.step({name: measured[name] for name in ("cart", "a")}, elements=0)
        alone = forces(horizon)
        horizon.change_team(whole)
        horizon.step(measured, elements=0)
        together = forces(horizon)
    here = pulling_team(cart["body.q"], cart["body.u"])
    for found, whole in [(alone, here.without("b")), (together, here)]:
        anew = whole.solve(PRECISE, progress=False)
        expected = np.array([anew.agreed[f"pull[{name}].f"] for name in whole.names])
        assert np.abs(found - expected).max() < 1e-5
    assert np.abs(alone).max() > np.abs(together).max()


def test_who_left_has_to_have_been_there() -> None:
    with pytest.raises(TeamError, match="no robot 'c' is in the team; there are a, b"):
        pulling_team().without("c")
    with pytest.raises(TeamError, match="a team needs robots"):
        pulling_team().without("a", "b")


@pytest.mark.parametrize("deaths", [((9, 14), (11,)), ((30,), (31, 35))])
def test_a_dead_worker_changes_nothing(deaths: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
    """Where an agent starts after a step belongs to its state."""

    def play(engine: rcp.teams.Engine) -> tuple[list[list[float]], int]:
        with rcp.teams.TeamHorizon(pulling_team(), rcp.teams.Hub(rounds=4), engine=engine, rounds=2) as horizon:
            horizon.plan()
            history = []
            for push in (0.5, -0.3, 0.2, 0.0):
                horizon.step(world(horizon, push))
                history.append(forces(horizon).ravel().tolist())
            return history, sum(engine.deaths.values())

    serial, none = play(rcp.teams.SerialEngine())
    fragile, dead = play(FragileEngine(deaths))
    assert fragile == serial
    assert none == 0
    assert dead >= 2


def test_models_that_cannot_be_moved_ahead() -> None:
    def model(**grid: object) -> pyo.ConcreteModel:
        m = pyo.ConcreteModel(name="cart")
        m.body = rcp.PhaseBlock(**{**GRID, **grid})
        m.body.q = rcp.State(initial=0.0)
        return m

    later = later_times(model())
    assert len(later) == GRID["elements"]
    assert later[0.0] == pytest.approx(H)
    with pytest.raises(TeamError, match="'cart': .* apart. A plan is moved ahead by elements of equal length"):
        later_times(model(scheme="radau", stages=3))
    with pytest.raises(TeamError, match="fixed duration"):
        later_times(model(duration=rcp.Duration(bounds=(1.0, 3.0))))
    with pytest.raises(TeamError, match="fixed duration"):
        later_times(pyo.ConcreteModel(name="nothing"))
    two = model()
    two.other = rcp.PhaseBlock(duration=1.0, elements=8, scheme="implicit_euler")
    with pytest.raises(TeamError, match="phases 'body' and 'other' have different times"):
        later_times(two)


def test_what_is_measured_is_checked() -> None:
    with pytest.raises(TeamError, match="rounds = 0"):
        rcp.teams.TeamHorizon(pulling_team(), rounds=0)
    with rcp.teams.TeamHorizon(pulling_team(), rcp.teams.Hub(rounds=2)) as horizon:
        with pytest.raises(TeamError, match="no plan to go on from"):
            horizon.step({})
        horizon.plan()
        good = horizon.predicted()
        assert {name: list(states) for name, states in good.items()} == {
            "cart": ["body.q", "body.u"],
            "a": ["me.worn"],
            "b": ["me.worn"],
        }
        with pytest.raises(TeamError, match=r"agent 'a': no measured value of 'me\.worn'"):
            horizon.step({"cart": good["cart"], "b": good["b"]})
        with pytest.raises(TeamError, match=r"agent 'cart': the measured 'body\.q' is nan"):
            horizon.step({**good, "cart": {"body.q": float("nan"), "body.u": 0.0}})
        with pytest.raises(TeamError, match=r"agent 'a': 'me\.v' is no state with a fixed initial value"):
            horizon.step({**good, "a": {"me.v": 0.0}})
        with pytest.raises(TeamError, match="no agent 'z'"):
            horizon.step({**good, "z": {}})
        horizon.step(good)


@pytest.mark.slow
def test_robots_that_push_go_on_after_a_disturbance() -> None:
    """Contacts are moved ahead: warm solves take few iterations."""
    from pushing_team import pushing_team

    with rcp.teams.TeamHorizon(pushing_team(steps=10), rcp.teams.Hub(rounds=15), rounds=2, mu=2e-3) as horizon:
        horizon.plan()
        for _ in range(3):
            measured = horizon.predicted()
            measured["rod"]["body.ux"] += 0.01
            for name in "ab":
                measured[name] = {key: value for key, value in measured[name].items() if key.startswith("me.")}
            tick = horizon.step(measured)
            assert not tick.failures
        counts = [iterations for record in tick.rounds for _, iterations, _ in record.reports.values()]
        assert np.mean(counts) < 40


def test_robots_keep_apart_by_themselves() -> None:
    """No closing step follows that would do it, as it does where a team plans once."""
    whole = team(task(seed=3, robots=3, steps=6))
    assert all(spec.neighbours == 0 for spec in whole.problem_specs())
    with rcp.teams.TeamHorizon(whole, rounds=2) as horizon:
        horizon.plan()
        step = horizon.step(horizon.predicted())
        places = [np.stack([plan["me.x"], plan["me.y"]]) for plan in horizon.read("me.x", "me.y").values()]
    assert not step.failures
    for one, other in combinations(places, 2):
        assert np.linalg.norm(one - other, axis=0).min() > 0.2
