"""`rcp.solve` with obstacles: what it gives back, what it leaves behind, and what it never claims."""

import io
import pickle
from math import pi
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import one_phase
from harness.routes import every_backend
from harness.scenes import ARROW, WALL, avoiding, placed, sampled_distance, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.planning.recovery import PlanStart, Recovery
from pyrobocop_pyomo.solving.solve_result import StopReason

pytestmark = pytest.mark.ipopt

box = rcp.Polytope.box


def around_a_tall_wall(elements: int = 6, **options: Any) -> pyo.ConcreteModel:
    """The guess runs straight through a wall that can be passed below only: the ceiling is lower than its top."""
    m = turning_move(elements=elements, height=0)
    m.move.y.setlb(-6)
    m.move.y.setub(2)
    avoiding(m, obstacles={"wall": box(0.8, 6, center=(2, 2))}, **options)
    return m


def curved(**options: Any) -> pyo.ConcreteModel:
    """Long intervals while the body turns: kept clear at the nodes, it comes closer in between."""
    m = turning_move(elements=3, turn=4.0)
    avoiding(m, **options)
    return m


def closest(m: pyo.ConcreteModel, obstacles: Any) -> float:
    return sampled_distance(m.move.trajectory(), ARROW, obstacles, np.linspace(0.0, 1.0, 400))


@pytest.fixture
def no_recovery(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Recovery, "starts", lambda self: iter([PlanStart("first")]))


# ---------------------------------------------------------------- what comes back


def components(m: pyo.ConcreteModel) -> set[str]:
    return {each.name for each in m.component_objects()}


def test_rounds_are_told_and_shown_and_the_last_rows_hold_at_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    m = curved()
    result = solution(m, progress=True)
    assert result.safe
    assert len(result.rounds) > 1
    for each in result.rounds:
        assert each.purpose in result.report()
        assert str(each) in stream.getvalue()
    assert "shortfall" in result.report()
    assert not result.rounds[0].safe
    assert result.rounds[-1].safe
    assert closest(m, [WALL]) >= 0.05 - 0.0005 - 1e-9
    assert violation(m) < 1e-6


def violation(m: pyo.ConcreteModel) -> float:
    rows = m.component_data_objects(pyo.Constraint, active=True)
    return max(max(-row.slack(), 0.0) for row in rows)


@pytest.mark.parametrize("how", ["clone", "pickle"])
def test_copies_after_a_solve_with_split_planes(how: str) -> None:
    m = curved()
    rcp.solve(m)
    m.move.avoid.split(*next(iter(m.move.avoid.separations)))
    copy = m.clone() if how == "clone" else pickle.loads(pickle.dumps(m))
    assert set(copy.move.avoid.separations) == set(m.move.avoid.separations)
    inside = m.move.time.at(3)
    m.move.x[inside].set_value(99.0)
    result = rcp.solve(copy)
    assert result.safe
    copy.move.avoid.equations = False
    assert rcp.solve(copy).solved
    assert closest(copy, [WALL]) > 0.0495
    assert m.move.x[inside].value == 99.0


# ---------------------------------------------------------------- interrupted


def test_without_time_the_point_is_kept_and_not_called_safe() -> None:
    m = around_a_tall_wall()
    before = components(m)
    result = rcp.solve(m, time_limit=0.05)
    assert (result.safe, result.stop_reason) == (False, StopReason.TIME_LIMIT)
    assert_best_is_on_the_model(m, result, before)
    with pytest.raises(SolveFailed, match="(?i)time limit"):
        result.raise_for_status()


def assert_best_is_on_the_model(m: pyo.ConcreteModel, result: Any, before: set[str]) -> None:
    assert m.effort.active
    assert components(m) == before
    assert pyo.value(m.effort) == pytest.approx(result.objective, rel=1e-9)
    worst = m.move.avoid.verify().worst
    assert worst.distance == pytest.approx(result.safety.worst.distance, abs=1e-9)


