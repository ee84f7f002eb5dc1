"""Cases of several vehicles: what their files say, and plans that are checked by independent distances."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import GeometryError, ObstacleError

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
    with pytest.raises(GeometryError, match="4 numbers; expected the number of vehicles"):
        rcp.scenes.VehiclesCase.read(tmp_path / "case.csv")
    with pytest.raises(GeometryError, match="1 starts, but 2 goals"):
        rcp.scenes.VehiclesCase("yard", [(0, 0, 0)], [(1, 0, 0), (9, 9, 0)], {})
    case = rcp.scenes.VehiclesCase("yard", [(0, 0, 0), (1, 0, 0)], [(20, 0, 0), (9, 9, 0)], {})
    with pytest.raises(ObstacleError, match="at their starts vehicles 1 and 2 overlap"):
        rcp.scenes.plan_vehicles(case)


@pytest.mark.casadi
@pytest.mark.slow
def test_vehicles_that_change_places_keep_apart() -> None:
    """One in the way of the other: the order and the departures follow from that."""
    starts, goals = [(-9.0, 0.0, 0.0), (9.0, 0.5, math.pi)], [(9.0, 4.0, 0.0), (-9.0, 0.5, math.pi)]
    plan = rcp.scenes.plan_vehicles(rcp.scenes.VehiclesCase("lane", starts, goals, {}))
    assert plan.safe
    times = np.arange(0.0, plan.duration, 0.05)
    poses, shape = plan.poses_at(times), rcp.scenes.ParkingCar().shape
    np.testing.assert_allclose(poses[:, 0], starts, atol=1e-6)
    np.testing.assert_allclose(plan.poses_at([plan.duration + 5.0])[:, 0, :2], np.array(goals)[:, :2], atol=1e-6)
    for one, other in zip(*poses, strict=True):
        placed = shape.placed(rcp.planar_pose(*one.tolist()))
        distance = rcp.scenes.signed_distance(shape, placed, rcp.planar_pose(*other.tolist())).distance
        assert distance >= 0.05 - 1e-3
