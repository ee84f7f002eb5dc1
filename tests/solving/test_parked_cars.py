"""Parking cases from their numbers to plans that are proven to be safe."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any

import pytest

import pyrobocop_pyomo as rcp

pytestmark = [pytest.mark.casadi, pytest.mark.slow]

CAR = rcp.scenes.ParkingCar()


def parked(x: float, heading: float = math.pi / 2) -> list[tuple[float, float]]:
    """Another car across the lane, its rear axle at (x, -3.8)."""
    shape = CAR.shape.placed(rcp.planar_pose(x, -3.8, heading))
    return [(float(a), float(b)) for a, b in shape.vertices]


def numbers(rings: Any, goal: tuple[float, float, float], shift: tuple[int, int] = (0, 0), turns: int = 0) -> list[Any]:
    def place(point: Any) -> list[str]:
        return [str(Decimal(by) + Decimal(f"{entry:.6f}")) for by, entry in zip(shift, point, strict=True)]

    corners = [word for ring in rings for point in ring for word in place(point)]
    head = [*place((-7.0, 3.0)), str(2 * math.pi * turns), *place(goal[:2]), str(goal[2])]
    return [*head, len(rings), *map(len, rings), *corners]


FAR_SIDE = [(-15, 7), (15, 7), (15, 8), (-15, 8)]
GARAGE = [(-1.8, 0), (-1.8, -5.8), (1.8, -5.8), (1.8, 0), (1.5, 0), (1.5, -5.5), (-1.5, -5.5), (-1.5, 0)]
CASES = {
    "between cars, backwards": numbers([parked(-2.9), parked(2.9)[::-1], FAR_SIDE], (0, -3.8, math.pi / 2)),
    "garage at 1e9 m": numbers([GARAGE, FAR_SIDE], (0, -4.2, math.pi / 2), (10**9, -(10**9)), 2),
    "nose in, by a wall without end": numbers(
        [parked(-3.0), parked(3.0), [(-1e9, 8), (1e9, 8), (1e9, 9), (-1e9, 9)]], (0, -1.2, -math.pi / 2), turns=-1
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_case_is_solved_safely(name: str) -> None:
    case = rcp.scenes.ParkingCase.from_numbers(CASES[name], name=name)
    m = rcp.scenes.parking_model(case, elements=24)
    result = rcp.solve(m)
    assert result.safe
    assert result.safety.worst.clearance == pytest.approx(0.05)
    b = m.drive
    assert math.remainder(b.theta[1.0].value - float(CASES[name][5]), 2 * math.pi) == pytest.approx(0.0, abs=1e-6)
