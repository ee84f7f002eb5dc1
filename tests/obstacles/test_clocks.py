"""A moving obstacle runs on the time of the plan; what runs on another clock is refused or told."""

from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.obstacles import avoidance_blocks
from pyrobocop_pyomo.obstacles.initial_checks import check_clocks

BOX = rcp.Polytope.box(1, 1)


def drive(**horizon: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.drive = b = rcp.PhaseBlock(**{"elements": 2, "stages": 2, **horizon})
    states(b)
    return m


def states(b: Any) -> None:
    b.x, b.u = rcp.State(initial=0, final=4), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.initialize_straight_lines()


def along(b: Any, t: Any) -> Any:
    return rcp.planar_pose(b.x[t], 0)


def crossing(b: Any, truck: Any, name: str = "avoid", **options: Any) -> Any:
    """A car on a road that a truck crosses."""
    bodies = {"car": rcp.Body(BOX, along), **options.pop("bodies", {})}
    obstacles = (
        {"truck": rcp.Body(BOX, truck)} if truck is not None else {"wall": rcp.Polytope.box(1, 1, center=(9, 9))}
    )
    b.add_component(
        name, rcp.ObstacleAvoidanceBlock(b.time, bodies=bodies, obstacles=obstacles, **{"clearance": 0.1, **options})
    )
    return b.component(name)


def by_index(b: Any, t: Any) -> Any:
    return rcp.planar_pose(5, 2 * t - 6)


def by_time(b: Any, t: Any) -> Any:
    return rcp.planar_pose(5, 2 * b.time_at(t) - 6)


FREE = {"duration": rcp.Duration(bounds=(1, 20), initial_guess=6)}
NORMALISED = {
    "free duration": FREE,
    "free start": {"duration": 2.0, "start": rcp.Start(bounds=(0, 1), initial_guess=0.5)},
    "free elements": {"duration": 2.0, "free_element_widths": (0.5, 2.0)},
}


def rows(block: Any) -> list[str]:
    return [str(row.expr).replace(f"{block.local_name}.", "") for row in block.component_data_objects(pyo.Constraint)]


@pytest.mark.parametrize("horizon", NORMALISED)
def test_in_a_pose_and_in_a_clearance_t_is_the_time(horizon: str) -> None:
    m = drive(**NORMALISED[horizon])
    first = crossing(m.drive, by_index, "one", clearance=lambda b, t: 0.1 + 0.1 * t)
    second = crossing(m.drive, by_time, "two", clearance=lambda b, t: 0.1 + 0.1 * b.time_at(t))
    assert rows(first) == rows(second) != []
    assert str(first.verify()) == str(second.verify()).replace("two", "one")


@pytest.mark.parametrize(
    ("horizon", "frozen"),
    [
        ({"duration": 2.0}, lambda b, t: pyo.value(t)),
        ({"duration": 2.0}, lambda b, t: t.value if hasattr(t, "value") else t),
        (FREE, lambda b, t: pyo.value(b.time_at(t))),  # at the guess of the duration
    ],
    ids=["value", ".value", "guess"],
)
def test_a_rule_that_freezes_t_is_refused(horizon: dict[str, Any], frozen: Any) -> None:
    m = drive(**horizon)
    with pytest.raises(ObstacleError, match="'truck'.*goes by a number.*pyo.value"):
        crossing(m.drive, lambda b, t: rcp.planar_pose(5, 2 * frozen(b, t) - 6))


def test_the_index_of_a_free_duration_is_refused_in_functions_that_cannot_be_followed() -> None:
    m = drive(**FREE)
    bodies = {
        "car": rcp.Body(rcp.Polytope.box(1, 1), lambda m, t: along(m.drive, t)),
        "truck": rcp.Body(rcp.Polytope.box(1, 1), lambda m, t: rcp.planar_pose(9, pyo.tanh(t))),
    }
    with pytest.raises(ObstacleError, match=r"'truck' depends on t, .*Write b.time_at\(t\)"):
        m.avoid = rcp.ObstacleAvoidanceBlock(m.drive.time, bodies=bodies, clearance=0.1)


def test_a_body_that_nothing_moves_is_told(caplog: pytest.LogCaptureFixture) -> None:
    m = drive(duration=2.0)
    crossing(m.drive, lambda b, t: rcp.planar_pose(5, 0))
    assert "'truck' reads neither a variable nor time" in caplog.text
    assert "shape.placed(pose)" in caplog.text
    caplog.clear()
    m.drive.base = pyo.Var(initialize=5.0)
    m.drive.place = pyo.Param(initialize=5.0, mutable=True)
    crossing(m.drive, lambda b, t: rcp.planar_pose(b.base, 0), name="on_a_base")
    crossing(m.drive, lambda b, t: rcp.planar_pose(b.place, 0), name="at_a_place")
    assert "neither" not in caplog.text


# ---------------------------------------------------------------------------------------- shapes without end that turn


@pytest.mark.parametrize(
    "turning",
    [
        lambda b, t: rcp.planar_pose(0, 9, 0.1 * b.x[t]),
        lambda b, t: rcp.planar_pose(0, 9, t),
        lambda b, t: rcp.planar_pose(0, 9, 0.1 * b.time_at(t)),
    ],
    ids=["state", "index", "time"],
)
def test_shapes_without_end_must_not_turn(turning: Any) -> None:
    ground = rcp.Polytope.from_halfspaces([[0, -1]], [-11], bounded=False, name="ground")
    m = drive(duration=2.0)
    bodies = {"car": rcp.Body(BOX, along)}
    with pytest.raises(ObstacleError, match="'door' turns, and its shape 'ground' has no end.*Cut the shape"):
        m.drive.avoid = rcp.ObstacleAvoidanceBlock(
            m.drive.time, bodies=bodies, obstacles={"door": rcp.Body([BOX, ground], turning)}, clearance=0.1
        )
    m.drive.tilt = pyo.Param(initialize=0.1, mutable=True)
    tilted = rcp.Body(ground, lambda b, t: rcp.planar_pose(0, t, b.tilt))
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(m.drive.time, bodies=bodies, obstacles={"lift": tilted}, clearance=0.1)


# ---------------------------------------------------------------------------------------------- one phase after another


def two_legs(second: Any, truck: Any = by_time, **horizon: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.first = rcp.PhaseBlock(**{"duration": 3.0, "elements": 2, "stages": 2, **horizon})
    states(m.first)
    m.second = rcp.PhaseBlock(duration=2.0, elements=2, stages=2, **second(m))
    m.second.x, m.second.u = rcp.State(final=8), rcp.Control()
    m.second.ode(lambda b, t: {b.x: b.u[t]})
    m.join = rcp.Link(m.first, m.second)
    for phase in (m.first, m.second):
        for t in phase.time:
            phase.x[t] = 0.0
        crossing(phase, truck)
    return m


RESTARTED = {"fixed": {}, "free": FREE}


@pytest.mark.parametrize("horizon", RESTARTED)
def test_an_obstacle_that_jumps_back_where_a_clock_starts_anew_is_refused(horizon: str) -> None:
    m = two_legs(lambda m: {}, **RESTARTED[horizon])
    with pytest.raises(ObstacleError, match="'second' follows 'first'.*'truck' jumps by.*start=first"):
        check_clocks(avoidance_blocks(m))


@pytest.mark.parametrize("horizon", RESTARTED)
def test_a_phase_that_starts_after_the_one_before_is_on_its_clock(horizon: str) -> None:
    m = two_legs(lambda m: {"start": m.first}, **RESTARTED[horizon])
    check_clocks(avoidance_blocks(m))


def test_an_offset_by_hand_is_as_good() -> None:
    m = two_legs(lambda m: {})
    for phase in (m.first, m.second):
        phase.del_component("avoid")
        shift = 0.0 if phase is m.first else 3.0
        crossing(phase, lambda b, t, shift=shift: rcp.planar_pose(5, 2 * (t + shift)))
    check_clocks(avoidance_blocks(m))


def test_an_obstacle_of_the_later_phase_alone_is_told(caplog: pytest.LogCaptureFixture) -> None:
    m = two_legs(lambda m: {})
    m.first.del_component("avoid")
    check_clocks(avoidance_blocks(m))
    assert "its time starts anew at 0, and 'truck' moves with it" in caplog.text


@pytest.mark.ipopt
def test_solve_refuses_before_anything_is_solved() -> None:
    m = two_legs(lambda m: {})
    with pytest.raises(ObstacleError, match="'truck' jumps by"):
        rcp.solve(m)


def legs(start: Any) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()

    def leg(b: Any, k: int) -> None:
        b.x, b.u = rcp.State(initial=0.0 if k == 0 else None, initial_guess=0.0), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t]})
        crossing(b, by_time)

    m.legs = rcp.PhaseBlock([0, 1, 2], duration=2.0, elements=2, stages=2, start=start, rule=leg)
    m.joins = rcp.Link(m.legs)
    return m


