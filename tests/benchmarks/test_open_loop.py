"""Open loop: a plan is played back by its driving forces, and contact obeys the law of impact."""

import sys
from pathlib import Path

import numpy as np
import pytest

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from open_loop import play_back

planar = rcp.mechanics.planar
STEP = 0.07


def test_the_law_of_impact_holds_and_nobody_jumps_over_the_object() -> None:
    """A disc that flies at 4 m/s, 0.28 m in a step, at a puck of half its mass: plastic, so 8/3 m/s together."""
    puck = planar.RigidBody(planar.Disc(0.1), mass=0.5, inertia=0.0025)
    disc = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=1e3, speed_limit=100.0)
    task = planar.Score(puck, disc, friction=0.5, step=STEP, goal=(None,) * 3, rest_at_end=False)
    plans = {"puck": {f"body.{n}": np.zeros(5) for n in ("qx", "qy", "qth", "ux", "uy", "uth")}, "a": {}}
    plans["a"] |= {f"me.{n}": np.zeros(4) for n in ("tau_x", "tau_y", "c", "alpha_plus", "alpha_minus")}
    plans["a"] |= {f"me.{n}": np.zeros(5) for n in ("y", "vy")}
    plans["a"] |= {"me.x": np.linspace(-0.5, -0.5 + 4 * 0.28, 5), "me.vx": np.full(5, 4.0)}
    poses, unsolved = play_back(task, plans)
    speeds = np.diff(poses[:, 0]) / STEP
    assert unsolved is None
    assert speeds[0] == 0.0
    assert speeds[2:] == pytest.approx([8 / 3, 8 / 3], abs=1e-3)
