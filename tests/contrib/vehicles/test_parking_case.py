"""Parking cases: what a file says, whatever the orientation of its rings, its origin and the turns of its headings."""

import math
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles import vehicles_in_turn
from pyrobocop_pyomo.errors import InitialGuessError, ObstacleError

BOX = [(4, 3), (8, 3), (8, 5), (4, 5)]
BRACKET = [(-6, -6), (0, -6), (0, -5), (-5, -5), (-5, -1), (-6, -1)]


def numbers(rings: Any = (BOX, BRACKET), shift: str = "0", turns: tuple[int, int] = (0, 0)) -> list[str]:
    def place(point: Any) -> list[str]:
        return [str(Decimal(f"{entry:.6f}") + Decimal(shift)) for entry in point]

    head = [*place((1.5, -2)), str(0.4 + 2 * math.pi * turns[0]), *place((9, 9)), str(-2.0 + 2 * math.pi * turns[1])]
    corners = [word for ring in rings for point in ring for word in place(point)]
    return [*head, str(len(rings)), *(str(len(ring)) for ring in rings), *corners]


def area(parts: list[rcp.Polytope]) -> Any:
    return shapely.union_all([shapely.MultiPoint(part.vertices).convex_hull for part in parts])


def test_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "case_1.csv").write_text(",".join(numbers()) + "\n")
    case = rcp.scenes.ParkingCase.read(tmp_path / "case_1.csv")
    assert (case.name, case.origin) == ("case_1", (1.5, -2.0))
    assert case.start.tolist() == [0.0, 0.0, 0.4]
    np.testing.assert_allclose(case.goal, [7.5, 11.0, -2.0])
    assert list(case.obstacles) == ["obstacle 1", "obstacle 2"]
    assert len(case.obstacles["obstacle 1"]) == 1
    for name, ring in zip(case.obstacles, (BOX, BRACKET), strict=True):
        stated = shapely.Polygon(np.array(ring) - case.origin)
        assert area(case.obstacles[name]).symmetric_difference(stated).area < 1e-9
        # Parts overlap in nothing but their boundaries.
        assert sum(area([part]).area for part in case.obstacles[name]) == pytest.approx(stated.area)


@given(
    first=st.integers(0, 5), reverse=st.booleans(), close=st.booleans(), repeat=st.integers(0, 5),
    bend=st.floats(-1e-7, 1e-7),
)  # fmt: skip
@settings(max_examples=25, deadline=None)
def test_how_a_ring_is_written_does_not_matter(
    first: int, reverse: bool, close: bool, repeat: int, bend: float
) -> None:
    for ring in (BOX, BRACKET):
        k, again = first % len(ring), repeat % len(ring)
        (a, b), (c, d) = ring[0], ring[1]
        other = [ring[0], (0.5 * (a + c), 0.5 * (b + d) + bend), *ring[1:]]
        other = [*other[k:], *other[:k]]
        other = [*other[: again + 1], other[again], *other[again + 1 :]]
        other = other[::-1] if reverse else other
        other = [*other, other[0]] if close else other
        stated = shapely.Polygon(ring)
        shapes = rcp.scenes.ParkingCase.from_numbers(numbers([other])).parts.values()
        found = shapely.affinity.translate(area(list(shapes)), 1.5, -2.0)
        assert found.symmetric_difference(stated).area < 1e-5
        assert len(shapes) == 1 or ring is BRACKET


@pytest.mark.parametrize("shift", ["1000000000", "-123456789.125"])
def test_no_digits_are_lost_far_from_the_origin(shift: str) -> None:
    here, there = (rcp.scenes.ParkingCase.from_numbers(numbers(shift=moved)) for moved in ("0", shift))
    np.testing.assert_array_equal(here.goal, there.goal)
    for name, part in here.parts.items():
        np.testing.assert_array_equal(part.vertices, there.parts[name].vertices)


@pytest.mark.parametrize("turns", [(1, 0), (-2, 0), (0, 3), (2, -2)])
def test_headings_count_up_to_whole_turns(turns: tuple[int, int]) -> None:
    case, plain = (rcp.scenes.ParkingCase.from_numbers(numbers(turns=given)) for given in (turns, (0, 0)))
    np.testing.assert_allclose(case.start, plain.start, atol=1e-12)
    np.testing.assert_allclose(case.goal, plain.goal, atol=1e-12)


def test_walls_are_cut_off_and_what_is_far_away_is_left_out() -> None:
    wall = [(-1e9, -9), (1e9, -9), (1e9, -8), (-1e9, -8)]
    away = [(1e9, 1e9), (1e9 + 5, 1e9), (1e9, 1e9 + 5)]
    case = rcp.scenes.ParkingCase.from_numbers(numbers([wall, away, BOX]))
    assert list(case.obstacles) == ["obstacle 1", "obstacle 3"]
    (part,) = case.obstacles["obstacle 1"]
    np.testing.assert_allclose(part.vertices[:, 1].min(), -7.0)
    np.testing.assert_allclose(part.vertices[:, 1].max(), -6.0)
    assert part.vertices[:, 0].min() < -900.0


