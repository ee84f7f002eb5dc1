"""Pictures: what is drawn, and that no global state of Matplotlib is touched."""

from __future__ import annotations

import sys

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.plotting import plot_signals

pytest.importorskip("matplotlib")


@pytest.fixture(autouse=True)
def _no_pyplot():
    before = "matplotlib.pyplot" in sys.modules
    yield
    assert ("matplotlib.pyplot" in sys.modules) == before


def trajectory(controls: int, scheme: str = "radau") -> rcp.Trajectory:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2, elements=3, scheme=scheme)
    b.x = rcp.State(initial_guess=lambda t: t**2)
    for i in range(controls):
        setattr(b, f"u{i}", rcp.Control(initial_guess=[1, 3, 2], parametrization="piecewise_constant"))
    return b.trajectory()


@pytest.mark.parametrize(("controls", "columns"), [(0, 1), (3, 1), (4, 2), (5, 2)])
def test_a_trajectory_has_a_panel_per_signal(controls: int, columns: int) -> None:
    figure = trajectory(controls).plot()
    panels = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_ylabel() for axis in panels] == ["x", *(f"u{i}" for i in range(controls))]
    assert len({axis.get_position().x0 for axis in panels}) == columns
    assert sum(axis.get_xlabel() == "time" for axis in panels) == min(columns, len(panels))
    assert figure.get_suptitle() == "p (not solved by rcp.solve)"
    figure.canvas.draw()


def test_chosen_signals_are_drawn_in_the_chosen_order() -> None:
    figure = trajectory(2).plot(["u1", "x"])
    assert [axis.get_ylabel() for axis in figure.axes] == ["u1", "x"]


def test_a_state_is_drawn_as_its_polynomial_with_its_nodes() -> None:
    (axis,) = trajectory(0).plot().axes
    line, nodes = axis.lines
    assert line.get_ydata() == pytest.approx(line.get_xdata() ** 2, abs=1e-12)
    assert list(nodes.get_xdata()) == list(trajectory(0).time)


@pytest.mark.parametrize("scheme", ["radau", "implicit_euler"])
def test_a_held_control_is_drawn_as_steps(scheme: str) -> None:
    (line,) = trajectory(1, scheme).plot(["u0"]).axes[0].lines
    assert line.get_drawstyle() == "steps-pre"
    assert set(np.round(line.get_ydata(), 12)) == {1, 2, 3}


def test_an_unknown_or_an_empty_choice_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="trajectory 'p' has no 'y'; it has x, u0"):
        trajectory(1).plot(["x", "y"])
    with pytest.raises(TrajectoryError, match="was given no name of what to draw"):
        trajectory(1).plot([])


def test_signals_can_be_drawn_without_a_trajectory() -> None:
    time = np.linspace(0, 1, 5)
    figure = plot_signals("mine", time, {"a": time}, {"a": (time, time)}, set())
    assert len(figure.axes) == 1
