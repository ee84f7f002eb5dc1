"""Cases of several vehicles: what their files say, and plans that are checked by independent distances."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles import vehicles_in_turn
from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError

MAP = """agents:
  - start: [1, 2, 1.57]
    name: agent0
    goal: [20, 3, 0]
  - goal: [5, 6, -1.57]
    name: agent1
    start: [15, 9, 3.14]
map:
  dimensions: [30, 30]
  obstacles:
    - [10, 20.5]
"""


def test_a_map_is_read(tmp_path: Path) -> None:
    (tmp_path / "yard.yaml").write_text(MAP)
    case = rcp.scenes.VehiclesCase.read(tmp_path / "yard.yaml", disc_radius=0.5)
    np.testing.assert_allclose(case.starts, [(1, 2, -1.57), (15, 9, -3.14)])
    np.testing.assert_allclose(case.goals, [(20, 3, 0), (5, 6, 1.57)])
    (part,) = case.obstacles["obstacle 1"]
    assert part.radius == 0.5
    np.testing.assert_allclose(part.vertices, [(10, 20.5)])


def test_numbers_of_several_vehicles_are_those_of_one_with_a_count(tmp_path: Path) -> None:
    numbers = [2, 5, 5, 0, 15, 5, 0, 5, 9, 1, 15, 9, 1, 1, 3, 20, 20, 21, 20, 20, 21]
    (tmp_path / "case.csv").write_text(",".join(map(str, numbers)))
    case = rcp.scenes.VehiclesCase.read(tmp_path / "case.csv")
    np.testing.assert_allclose(case.starts, [(0, 0, 0), (0, 4, 1)])
    np.testing.assert_allclose(case.goals, [(10, 0, 0), (10, 4, 1)])
    (part,) = case.obstacles["obstacle 1"]
    np.testing.assert_allclose(part.vertices.min(axis=0), [15, 15])


def test_what_is_no_case_is_refused(tmp_path: Path) -> None:
    (tmp_path / "case.csv").write_text("3,1,2,0")
    with pytest.raises(ObstacleError, match="4 numbers; expected the number of vehicles"):
        rcp.scenes.VehiclesCase.read(tmp_path / "case.csv")
    with pytest.raises(ObstacleError, match="1 starts, but 2 goals"):
        rcp.scenes.VehiclesCase("yard", [(0, 0, 0)], [(1, 0, 0), (9, 9, 0)], {})
    case = rcp.scenes.VehiclesCase("yard", [(0, 0, 0), (1, 0, 0)], [(20, 0, 0), (9, 9, 0)], {})
    with pytest.raises(ObstacleError, match="at their starts vehicles 1 and 2 overlap"):
        rcp.scenes.plan_vehicles(case)


@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize("exactly", [False, True], ids=["beside", "exactly"])
def test_vehicles_that_change_places_keep_apart(exactly: bool) -> None:
    """One in the way of the other: the order and the departures follow from that.

    Where each goes exactly where the other one stands, one of them moves aside first.
    """
    starts, goals = [(-9.0, 0.0, 0.0), (9.0, 0.5, math.pi)], [(9.0, 4.0, 0.0), (-9.0, 0.5, math.pi)]
    if exactly:
        goals = starts[::-1]
    plan = rcp.scenes.plan_vehicles(rcp.scenes.VehiclesCase("lane", starts, goals, {}))
    assert plan.safe
    assert [move.vehicle for move in plan.moves].count(plan.moves[0].vehicle) == 1 + exactly
    times = np.arange(0.0, plan.duration, 0.05)
    poses, shape = plan.poses_at(times), rcp.scenes.ParkingCar().shape
    np.testing.assert_allclose(poses[:, 0], starts, atol=1e-6)
    np.testing.assert_allclose(plan.poses_at([plan.duration + 5.0])[:, 0, :2], np.array(goals)[:, :2], atol=1e-6)
    for one, other in zip(*poses, strict=True):
        placed = shape.placed(rcp.planar_pose(*one.tolist()))
        distance = rcp.scenes.signed_distance(shape, placed, rcp.planar_pose(*other.tolist())).distance
        assert distance >= 0.05 - 1e-3


# A dead end from the left: its inner place and its mouth, and a yard before it.
DEAD_END = {
    "above": [rcp.Polytope.box(20, 1, center=(10, 2.0), name="above")],
    "below": [rcp.Polytope.box(20, 1, center=(10, -2.0), name="below")],
    "end": [rcp.Polytope.box(1, 5, center=(20.5, 0), name="end")],
}


def test_who_goes_farther_into_a_dead_end_goes_first() -> None:
    starts = [(-30.0, 0.0, 0.0), (-15.0, 0.0, 0.0)]
    mouth, inside = (3.0, 0.0, 0.0), (14.0, 0.0, 0.0)
    car = rcp.scenes.ParkingCar()
    for goals, order in (([mouth, inside], [1, 0]), ([inside, mouth], [0, 1])):
        case = rcp.scenes.VehiclesCase("dead end", starts, goals, DEAD_END)
        assert list(vehicles_in_turn._with_ways(case, car, [], [0, 1], [0, 1])) == order
    # Who stands inside already has no way out while the mouth is taken.
    case = rcp.scenes.VehiclesCase("dead end", [mouth, inside], starts, DEAD_END)
    assert list(vehicles_in_turn._with_ways(case, car, [], [0, 1], [0, 1])) == [0]
    assert list(vehicles_in_turn._with_ways(case, car, [0], [1], [1])) == [1]


@pytest.mark.parametrize("blocked_by", [0, 1, 2])
def test_a_vehicle_that_finds_no_way_goes_before_as_few_as_possible(
    blocked_by: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Vehicle 3 gets there only before one of those that come first, since they have farther to go."""
    case = rcp.scenes.VehiclesCase(
        "yard", [(0, 10 * k, 0) for k in range(4)], [(50 - k, 10 * k, 0) for k in range(4)], {}
    )  # fmt: skip

    def alone(case: Any, car: Any, vehicle: int, arrived: Any, *rest: Any) -> Any:
        return None if vehicle == 3 and blocked_by in arrived else (vehicle, None)

    monkeypatch.setattr(vehicles_in_turn, "_alone", alone)
    monkeypatch.setattr(vehicles_in_turn, "_timed", lambda case, car, moves, *rest: [move.vehicle for move in moves])
    before = list(range(blocked_by))
    assert rcp.scenes.plan_vehicles(case) == [*before, 3, *range(blocked_by, 3)]


