"""The same problem with another statement of what keeps clear of what."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))  # examples are scripts, not a package


def restate(phase: Any, **options: Any) -> Any:
    """Replace ``phase.avoid`` by one with the same scene, except for what the options say; returns the new block."""
    scene = phase.avoid.record.scene
    kept = {
        "bodies": {name: body for name, body in scene.bodies.items() if name not in scene.obstacles},
        "obstacles": {name: scene.bodies[name] for name in scene.bodies if name in scene.obstacles},
        "clearance": next(iter(scene.clearances.values())),
    }
    phase.del_component("avoid")
    phase.avoid = rcp.ObstacleAvoidanceBlock(phase.time, **{**kept, **options})
    return phase.avoid


def fix_ends(phase: Any, start: Mapping[str, float], goal: Mapping[str, float]) -> None:
    """Fix states at the two ends of a phase."""
    first, last = phase.time.first(), phase.time.last()
    for time, ends in ((first, start), (last, goal)):
        for name, value in ends.items():
            getattr(phase, name)[time].fix(value)


def start_on_quarter_circle(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    """Let the small car start ahead and arrive sideways, as its headings ask; a straight line fits neither side."""
    b = m.drive
    last = b.time.last()
    x, y = pyo.value(b.x[last]), pyo.value(b.y[last])
    b.initialize(
        x=lambda t: x * (1 - np.cos(np.pi / 2 * t / last)),
        y=lambda t: y * np.sin(np.pi / 2 * t / last),
        theta=lambda t: np.pi / 2 * t / last,
    )
    return m


def sampled_distance(avoid: Any, per_interval: int = 20) -> float:
    """Smallest signed distance of all pairs at many instants, by no code that verification uses."""
    motion, scene = avoid.motion, avoid.record.scene
    smallest = np.inf
    for interval in range(len(motion.intervals)):
        for fraction in np.linspace(0.0, 1.0, per_interval + 1):
            poses = {
                name: body.pose and motion.pose_at(body.pose, interval, fraction, name=name)
                for name, body in scene.bodies.items()
            }
            for p, q in scene.part_pairs():
                near = rcp.scenes.signed_distance(p.shape, q.shape, poses[p.body], poses[q.body])
                smallest = min(smallest, near.distance)
    return float(smallest)


def model_size(model: pyo.ConcreteModel) -> tuple[int, int]:
    """Variables that are not fixed, and rows."""
    variables = sum(not variable.fixed for variable in model.component_data_objects(pyo.Var, active=True))
    rows = sum(1 for _ in model.component_data_objects(pyo.Constraint, active=True))
    return variables, rows
