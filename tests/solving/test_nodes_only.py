"""`between=None` looks at nodes alone: its plans pass through obstacles in between, and `verify` says so.

The judge is the trajectory at 400 times in each interval: by Shapely in the plane, by exact distances in space.
"""

from __future__ import annotations

import importlib.util
import itertools
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
import shapely

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.planning.recovery import Recovery

pytestmark = pytest.mark.ipopt

SAMPLES = 400
EXAMPLES = Path(__file__).parents[2] / "examples"


@cache
def example(name: str) -> Any:
    """One of the scripts in the folder of examples, as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def planned(m: pyo.ConcreteModel, phase: Any, name: str, pose: Any, body: Any, obstacles: Any, clearance: float) -> Any:
    """The model solved once with its avoidance block replaced by one for nodes only; the result."""
    phase.del_component("avoid")
    phase.avoid = rcp.ObstacleAvoidanceBlock(
        phase.time,
        bodies={name: rcp.Body(body, pose=pose)},
        obstacles=obstacles,
        clearance=clearance,
        between=None,
    )
    result = rcp.solve(m)
    assert result.quality is rcp.Quality.OPTIMAL
    for time in phase.time:
        at = pose(phase, time)
        for obstacle in obstacles.values():
            assert rcp.scenes.signed_distance(body, obstacle, at).distance > clearance - 1e-6
    return result


@pytest.fixture(autouse=True)
def one_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other starts are tried: this is about what is said of a plan, not about finding a better one."""
    monkeypatch.setattr(Recovery, "steps", lambda self: iter([self._from_initial_guess]))


def fine_times(trajectory: Any) -> list[np.ndarray]:
    """Times of the trajectory, for each interval."""
    boundaries = trajectory.grid.mesh.boundaries
    return [np.linspace(a, b, SAMPLES) for a, b in itertools.pairwise(boundaries)]


def check_agreement(safety: rcp.SafetyReport, sampled: dict[str, np.ndarray]) -> None:
    """Verdicts and bounds of a plan against samples: by obstacle, the least distance of each interval, 0 in overlap."""
    assert {pair.second for pair in safety.body_pairs} == set(sampled)
    for pair in safety.body_pairs:
        least, enough = sampled[pair.second], pair.clearance - pair.tolerance
        assert not pair.undecided
        # What is proven is true, and what is sampled too close is found, interval by interval.
        assert (pair.interval_proven <= least + 1e-7).all()
        assert set(np.flatnonzero(least < enough - 1e-7)) <= set(pair.violated)
        # What is found too close is so: samples lie dense enough for all but a grazing touch.
        assert (least[list(pair.violated)] < pair.clearance).all()
        assert pair.safe is bool(least.min() >= enough - 1e-7)
        assert max(pair.distance, 0.0) <= least.min() + 1e-4
    worst = min(safety.body_pairs, key=lambda pair: sampled[pair.second].min())
    assert sampled[worst.second].min() == pytest.approx(max(worst.distance, 0.0), abs=1e-3)


FAR = 200.0


def area(shape: rcp.Polytope) -> shapely.Polygon:
    """A half-plane or a wedge, cut off far away."""
    return shapely.MultiPoint(
        np.vstack([shape.vertices, *(shape.vertices + FAR * ray for ray in shape.rays)])
    ).convex_hull


@pytest.mark.parametrize("elements", [16, 40])
def test_parallel_parking(elements: int) -> None:
    parking = example("parking")
    m = parking.build("parallel", elements=elements, stages=1)
    obstacles = parking.CASES["parallel"]["obstacles"]

    def pose(b: Any, t: Any) -> rcp.scenes.Pose:
        return rcp.planar_pose(b.x[t], b.y[t], b.theta[t])

    result = planned(m, m.drive, "car", pose, parking.CAR, obstacles, parking.CLEARANCE)
    trajectory = m.drive.trajectory()
    sampled: dict[str, list[float]] = {name: [] for name in obstacles}
    for times in fine_times(trajectory):
        there = trajectory(times)
        turn = np.exp(1j * there["theta"])[:, None]
        corners = turn * (parking.CAR.vertices @ [1, 1j]) + (there["x"] + 1j * there["y"])[:, None]
        cars = shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))
        for name, obstacle in obstacles.items():
            sampled[name].append(float(shapely.distance(cars, area(obstacle)).min()))
    check_agreement(m.drive.avoid.verify(equations=False), {name: np.array(each) for name, each in sampled.items()})
    assert result.safe is False
    assert "NOT SAFE" in str(result)


@pytest.mark.parametrize(("case", "elements"), [("narrow", 8), ("low", 8)])
def test_a_quadrotor_at_a_window(case: str, elements: int) -> None:
    window = example("quadrotor_window")
    m = window.build(case, elements=elements, stages=1)
    obstacles = window.walls(case)

    def pose(b: Any, t: Any) -> rcp.scenes.Pose:
        return rcp.spatial_pose((b.x[t], b.y[t], b.z[t]), euler=(b.roll[t], b.pitch[t], b.yaw[t]))

    result = planned(m, m.flight, "quadrotor", pose, window.BODY, obstacles, window.CLEARANCE)
    trajectory = m.flight.trajectory()
    sampled: dict[str, list[float]] = {name: [] for name in obstacles}
    for times in fine_times(trajectory):
        there = trajectory(times)
        columns = np.column_stack([there[name] for name in ("x", "y", "z", "roll", "pitch", "yaw")])
        for name, obstacle in obstacles.items():
            least = np.inf
            for x, y, z, *angles in columns:
                # Farther than both reach apart from what is closest so far: no need to look.
                body = window.BODY.placed(rcp.spatial_pose((x, y, z), euler=angles))
                if box_gap(body, obstacle) < least:
                    least = min(least, max(rcp.scenes.signed_distance(body, obstacle).distance, 0.0))
            sampled[name].append(least)
    check_agreement(m.flight.avoid.verify(equations=False), {name: np.array(each) for name, each in sampled.items()})
    assert result.safe is False


def box_gap(first: rcp.Polytope, second: rcp.Polytope) -> float:
    """Distance of the boxes around two shapes: never more than that of the shapes."""
    p, q = first.vertices, second.vertices
    apart = np.maximum(p.min(axis=0) - q.max(axis=0), q.min(axis=0) - p.max(axis=0))
    return float(np.linalg.norm(np.maximum(apart, 0.0)))
