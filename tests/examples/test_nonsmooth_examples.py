"""The examples with friction and switches, held to their closed forms."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyrobocop_pyomo as rcp

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = pytest.mark.casadi


def load(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name=name)


def test_riding_the_belt_costs_no_more_than_the_best_brake() -> None:
    example = load("stick_slip")
    m = example["build"]("ride")
    result = rcp.solve(m)
    result.raise_for_status()
    assert result.objective == pytest.approx(example["smallest_effort"](), rel=1e-3)
    found = m.motion.trajectory()
    sticks = (found.points > 0.6) & (found.points < 2.4)
    assert found(found.points)["v"][sticks] == pytest.approx(example["BELT"], abs=1e-5)
    assert np.abs(found.force[sticks]).max() < 1e-2  # riding is free
    assert found.verify().largest_violation < 1e-6
    assert found.verify().horizon_error < 1e-6


@pytest.mark.parametrize(("elements", "tolerance"), [(30, 4e-4), (60, 1e-4)])
def test_the_spring_lets_go_when_it_is_as_strong_as_friction(elements: int, tolerance: float) -> None:
    example = load("stick_slip")
    m = example["build"]("spring", elements=elements)
    rcp.solve(m).raise_for_status()
    found = m.motion.trajectory()
    x, v = example["swing"](found.time)
    assert found.x == pytest.approx(x, abs=tolerance)
    assert found.v == pytest.approx(v, abs=2 * tolerance)
    stuck = found.points < 1
    assert found.friction[stuck] == pytest.approx(example["STIFFNESS"] * found(found.points)["x"][stuck], abs=1e-3)


@pytest.mark.parametrize("case", ["turbo", "hysteresis"])
def test_the_car_takes_the_minimal_time_and_switches_at_its_thresholds(case: str) -> None:
    example = load("turbo_car")
    m = example["build"](case)
    result = rcp.solve(m)
    result.raise_for_status()
    assert result.objective == pytest.approx(example["minimal_time"](case), rel=1e-7)
    found = m.drive.trajectory()
    boundaries = np.array(found.grid.mesh.boundaries)
    v = np.append(found.element_states("v")[:, 0], found.v[-1])
    turbo = found.element_signals("turbo")[:, 0]
    on, off = np.flatnonzero(np.abs(np.diff(turbo)) > 0.5) + 1
    assert v[on] == pytest.approx(example["ON"], abs=1e-7)
    assert v[off] == pytest.approx(example["ON"] if case == "turbo" else example["OFF"], abs=1e-7)
    assert boundaries[on] == pytest.approx(example["ON"] / example["PLAIN"], abs=1e-6)
    assert found.verify().horizon_error is None  # its pairs stand beside the phase, at points alone
