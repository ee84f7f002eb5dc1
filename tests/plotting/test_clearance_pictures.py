"""Clearances over time: what is drawn is what the report says, and a plan's picture begins with its scene."""

from dataclasses import replace

import numpy as np
import pytest
from harness.moving import check, on_points
from harness.safety_reports import measured_pair
from harness.scenes import avoiding, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.plotting import plot_clearances

pytest.importorskip("matplotlib")

CART = rcp.Polytope.box(0.4, 0.4)
POST = rcp.Polytope.box(0.4, 0.4, center=(1.5, 0.7))


def report(height: float) -> SafetyReport:
    poses = [(0, height, 0), (1, height, 0), (2, height, 0), (3, height, 0)]
    return check(on_points(poses, [0.0, 2.0, 3.0, 5.0]), CART, [POST], 0.1)


def test_intervals_carry_their_times() -> None:
    (pair,) = report(0.0).body_pairs
    assert pair.interval_ends.tolist() == [[0.0, 2.0], [2.0, 3.0], [3.0, 5.0]]
    assert pair.interval_times is not None
    assert ((pair.interval_times >= pair.interval_ends[:, 0]) & (pair.interval_times <= pair.interval_ends[:, 1])).all()
    assert pair.time == pair.interval_times[pair.interval]


@pytest.mark.parametrize(("height", "title"), [(0.0, "safe along straight lines"), (0.5, "NOT SAFE")])
def test_the_line_is_what_is_proven_and_the_dots_are_what_was_found(height: float, title: str) -> None:
    found = report(height)
    (pair,) = found.body_pairs
    figure = found.plot()
    (axis,) = figure.axes
    assert axis.get_title() == title
    assert (axis.title.get_color() == "C3") is (title == "NOT SAFE")
    proven, dots, asked = axis.lines[:3]
    assert proven.get_xdata().tolist() == [0.0, 2.0, 2.0, 3.0, 3.0, 5.0]
    assert np.array_equal(proven.get_ydata()[::2], pair.interval_proven)
    assert np.array_equal(dots.get_ydata(), pair.interval_distance, equal_nan=True)
    assert set(asked.get_ydata()) == {0.1}
    figure.canvas.draw()
    low, high = axis.get_ylim()
    assert low < min(0.0, pair.distance) < 0.1 < high


def test_many_pairs_share_a_grey_line() -> None:
    pairs = [measured_pair("car", f"post {i}", np.full(3, 0.2 + i), 0.1) for i in range(9)]
    figure = plot_clearances("clear", pairs, most=2)
    (axis,) = figure.axes
    assert "7 others" in axis.get_legend_handles_labels()[1]
    figure.canvas.draw()


def test_a_level_that_is_not_known_is_a_gap() -> None:
    ends = np.array([[0.0, 1.0], [1.0, 2.0], [4.0, 5.0]])
    proven, times = np.array([0.2, -np.inf, 0.3]), ends.mean(axis=1)
    pair = measured_pair("car", "post", np.full(3, 0.4), 0.1)
    pair = replace(pair, interval_proven=proven, interval_ends=ends, interval_times=times)
    line = plot_clearances("clear", [pair]).axes[0].lines[0]
    levels = dict(zip(line.get_xdata(), line.get_ydata(), strict=True))
    assert levels[0.0] == 0.2
    assert np.isnan(levels[2.0])
    assert levels[5.0] == 0.3


@pytest.mark.casadi
@pytest.mark.parametrize("between", ["plane", None])
def test_a_plan_is_drawn_with_its_scene_first_and_an_unsafe_one_says_so_first(between: str | None) -> None:
    m = turning_move(elements=6)
    avoiding(m, obstacles={"wall": rcp.Polytope.box(0.1, 2, center=(2.33, -0.3))}, between=between)
    result = rcp.solve(m)
    safe = between is not None
    assert result.safe is safe
    assert ("NOT SAFE" in str(result)) is (not safe)
    m.move.x.set_values(dict.fromkeys(m.move.x, 0.0), skip_validation=True)  # the result keeps its own scene
    figure = result.plot()
    scene, _, clearances, objective, *_ = figure.axes
    assert scene.get_xlabel() == "x [m]"
    assert scene.get_xlim()[1] > 4.0
    assert "distance" in clearances.get_ylabel()
    assert objective.get_ylabel() == "objective"
    assert figure.get_suptitle().startswith("NOT SAFE") is (not safe)
    figure.canvas.draw()