def test_lines_and_points_are_obstacles_too() -> None:
    case = rcp.scenes.ParkingCase.from_numbers(numbers([[(3, 3), (5, 3)], [(2, 8)]]))
    assert all(part.is_flat for part in case.parts.values())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (numbers()[:-1], "28 numbers, but 2 obstacles with 10 corners in all take 29"),
        ([*numbers(), "1.0"], "more than one case"),
        (["1", "2"], "2 numbers; expected x, y, heading"),
        ([*numbers()[:6], "1.5", *numbers()[7:]], "the number of obstacles is 1.5"),
        ([*numbers()[:9], "wide", *numbers()[10:]], "value 10 is 'wide'"),
        ([*numbers()[:9], "nan", *numbers()[10:]], "value 10 is 'nan'"),
    ],
)
def test_what_is_no_case_is_refused_with_the_place(given: list[str], message: str) -> None:
    with pytest.raises(ObstacleError, match=message):
        rcp.scenes.ParkingCase.from_numbers(given)


def test_the_car_is_measured_from_its_rear_axle() -> None:
    car = rcp.scenes.ParkingCar()
    assert car.shape.vertices[:, 0].min() == pytest.approx(-car.rear_overhang)
    assert car.shape.vertices[:, 0].max() == pytest.approx(car.wheelbase + car.front_overhang)
    assert np.ptp(car.shape.vertices[:, 1]) == pytest.approx(car.width)
    for options in ({"wheelbase": 0.0}, {"speed": math.nan}, {"steering": 1.6}):
        with pytest.raises(ObstacleError, match=f"ParkingCar: {next(iter(options))} = "):
            rcp.scenes.ParkingCar(**options)


def test_a_car_that_stands_in_an_obstacle_is_refused_with_its_name() -> None:
    case = rcp.scenes.ParkingCase.from_numbers(numbers([[(2, -2), (3, -2), (3, -1)]]))
    with pytest.raises(rcp.errors.ObstacleError, match="at the start the car overlaps 'obstacle 1' by"):
        rcp.scenes.parking_model(case)


def test_a_case_without_a_path_is_refused_where_one_is_needed() -> None:
    around = [[(-4, -6), (8, -6), (8, -5.5), (-4, -5.5)], [(-4, 3), (8, 3), (8, 3.5), (-4, 3.5)]]
    around += [[(-4, -6), (-3.5, -6), (-3.5, 3.5), (-4, 3.5)], [(7.5, -6), (8, -6), (8, 3.5), (7.5, 3.5)]]
    case = rcp.scenes.ParkingCase.from_numbers(numbers(around))
    with pytest.raises(rcp.errors.PathNotFound, match="no way even for a disc"):
        rcp.scenes.parking_model(case, needs_path=True)
    guess = rcp.scenes.parking_model(case, elements=4).drive
    assert guess.x[0.5].value == pytest.approx(0.5 * (case.start[0] + case.goal[0]))


# --------------------------------------------------------------------
# Cases of several vehicles: what their files say, and plans that are checked by independent distances.


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
def test_vehicles_that_change_places_keep_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where each goes exactly where the other one stands, one of them moves aside first."""
    starts = [(-9.0, 0.0, 0.0), (9.0, 0.5, math.pi)]
    goals = starts[::-1]
    plan = rcp.scenes.plan_vehicles(rcp.scenes.VehiclesCase("lane", starts, goals, {}))
    assert plan.safe
    assert [move.vehicle for move in plan.moves].count(plan.moves[0].vehicle) == 2
    times = np.arange(0.0, plan.duration, 0.05)
    poses, shape = plan.poses_at(times), rcp.scenes.ParkingCar().shape
    np.testing.assert_allclose(poses[:, 0], starts, atol=1e-6)
    np.testing.assert_allclose(plan.poses_at([plan.duration + 5.0])[:, 0, :2], np.array(goals)[:, :2], atol=1e-6)
    for one, other in zip(*poses, strict=True):
        placed = shape.placed(rcp.planar_pose(*one.tolist()))
        distance = rcp.scenes.signed_distance(shape, placed, rcp.planar_pose(*other.tolist())).distance
        assert distance >= 0.05 - 1e-3
    # A film has each vehicle where the plan has it.
    drawn: list[Any] = []
    monkeypatch.setattr(vehicles_in_turn, "animate_scene", lambda *arguments, **options: drawn.extend(arguments))
    plan.animate()
    times, vehicles, *_ = drawn
    for vehicle, of_plan in zip(vehicles, plan.poses_at(times), strict=True):
        np.testing.assert_allclose(vehicle.translation, of_plan[:, :2])
        ahead = np.column_stack([np.cos(of_plan[:, 2]), np.sin(of_plan[:, 2])])
        np.testing.assert_allclose(vehicle.rotation[:, :, 0], ahead)
        np.testing.assert_allclose(np.linalg.det(vehicle.rotation), 1.0)


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


def test_a_vehicle_that_finds_no_way_goes_before_as_few_as_possible(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicle 3 gets there only before vehicle 1, since they have farther to go."""
    case = rcp.scenes.VehiclesCase(
        "yard", [(0, 10 * k, 0) for k in range(4)], [(50 - k, 10 * k, 0) for k in range(4)], {}
    )  # fmt: skip

    def alone(case: Any, car: Any, vehicle: int, arrived: Any, *rest: Any) -> Any:
        return None if vehicle == 3 and 1 in arrived else (vehicle, None)

    monkeypatch.setattr(vehicles_in_turn, "_alone", alone)
    monkeypatch.setattr(vehicles_in_turn, "_timed", lambda case, car, moves, *rest: [move.vehicle for move in moves])
    assert rcp.scenes.plan_vehicles(case) == [0, 3, 1, 2]


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
