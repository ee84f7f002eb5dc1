"""Pictures from arrays, reports and results: the only reader of Matplotlib."""

from .scenes import AnimationFile as AnimationFile
from .scenes import BodyPath as BodyPath
from .scenes import animate_scene as animate_scene
from .scenes import draw_scene as draw_scene
from .signals import mark_phases as mark_phases
from .signals import plot_clearances as plot_clearances
from .signals import plot_result as plot_result
from .signals import plot_signals as plot_signals