def failing_verify(monkeypatch: pytest.MonkeyPatch, calls: int, error: BaseException) -> None:
    """Have `verify` raise after some calls."""
    verify, count = ObstacleAvoidanceBlockData.verify, iter(range(calls))

    def failing(self: Any, *args: Any, **options: Any) -> Any:
        if next(count, None) is None:
            raise error
        return verify(self, *args, **options)

    monkeypatch.setattr(ObstacleAvoidanceBlockData, "verify", failing)


def test_ctrl_c_between_runs_ends_with_the_best_round(monkeypatch: pytest.MonkeyPatch) -> None:
    m = around_a_tall_wall(4)
    before = components(m)
    monkeypatch.setattr(Recovery, "starts", lambda self: iter([PlanStart("first"), PlanStart("second")]))
    failing_verify(monkeypatch, 1, KeyboardInterrupt())
    result = rcp.solve(m, options={"max_iter": 60})
    monkeypatch.undo()
    assert (result.stop_reason, len(result.rounds)) == (StopReason.INTERRUPTED, 1)
    assert_best_is_on_the_model(m, result, before)


def test_ctrl_c_in_the_first_round_is_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    m = curved()
    before = components(m)
    failing_verify(monkeypatch, 0, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        rcp.solve(m)
    assert components(m) == before


def test_an_error_is_passed_on_with_the_best_point_on_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    m = around_a_tall_wall(4)
    before = components(m)
    monkeypatch.setattr(Recovery, "starts", lambda self: iter([PlanStart("first"), PlanStart("second")]))
    failing_verify(monkeypatch, 1, ArithmeticError("lost"))
    with pytest.raises(ArithmeticError, match="lost"):
        rcp.solve(m, options={"max_iter": 60})
    monkeypatch.undo()
    monkeypatch.setattr(Recovery, "starts", lambda self: iter([PlanStart("first")]))
    assert_best_is_on_the_model(m, rcp.solve(around_a_tall_wall(4), options={"max_iter": 60}), before)


# ---------------------------------------------------------------- where blocks may be


@pytest.mark.parametrize("indexed", [False, True])
def test_two_blocks_in_one_model(indexed: bool) -> None:
    m = turning_move(height=0)
    obstacles = {"low": WALL, "high": box(0.5, 1.5, center=(2.0, 2.4))}
    body = {"arrow": rcp.Body(ARROW, pose=placed)}

    def each(block: Any, name: str) -> None:
        block.build(m.move.time, bodies=body, obstacles={name: obstacles[name]}, clearance=0.05)

    if indexed:
        m.move.avoid = rcp.ObstacleAvoidanceBlock(list(obstacles), rule=each)
    else:
        for name, obstacle in obstacles.items():
            block = rcp.ObstacleAvoidanceBlock(m.move.time, bodies=body, obstacles={name: obstacle}, clearance=0.05)
            m.move.add_component(name, block)
    result = rcp.solve(m)
    assert result.safe
    assert {pair.second for pair in result.safety.body_pairs} == set(obstacles)
    assert closest(m, obstacles.values()) > 0.0495


def test_blocks_that_are_switched_off_take_no_part() -> None:
    straight = rcp.solve(turning_move())
    m = turning_move()
    avoiding(m)
    m.move.avoid.deactivate()
    result = rcp.solve(m)
    assert (result.safe, result.safety, result.rounds) == (None, None, ())
    assert result.objective == pytest.approx(straight.objective, rel=1e-8)
    # In a parent that is switched off: its phase goes with it, a free one stays.
    m.move.avoid.activate()
    m.move.deactivate()
    m.x = pyo.Var(initialize=3)
    m.rest = pyo.Objective(expr=(m.x - 1) ** 2)
    m.effort.deactivate()
    result = rcp.solve(m)
    assert result.safe is None
    assert m.x.value == pytest.approx(1.0)


@every_backend
def test_every_backend_plans_safely(backend: str) -> None:
    m = curved()
    result = solution(m, backend=backend)
    assert result.objective == pytest.approx(rcp.solve(curved()).objective, rel=1e-4)
    assert closest(m, [WALL]) > 0.0495


def test_the_side_that_the_user_chose_is_kept_in_either_order() -> None:
    for side, named in ((-1, ("arrow", "post")), (1, ("post", "arrow"))):
        m = turning_move(height=0)
        avoid = avoiding(m, obstacles={"post": box(0.8, 0.8, center=(2, -0.05 * side))})
        avoid.initialize(directions={named: (0, 1)})
        assert rcp.solve(m).safe
        middle = min(m.move.time, key=lambda t: abs(m.move.x[t].value - 2))
        assert m.move.y[middle].value * side < 0


# ---------------------------------------------------------------- recovery


def closed_in(**options: Any) -> pyo.ConcreteModel:
    """The goal is walled in, and the body too slow to jump through a wall within an interval unseen."""
    m = turning_move(elements=6, stages=1, height=0)
    for control in (m.move.u, m.move.v, m.move.w):
        control.setlb(-12)
        control.setub(12)
    walls = {
        "left": box(0.2, 4, center=(2.5, 0)),
        "right": box(0.2, 4, center=(5.5, 0)),
        "above": box(3, 0.2, center=(4, 2)),
        "below": box(3, 0.2, center=(4, -2)),
    }
    # Where the goal is fixed, this is refused before a solve; where a row asks for it, nobody looks.
    last = m.move.time.last()
    goal = m.move.x[last].value
    m.move.x[last].unfix()
    m.goal = pyo.Constraint(expr=m.move.x[last] == goal)
    avoiding(m, obstacles=walls, **options)
    return m


def test_where_there_is_no_way_none_is_claimed() -> None:
    m = closed_in()
    before = components(m)
    result = rcp.solve(m, time_limit=4, options={"max_iter": 60})
    assert result.safe is False
    assert not result.solved
    assert not any(each.safe and each.quality is not rcp.Quality.INFEASIBLE for each in result.rounds)
    with pytest.raises(SolveFailed, match=r"(?s)turning move: .*No motion was found.*'arrow' and .*required clearance"):
        result.raise_for_status()
    assert "NOT SAFE" in str(result)
    assert "solved" not in str(result)
    assert components(m) == before
    assert m.effort.active


def test_recovery_ends_where_no_obstacle_takes_part() -> None:
    m = turning_move(elements=4, height=0)
    avoiding(m, obstacles={"far": box(1, 1, center=(2, 50))}, broad_phase=5.0)
    m.impossible = pyo.Constraint(expr=m.move.x[0.5] ** 2 <= -1)
    result = rcp.solve(m, options={"max_iter": 60})
    assert [each.purpose for each in result.rounds] == ["from the initial guess"]
    assert result.quality is rcp.Quality.INFEASIBLE
    assert result.safe is False


# ---------------------------------------------------------------- pruned pairs


def test_a_pair_left_out_that_becomes_dangerous_comes_back(no_recovery: None) -> None:
    # Guessed on an arc high above the wall, which is then out of sight; the cheapest motion runs through it.
    m = turning_move(elements=24, height=6)
    avoid = avoiding(m, broad_phase=0.6)
    avoid.initialize()
    assert avoid.record.pruned
    result = rcp.solve(m)
    assert any("restored" in each.purpose for each in result.rounds)
    assert not result.rounds[0].safe
    report = result.safety
    assert report.safe is (closest(m, [WALL]) >= 0.0495)
    assert result.safe
    nodes = [rcp.scenes.signed_distance(ARROW, WALL, placed(m.move, t)).distance for t in m.move.time]
    assert min(nodes) >= 0.05 - 1e-6


# --------------------------------------------------------------------
# `solve` answers for containments as for obstacles: inside at all times, or said not to be.


BAR = rcp.Polytope.box(1, 0.2)


def pose(b, t):
    return rcp.planar_pose(0, b.y[t], b.theta[t])


def turning_over_a_floor(*, ceiling: float = 2.0, obstacle: bool = False) -> pyo.ConcreteModel:
    """A bar makes half a turn between a floor and a ceiling and stays low: steepest between the boundaries."""
    m, b = one_phase("turn", model="half a turn", duration=1.0, elements=3, scheme="implicit_euler")
    b.y, b.theta = rcp.State(initial=0.2, final=0.2), rcp.State(initial=0, final=pi)
    b.climb, b.rate = rcp.Control(), rcp.Control(bounds=(pi, pi))
    b.ode(lambda b, t: {b.y: b.climb[t], b.theta: b.rate[t]})
    m.low = pyo.Objective(expr=b.integral(lambda b, t: b.y[t] ** 2 + 1e-3 * b.climb[t] ** 2))
    b.initialize_straight_lines()
    room = rcp.Polytope.from_halfspaces([[0, -1], [0, 1]], [0, ceiling], bounded=False)
    b.inside = rcp.Containment(b.time, body=BAR, pose=pose, region=room)
    if obstacle:
        far = {"far": rcp.Polytope.box(1, 1, center=(5, 0))}
        b.avoid = rcp.ObstacleAvoidanceBlock(b.time, body=BAR, pose=pose, obstacles=far, clearance=0.05)
    return m


@pytest.mark.parametrize("obstacle", [False, True], ids=["alone", "beside obstacles"])
def test_a_body_is_held_inside_between_the_points(obstacle: bool) -> None:
    m = turning_over_a_floor(obstacle=obstacle)
    result = rcp.solve(m)
    assert result.solved
    assert result.safe
    assert m.turn.inside.verify().safe
    assert not result.rounds[0].safe  # what the points alone give is not
    assert {pair.second for pair in result.safety.body_pairs} == {"side 1", "side 2"} | ({"far"} if obstacle else set())


def test_a_region_that_is_left_between_the_points_is_no_plan() -> None:
    m = turning_over_a_floor(ceiling=1.0)  # the bar reaches 1.02 from corner to corner
    result = rcp.solve(m)
    assert not result.safe
    assert not result.solved
    assert "side" in result.report()
    with pytest.raises(rcp.errors.SolveFailed):
        result.raise_for_status()


def test_a_fixed_pose_outside_is_refused_with_what_is_missing() -> None:
    m = turning_over_a_floor(ceiling=0.25)
    with pytest.raises(rcp.errors.ObstacleError, match=r"'turn.inside': at t = [01].0, .* is 0.05 beyond side 2"):
        rcp.solve(m)


def test_margins_of_the_best_round_are_left_on_the_model() -> None:
    m = turning_over_a_floor()
    inside = m.turn.inside
    assert rcp.solve(m).safe
    asked = {t: pyo.value(inside.margin[t]) for t in inside.times}
    assert max(asked.values()) > 0
    assert max(row.uslack() for row in inside.inside.values()) >= 0
    assert min(row.uslack() for row in inside.inside.values()) > -1e-6
    again = rcp.solve(m)  # starts without margins, and finds them anew
    assert again.safe


def test_blocks_with_the_same_names_are_tightened_each_by_its_own_report() -> None:
    m = turning_over_a_floor(ceiling=1.5)
    b = m.turn
    floor = rcp.Polytope.from_halfspaces([[0, 1]], [0], bounded=False)
    far = rcp.Polytope.box(1, 1, center=(9, 0))
    b.del_component("inside")
    b.near = rcp.ObstacleAvoidanceBlock(b.time, body=BAR, pose=pose, obstacles=[floor], clearance=0.05)
    b.far = rcp.ObstacleAvoidanceBlock(b.time, body=BAR, pose=pose, obstacles=[far], clearance=0.05)
    result = rcp.solve(m)
    assert result.safe
    assert len(result.rounds) > 1
    sagging = max(pyo.value(b.near.margin[index]) for index in b.near.separations)
    assert sagging > 0
    # The far one is asked for its own sag only; what the near one missed would add 0.027.
    assert max(pyo.value(b.far.margin[index]) for index in b.far.separations) < 0.01
