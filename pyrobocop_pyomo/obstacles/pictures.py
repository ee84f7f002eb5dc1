"""Pictures of an avoidance block: its bodies along the motion that its variables describe now."""

from __future__ import annotations

from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.plotting import BodyPath, animate_scene, draw_scene

# Least number of poses: the path looks smooth, and every frame of an animation has a pose near its time.
_FEWEST_POSES = 240


def draw_avoidance(
    avoid: Any, *, snapshots: int = 12, view: Any = None, title: str | None = None, unit: str = "m", figure: Any = None
) -> Any:
    """Draw the bodies of an avoidance block among its obstacles, as snapshots from light to dark.

    Parameters
    ----------
    avoid : ObstacleAvoidanceBlock
        Its variables need values: those of a solution, or of an initial guess.
    snapshots : int
        How many times are drawn, with about equal motion between them.
    view : (lower, upper), optional
        Corners of what is shown, shape (2, d).
    title : str, optional
        The block's name by default.
    unit : str
        Of lengths, written on the axes.
    figure : Figure or SubFigure, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure

    Raises
    ------
    GeometryError
        When a variable that a pose needs has no value.
    """
    time, bodies, obstacles = scene_of(avoid)
    return draw_scene(
        time,
        bodies,
        obstacles,
        snapshots=snapshots,
        view=view,
        title=avoid.name if title is None else title,
        unit=unit,
        figure=figure,
    )


def animate_avoidance(avoid: Any, path: str | Path, *, title: str | None = None, **options: Any) -> Path:
    """Write a GIF of the bodies of an avoidance block that move among its obstacles; returns the file written.

    Parameters
    ----------
    avoid : ObstacleAvoidanceBlock
    path : str or Path
        Where to write; the suffix is made ``.gif``.
    title : str, optional
        The block's name by default.
    **options
        Of `animate_scene`: ``frames``, ``seconds``, ``view``, ``unit``, ``size``.
    """
    return animate_scene(*scene_of(avoid), path, title=avoid.name if title is None else title, **options)


def scene_of(avoid: Any) -> tuple[Array, list[BodyPath], list[Polytope]]:
    """Times, the paths of moving bodies, and the resting shapes."""
    motion, scene = avoid.motion, avoid.record.scene
    moving = {name: body for name, body in scene.bodies.items() if body.pose is not None}
    between = bool(motion.intervals) and all(_moves_between(motion, body, name) for name, body in moving.items())
    time = _times_between(motion) if between else _times_of_points(motion)
    poses_of = _poses_between if between else _poses_at_points
    bodies = [BodyPath(body.parts, *_numbers(poses_of(motion, body, name)), name) for name, body in moving.items()]
    resting = [part for name, body in scene.bodies.items() if body.pose is None for _, part in body.named_parts(name)]
    return time, bodies, resting


def _moves_between(motion: Motion, body: Body, name: str) -> bool:
    """False for a pose that reads a control or an algebraic variable: such a body is drawn at the points only."""
    try:
        motion.pose_at(body.pose, 0, 0.5, name=name)  # type: ignore[arg-type]
    except ObstacleError:
        return False
    return True


def _places(motion: Motion) -> list[tuple[int, float]]:
    """Intervals and fractions, the last end included."""
    last = len(motion.intervals) - 1
    share = max(2, -(-_FEWEST_POSES // (last + 1)))
    return [(interval, i / share) for interval in range(last + 1) for i in range(share)] + [(last, 1.0)]


def _times_between(motion: Motion) -> Array:
    return np.array([pyo.value(motion.time_at(motion.index_at(*place))) for place in _places(motion)], dtype=float)


def _times_of_points(motion: Motion) -> Array:
    times = [pyo.value(motion.time_at(point)) for point in motion.points]
    # Points that are no times are drawn in their order.
    return np.array(times if all(isinstance(time, Real) for time in times) else range(len(times)), dtype=float)


def _poses_between(motion: Motion, body: Body, name: str) -> list[Pose]:
    return [motion.pose_at(body.pose, *place, name=name) for place in _places(motion)]  # type: ignore[arg-type]


def _poses_at_points(motion: Motion, body: Body, name: str) -> list[Pose]:
    return [motion.pose_at_node(body.pose, point, name=name) for point in motion.points]  # type: ignore[arg-type]


def _numbers(poses: list[Pose]) -> tuple[Array, Array]:
    rotations, translations = zip(*(pose.numbers() for pose in poses), strict=True)
    return np.array(rotations), np.array(translations)
