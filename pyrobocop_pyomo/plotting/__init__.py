"""Pictures from plain arrays: the only reader of Matplotlib."""

from .animation_files import AnimationFile, animation_file
from .clearances import plot_clearances
from .scenes import BodyPath, animate_scene, draw_scene
from .signals import mark_phases, plot_signals
from .solve_results import plot_history, plot_result

__all__ = [
    "AnimationFile",
    "BodyPath",
    "animate_scene",
    "animation_file",
    "draw_scene",
    "mark_phases",
    "plot_clearances",
    "plot_history",
    "plot_result",
    "plot_signals",
]
