"""Drawing from plain arrays: which times are drawn, and where."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure
from mechanism_pictures import draw_linkage, draw_planar_pushing

from pyrobocop_pyomo.plotting.figures import evenly_moved, time_colours


def test_snapshots_follow_motion_not_time() -> None:
    # A point that rests for nine tenths of the time and then moves steadily.
    place = np.concatenate([np.zeros(90), np.linspace(0, 1, 11)])
    chosen = evenly_moved(np.stack([place, 0 * place], axis=-1)[:, None, :], snapshots=6)
    assert place[chosen] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_what_never_moves_is_drawn_at_its_start_and_end() -> None:
    assert evenly_moved(np.zeros((20, 3, 2)), snapshots=8).tolist() == [0, 19]


def test_later_is_darker() -> None:
    colours = time_colours(np.array([0.0, 1.0, 2.0]))
    brightness = [sum(colours.to_rgba(t)[:3]) for t in (0.0, 1.0, 2.0)]
    assert brightness == sorted(brightness, reverse=True)


def test_a_given_figure_is_drawn_onto() -> None:
    time = np.linspace(0, 1, 5)
    joints = np.stack([np.zeros((5, 2)), np.stack([np.sin(time), -np.cos(time)], axis=-1)], axis=1)
    figure = Figure(layout="constrained")
    left, right = figure.subfigures(1, 2)
    assert draw_linkage(time, joints, cart=(0.3, 0.2), title="linkage", figure=left) is left
    pose, contact = np.column_stack([time, 0 * time, time]), np.tile([-0.1, 0.0], (5, 1))
    forces = np.tile([1.0, 0.0], (5, 1))
    assert draw_planar_pushing(time, pose, contact, half_side=0.1, force=forces, figure=right) is right
    figure.canvas.draw()
    assert left.axes[0].get_title() == "linkage"
