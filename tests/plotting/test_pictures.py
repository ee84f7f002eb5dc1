"""Pictures: what is drawn, and that no global state of Matplotlib is touched."""

import sys

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.small_problems import corners

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.plotting.figures import evenly_moved

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


@pytest.mark.parametrize(("controls", "columns"), [(0, 1), (3, 1), (4, 2)])
def test_a_trajectory_has_a_panel_per_signal(controls: int, columns: int) -> None:
    figure = trajectory(controls).plot()
    panels = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_ylabel() for axis in panels] == ["x", *(f"u{i}" for i in range(controls))]
    assert len({axis.get_position().x0 for axis in panels}) == columns
    assert sum(axis.get_xlabel() == "time" for axis in panels) == min(columns, len(panels))
    assert figure.get_suptitle() == "p (not solved by rcp.solve)"
    figure.canvas.draw()


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


# --------------------------------------------------------------------
# Pictures of results: what is drawn where, and refusals.


@pytest.fixture(scope="module")
def result() -> rcp.SolveResult:
    return rcp.solve(corners({0.1: (1, 1), 0.3: (2, 1), 0.2: (3, 1)}))


@pytest.mark.casadi
def test_the_history_has_every_run_and_marks_the_returned_one(result):
    figure = result.plot()
    upper, lower = figure.axes
    (objective,) = [line for line in upper.lines if line.get_label() != "returned point"]
    ends = np.cumsum([step.iterations for step in result.steps])
    assert list(objective.get_xdata()) == list(ends)
    assert list(objective.get_ydata()) == [step.objective for step in result.steps]
    (marked,) = [line for line in upper.lines if line.get_label() == "returned point"]
    assert marked.get_xdata()[0] == ends[result.best.number]
    names = {line.get_label() for line in lower.lines}
    assert {"delta", "mu", "largest product", "largest |min(first, second)|"} <= names
    delta = next(line for line in lower.lines if line.get_label() == "delta")
    path = [values for _, values in result.steps[0].path]
    assert list(delta.get_ydata())[: len(path)] == path
    assert lower.get_yscale() == "log"
    figure.canvas.draw()


# --------------------------------------------------------------------
# Drawing from plain arrays: which times are drawn, and where.


def test_snapshots_follow_motion_not_time() -> None:
    # A point that rests for nine tenths of the time and then moves steadily.
    place = np.concatenate([np.zeros(90), np.linspace(0, 1, 11)])
    chosen = evenly_moved(np.stack([place, 0 * place], axis=-1)[:, None, :], snapshots=6)
    assert place[chosen] == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
