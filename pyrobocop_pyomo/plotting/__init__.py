"""Pictures from plain arrays: the only reader of Matplotlib."""

from .animation_files import AnimationFile, animation_file
from .clearances import ClearanceCurve, plot_clearances
from .mechanisms import draw_linkage, draw_planar_pushing
from .scenes import BodyPath, animate_scene, draw_scene
from .signals import mark_phases, plot_signals
from .solve_results import plot_history, plot_pair_sides, plot_products

__all__ = [
    "AnimationFile",
    "BodyPath",
    "ClearanceCurve",
    "animate_scene",
    "animation_file",
    "draw_linkage",
    "draw_planar_pushing",
    "draw_scene",
    "mark_phases",
    "plot_clearances",
    "plot_history",
    "plot_pair_sides",
    "plot_products",
    "plot_signals",
]
