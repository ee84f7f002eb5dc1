"""Pictures from plain arrays: the only reader of Matplotlib."""

from .linkage import draw_linkage
from .phase_marks import mark_phases
from .planar_pushing import draw_planar_pushing
from .signals import plot_signals

__all__ = ["draw_linkage", "draw_planar_pushing", "mark_phases", "plot_signals"]
