"""Pictures and animations of scenes, bodies and linkages; they need Matplotlib."""

from pyrobocop_pyomo.obstacles import animate_avoidance, draw_avoidance
from pyrobocop_pyomo.plotting import (
    AnimationFile,
    BodyPath,
    animate_scene,
    draw_linkage,
    draw_planar_pushing,
    draw_scene,
)

__all__ = [
    "AnimationFile",
    "BodyPath",
    "animate_avoidance",
    "animate_scene",
    "draw_avoidance",
    "draw_linkage",
    "draw_planar_pushing",
    "draw_scene",
]
