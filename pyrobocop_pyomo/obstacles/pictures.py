"""Pictures of an avoidance block: its bodies along the motion that its variables describe now."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.motion.moving_shapes import moving_shapes
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.plotting import AnimationFile, BodyPath, animate_scene, draw_scene

# Least number of poses: the path looks smooth, and every frame of an animation has a pose near its time.
_FEWEST_POSES = 240


def draw_avoidance(avoid: Any, *, title: str | None = None, **options: Any) -> Any:
    """Draw the bodies of an avoidance block among its obstacles, as snapshots from light to dark.

    Parameters
    ----------
    avoid : ObstacleAvoidanceBlock
        Its variables need the values of a solution, or of an initial guess.
    title : str, optional
        The block's name by default.
    **options
        Of `draw_scene`: ``snapshots``, ``view``, ``figure``.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure

    Raises
    ------
    ObstacleError
        When a variable that a pose needs has no value.
    """
    return draw_scene(*scene_of(avoid), title=avoid.name if title is None else title, **options)


def animate_avoidance(
    avoid: Any, path: str | Path | None = None, *, title: str | None = None, **options: Any
) -> AnimationFile:
    """Write an animation of the bodies of an avoidance block among its obstacles; in a notebook, it plays.

    Parameters
    ----------
    avoid : ObstacleAvoidanceBlock
    path : str or Path, optional
        Where to write, as in `animate_scene`; a temporary GIF by default.
    title : str, optional
        The block's name by default.
    **options
        Of `animate_scene`: ``frames``, ``seconds``, ``view``, ``size``.
    """
    return animate_scene(*scene_of(avoid), path, title=avoid.name if title is None else title, **options)


def scene_of(avoid: Any) -> tuple[Array, list[BodyPath], list[Polytope]]:
    """Times, the paths of moving bodies, and the resting shapes."""
    motion, bodies = avoid.motion, avoid.record.scene.bodies
    moving = {name: body for name, body in bodies.items() if body.moves}
    resting = [part for name, body in bodies.items() if not body.moves for _, part in body.named_parts(name)]
    interval, fraction = _instants(len(motion.intervals))
    ends = motion.interval_ends
    time = ends[interval, 0] + fraction * (ends[interval, 1] - ends[interval, 0])
    poses = {name: parts[0].poses(interval, fraction) for name, parts in moving_shapes(motion, moving).items()}
    for name, of_body in poses.items():
        if not all(np.isfinite(of).all() for of in of_body):
            raise ObstacleError(f"'{name}': its pose has no finite value everywhere, so that it cannot be drawn.")
    return time, [BodyPath(body.parts, *poses[name], name) for name, body in moving.items()], resting


def _instants(intervals: int) -> tuple[Indices, Array]:
    """Intervals and local fractions, the last end included."""
    share = max(2, -(-_FEWEST_POSES // intervals))
    interval = np.append(np.repeat(np.arange(intervals), share), intervals - 1)
    return interval, np.append(np.tile(np.arange(share) / share, intervals), 1.0)
