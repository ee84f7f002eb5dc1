"""Pictures of avoidance blocks show where the bodies are, also between the points of the mesh."""

from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles.pictures import scene_of

pytest.importorskip("matplotlib")

CAR = rcp.Polytope.box(2, 1)
WALL = rcp.Polytope.from_halfspaces([[0, -1]], [-5], bounded=False)
CASES = ("fixed duration", "free duration")


def model(case: str, **options) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    duration = rcp.Duration(bounds=(1, 9), initial_guess=2) if case == "free duration" else 2.0
    m.drive = b = rcp.PhaseBlock(duration=duration, elements=3, stages=2)
    scale = 2.0 if b.has_normalised_time else 1.0
    b.x = rcp.State(initial_guess=lambda t: (scale * t) ** 2)
    b.theta = rcp.State(initial_guess=lambda t: scale * t)
    b.steering = rcp.Control(initial_guess=lambda t: scale * t)
    b.ode(lambda b, t: {b.x: 2 * b.time_at(t), b.theta: b.steering[t]})
    bodies = {"car": rcp.Body(CAR, pose=lambda b, t: rcp.planar_pose(b.x[t], 0, b.theta[t]))}
    obstacles = {"wall": WALL, "truck": rcp.Body(CAR, pose=lambda b, t: rcp.planar_pose(9, -b.time_at(t)))}
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, **{"bodies": bodies, "obstacles": obstacles, "clearance": 0.1, **options}
    )
    return m


@pytest.mark.parametrize("case", CASES)
def test_bodies_are_where_the_polynomials_of_the_scheme_say(case: str) -> None:
    m = model(case)
    time, (car, truck), still = scene_of(m.drive.avoid)
    assert (car.name, truck.name) == ("car", "truck")
    assert [part.name for part in still] == ["wall"]
    assert (time[0], time[-1]) == pytest.approx((0, 2))
    assert (np.diff(time) > 0).all()
    assert len(time) > 200
    assert car.translation == pytest.approx(np.column_stack([time**2, 0 * time]), abs=1e-9)
    assert np.arctan2(car.rotation[:, 1, 0], car.rotation[:, 0, 0]) == pytest.approx(time, abs=1e-9)
    assert truck.translation == pytest.approx(np.column_stack([9 + 0 * time, -time]), abs=1e-9)


@pytest.mark.heavy
def test_a_block_draws_and_animates_itself(tmp_path: Path) -> None:
    m = model("free duration")
    figure = rcp.scenes.draw_avoidance(m.drive.avoid, snapshots=4)
    axis = figure.axes[0]
    assert len(axis.patches) == 1 + 2 * 4
    assert axis.get_title() == "drive.avoid"
    figure.canvas.draw()
    written = rcp.scenes.animate_avoidance(m.drive.avoid, tmp_path / "drive", frames=3, title="drive")
    assert written.suffix == ".gif"
    assert written.stat().st_size > 1000


def test_without_values_the_body_is_named() -> None:
    m = model("fixed duration")
    m.drive.x[m.drive.final_time].clear()
    with pytest.raises(rcp.errors.ObstacleError, match="no value"):
        rcp.scenes.draw_avoidance(m.drive.avoid)
