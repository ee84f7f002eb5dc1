"""What a team refuses before any solve, how its models are merged, and that failures stay with their agent."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pyomo.environ as pyo
import pytest
from pushing_team import pushing_team
from quadratic_agents import crossing, middle, quadratic, random_problems

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.team_result import Checkpoint
from pyrobocop_pyomo.errors import SolveFailed, TeamError
from pyrobocop_pyomo.teams import Hub, Sova

pytestmark = pytest.mark.casadi

SHARED = [rcp.Shared("v")]


def robots(count: int = 2, n: int = 3) -> list[rcp.Agent]:
    return [rcp.Agent(f"r{i}", quadratic, *problem) for i, problem in enumerate(random_problems(count, n, 5))]


def with_units(unit: str) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(3), initialize=0.0, units=getattr(pyo.units, unit))
    m.cost = pyo.Objective(expr=sum((x / getattr(pyo.units, unit)) ** 2 for x in m.v.values()))
    return m


def nothing() -> None:
    return None


def hopeless() -> pyo.ConcreteModel:
    m = middle(3)
    m.cost = pyo.Objective(expr=m.v[0])
    m.other = pyo.Constraint(expr=sum(m.v.values()) == 2.0)
    return m


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"robots": []}, "needs robots"),
        ({"robots": [*robots(1), *robots(1)]}, "2 agents have the name 'r0'"),
        ({"robots": robots(), "hub": rcp.Agent("r1", middle, 3)}, "2 agents have the name 'r1'"),
        (
            {"robots": robots(), "shared": []},
            "share something.*keep out of each other's way need no team.*ObstacleAvoidanceBlock",
        ),
        ({"robots": robots(), "shared": [rcp.Shared("push[{robot}]")]}, "shared with a hub"),
    ],
)
def test_a_team_that_makes_no_sense_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(TeamError, match=message):
        rcp.Team(**{"shared": SHARED, **arguments})


@pytest.mark.parametrize("name", ["load", "name", "clone", "objective", "keep_apart", ""])
def test_a_name_that_models_have_for_something_else_is_refused(name: str) -> None:
    with pytest.raises(TeamError, match=f"no agent can be called '{name}'" if name else "needs a name"):
        rcp.Agent(name, middle, 3)


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        (Hub, {"rounds": 0}, "rounds = 0; expected at least 1"),
        (Sova, {"until": "perfect"}, "'strict', 'practical', 'rounds'"),
    ],
)
def test_rounds_without_an_end_are_refused(method, arguments: dict, message: str) -> None:
    with pytest.raises(TeamError, match=f"{method.__name__}: .*{message}"):
        method(**arguments)


@pytest.mark.parametrize("method", ["hub", "sova"])
def test_a_force_that_is_not_shared_is_refused(method: str) -> None:
    """The hub would move by forces that nobody exerts."""
    team = pushing_team(2, 4)
    without = replace(team, shared=[shared for shared in team.shared if not shared.of_one_robot])
    with pytest.raises(TeamError, match=r"'push\[a\]\.fx', .*: a control in the models of the hub and of 'a' that"):
        without.solve(method)


@dataclass(frozen=True)
class Judge:
    """A physics that gives every plan the same score."""

    score: SimpleNamespace  # which says two words
    robot_components: tuple = ("v",)
    hub_components: tuple = ()

    def __call__(self, plans: object) -> SimpleNamespace:
        return self.score


@pytest.mark.parametrize(
    ("until", "strict", "practical"),
    [
        ("strict", True, True), ("strict", False, True), ("practical", True, False), ("practical", False, True),
        ("rounds", True, True), ("rounds", False, False),
    ],
)  # fmt: skip
def test_what_ends_the_rounds_is_a_success(until: str, strict: bool, practical: bool) -> None:
    team = rcp.Team(robots=robots(), shared=SHARED, physics=Judge(SimpleNamespace(strict=strict, practical=practical)))
    result = team.solve(Sova(rounds=2, until=until))
    ended_early = len(result.rounds) == 1
    assert ended_early is (strict if until == "strict" else (strict or practical) and until == "practical")
    assert result.success is (strict or practical)
    if result.success:
        result.raise_for_failure()
    else:
        with pytest.raises(SolveFailed):
            result.raise_for_failure()


@pytest.mark.parametrize("penalty", [0.0, -1.0, [1.0, 0.0], [[1.0, 2.0], [2.0, 1.0]], "high"])
def test_a_penalty_that_is_not_positive_is_refused(penalty) -> None:
    with pytest.raises(TeamError, match="not positive|one for each variable|expected numbers"):
        rcp.Shared("v", penalty=penalty)


@pytest.mark.parametrize(
    ("agents", "shared", "message"),
    [
        (robots(), rcp.Shared("w"), "'r0': its model has no component 'w'"),
        (robots(), rcp.Shared("cost"), "no variable and no block"),
        (robots(), rcp.Shared("v", "v"), "shared twice"),
        (robots(), rcp.Shared("v", penalty=(1.0, 2.0)), "its penalty is for 2"),
        ([*robots(1), rcp.Agent("long", middle, 5)], rcp.Shared("v"), "3 values .* and 5 in that of 'long'"),
        ([rcp.Agent("a", with_units, "m"), rcp.Agent("b", with_units, "s")], rcp.Shared("v"), "in m .* and in s"),
        ([rcp.Agent("a", nothing), *robots(1)], rcp.Shared("v"), "'nothing' returned NoneType"),
    ],
)
def test_models_that_do_not_fit_are_refused_before_any_solve(agents, shared: rcp.Shared, message: str) -> None:
    with pytest.raises(TeamError, match=message):
        rcp.Team(robots=agents, shared=[shared]).solve()


def test_an_agent_without_a_first_point_is_named() -> None:
    with pytest.raises(TeamError, match="'bad' found no point in its first round.*builder initialize its phases"):
        rcp.Team(robots=[*robots(1), rcp.Agent("bad", hopeless)], shared=SHARED).solve()


def test_methods_and_engines_are_looked_up() -> None:
    team = rcp.Team(robots=robots(), shared=SHARED)
    with pytest.raises(TeamError, match="'hub', 'sova'"):
        team.solve("gossip")
    with pytest.raises(TeamError, match="needs a hub"):
        team.solve(Hub())


def test_a_team_that_does_not_agree_raises_with_its_numbers() -> None:
    result = rcp.Team(robots=robots(), shared=SHARED).solve(Sova(rounds=2))
    assert not result.success
    assert "NO PLAN THAT HOLDS: the agents do not agree within the tolerance. 2 rounds" in repr(result)
    with pytest.raises(SolveFailed, match="2 rounds"):
        result.raise_for_failure()


def test_an_interrupted_team_keeps_its_last_round() -> None:
    team = rcp.Team(robots=robots(), shared=SHARED)

    def interrupt(record: rcp.teams.Round) -> None:
        if record.number == 2:
            raise KeyboardInterrupt

    result = team.solve(Sova(rounds=9), on_round=interrupt)
    assert [record.number for record in result.rounds] == [0, 1, 2]
    assert set(result.values) == {"r0", "r1"}


def test_rounds_go_on_from_a_file_as_if_never_stopped(tmp_path) -> None:
    team = rcp.Team(hub=rcp.Agent("hub", middle, 3), robots=robots(3), shared=SHARED)
    whole = team.solve(Hub(rounds=8, tolerance=0.0))
    path = tmp_path / "team.npz"
    stopped = team.solve(Hub(rounds=8, tolerance=0.0), checkpoint=path, on_round=lambda record: record.number < 3)
    assert len(stopped.rounds) == 4
    rest = team.solve(Hub(rounds=8, tolerance=0.0), checkpoint=path)
    assert [record.number for record in rest.rounds] == [4, 5, 6, 7]
    for name, values in whole.values.items():
        assert np.array_equal(values, rest.values[name])
    with pytest.raises(TeamError, match="all 8 rounds are done"):
        team.solve(Hub(rounds=8, tolerance=0.0), checkpoint=path)
    with pytest.raises(TeamError, match="another team"):
        team.solve(Hub(rounds=9, tolerance=0.0), checkpoint=path)


def test_a_merged_model_has_one_set_of_shared_variables() -> None:
    merged = rcp.Team(robots=robots(3), shared=SHARED).central()
    assert len({id(variable) for variable in merged.model.component_data_objects(pyo.Var)}) == 3
    assert merged.find("v", "r2")[1] is merged.find("v", "r0")[1]


def drones(physics: Judge | None = None, components: tuple[str, ...] = ("me.x", "me.y"), count: int = 3) -> rcp.Team:
    agents = [rcp.Agent(f"d{i}", crossing, i, count) for i in range(count)]
    apart = rcp.KeepApart(components, distance=0.5)
    return rcp.Team(robots=agents, shared=[rcp.Shared("pace")], keep_apart=apart, physics=physics)


FINE = Judge(SimpleNamespace(strict=True, practical=True), robot_components=("me.u",))


@pytest.mark.parametrize(
    ("physics", "options"),
    [(None, {"tolerance": 1.0, "rounds": 2}), (FINE, {"rounds": 30}), (FINE, {"closing": None, "rounds": 2})],
)
def test_a_success_keeps_robots_apart_in_the_plans_that_are_handed_out(physics, options: dict) -> None:
    team = drones(physics)
    result = team.solve(Sova(**options), progress=False)
    places = [np.array([result.plans[name]["me.x"], result.plans[name]["me.y"]]) for name in team.names]
    least = min(float(np.linalg.norm(a - b, axis=0).min()) for i, a in enumerate(places) for b in places[:i])
    assert result.least_distance == pytest.approx(least)
    assert result.success is (least >= 0.495 and (physics is not None or result.agreement))
    assert ("NO PLAN THAT HOLDS" in repr(result)) is (not result.success)
    assert (f"within {least:.3g} m, and are to keep 0.5 m" in str(result)) is (least < 0.495)
    if physics is not None and options == {"rounds": 30}:
        assert result.success  # by a closing step, though there are no pairs


def test_plans_without_physics_hold_all_variables() -> None:
    team = drones()
    result = team.solve(Sova(rounds=1), progress=False)
    merged = team.central()
    assert rcp.solve(merged.model, progress=False).solved
    for plans in (result.plans, team.plans_of(merged)):
        assert {name: {"pace", "me.x", "me.u"} <= plan.keys() for name, plan in plans.items()} == dict.fromkeys(
            team.names, True
        )
    assert team.keep_apart.holds(team.plans_of(merged), team.names)


@pytest.mark.parametrize(("physics", "component"), [(None, "me.z"), (FINE, "pace"), (None, "cost")])
def test_positions_that_are_not_there_are_refused(physics, component: str) -> None:
    with pytest.raises(TeamError, match=f"agent 'd0': .*'{component}'"):
        drones(physics, ("me.x", component)).solve(progress=False)


def test_a_shared_duration_is_one_number_in_one_model() -> None:
    """Each way costs 4 / T beside T, so that T = 2 for all; two of three would rather go at another pace by 1."""
    agents = [rcp.Agent(f"d{i}", crossing, i, 3, True) for i in range(3)]
    merged = rcp.Team(robots=agents, shared=[rcp.Shared("me.duration", "pace")]).central()
    assert rcp.solve(merged.model, progress=False).objective == pytest.approx(14.0, abs=1e-6)
    for part in merged.parts.values():
        assert part.me.trajectory().duration == pytest.approx(2.0, abs=1e-6)
        assert part.pace.value == pytest.approx(1.0, abs=1e-6)


def test_a_state_that_is_no_number_is_not_gone_on_from(tmp_path) -> None:
    team, path = drones(), tmp_path / "team.npz"
    team.solve(Sova(rounds=3), checkpoint=path, on_round=lambda record: False, progress=False)
    saved = Checkpoint.load(path)
    saved.states["d1"]["x"][0] = np.nan
    saved.save(path)
    with pytest.raises(TeamError, match="'x' of d1 has values that are not finite"):
        team.solve(Sova(rounds=3), checkpoint=path, progress=False)