def test_vehicles_that_shut_each_other_in_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has to be there before the other: no order does, and the search for one ends."""
    case = rcp.scenes.VehiclesCase("yard", [(0, 0, 0), (0, 10, 0)], [(50, 0, 0), (40, 10, 0)], {})
    monkeypatch.setattr(
        vehicles_in_turn, "_alone",
        lambda case, car, vehicle, arrived, *rest: None if arrived else (vehicle, None),
    )  # fmt: skip
    monkeypatch.setattr(vehicles_in_turn, "_moves_aside", lambda *given: None)
    with pytest.raises(InitialGuessError, match=r"of the vehicles \[\d\] none finds a way"):
        rcp.scenes.plan_vehicles(case)


@pytest.mark.casadi
def test_a_film_has_each_vehicle_where_the_plan_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(vehicles_in_turn, "animate_scene", lambda *arguments, **options: drawn.extend(arguments))
    yard = rcp.scenes.VehiclesCase("yard", [(-8, 0, 0), (8, 4, math.pi)], [(8, 0, 0), (-8, 4, math.pi)], {})
    plan = rcp.scenes.plan_vehicles(yard)
    plan.animate()
    times, vehicles, *_ = drawn
    assert (times[0], len(vehicles)) == (0.0, 2)
    assert times[-1] >= plan.duration
    for vehicle, poses in zip(vehicles, plan.poses_at(times), strict=True):
        np.testing.assert_allclose(vehicle.translation, poses[:, :2])
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        np.testing.assert_allclose(vehicle.rotation[:, :, 0], ahead)
        np.testing.assert_allclose(np.linalg.det(vehicle.rotation), 1.0)
