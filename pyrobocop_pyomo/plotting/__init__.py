"""Pictures from plain arrays: the only reader of Matplotlib."""

from .animations import animate_scene
from .body_path import BodyPath
from .linkage import draw_linkage
from .pairs import plot_pair_sides, plot_products
from .phase_marks import mark_phases
from .planar_pushing import draw_planar_pushing
from .scenes import draw_scene
from .signals import plot_signals
from .solve_history import plot_history

__all__ = [
    "BodyPath",
    "animate_scene",
    "draw_linkage",
    "draw_planar_pushing",
    "draw_scene",
    "mark_phases",
    "plot_history",
    "plot_pair_sides",
    "plot_products",
    "plot_signals",
]