def test_one_start_for_all_phases_of_a_sequence_is_refused() -> None:
    m = legs(0.0)
    with pytest.raises(ObstacleError, match=r"legs\[1\].*follows.*legs\[0\].*start=lambda m, k"):
        check_clocks(avoidance_blocks(m))


STARTS = {"phase": lambda m, k: m.legs[k - 1] if k else 0.0, "number": lambda m, k: 2.0 * k}


@pytest.mark.parametrize("start", STARTS)
def test_each_phase_of_a_sequence_may_have_its_start(start: str) -> None:
    m = legs(STARTS[start])
    check_clocks(avoidance_blocks(m))
    assert [m.legs[k].initial_time for k in m.legs] == [0.0, 2.0, 4.0]
    check_clocks(avoidance_blocks(m.clone()))


def test_a_start_that_nothing_ties_to_the_phase_before_is_told(caplog: pytest.LogCaptureFixture) -> None:
    m = two_legs(lambda m: {"start": rcp.Start(bounds=(0, 9), initial_guess=3.0)})
    check_clocks(avoidance_blocks(m))
    assert "nothing ties its start" in caplog.text
    assert "start=first" in caplog.text
    caplog.clear()
    m.after = pyo.Constraint(expr=m.second.start == 3.0)
    check_clocks(avoidance_blocks(m))
    assert "ties" not in caplog.text
