"""Several trajectories, read as one."""

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import mass

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError


def phases() -> pyo.ConcreteModel:
    """x is the time in the first phase, 10 plus the time in the second; u and y are in one of them only."""
    m = pyo.ConcreteModel()
    m.a = rcp.PhaseBlock(duration=2, start=1, elements=2, stages=2)
    m.a.x = rcp.State(initial_guess=lambda t: t)
    m.a.u = rcp.Control(initial_guess=lambda t: -t)
    m.b = rcp.PhaseBlock(duration=1, elements=2, stages=3)
    m.b.x, m.b.y = rcp.State(initial_guess=lambda t: 13 + t), rcp.State(initial_guess=7)
    m.b.w = rcp.Control(initial_guess=lambda t: t, parametrization="piecewise_constant")
    m.b.k = rcp.Parameter(initial_guess=4)
    return m


def test_the_second_starts_where_the_first_ends_and_jumps_stay() -> None:
    m = phases()
    joined = rcp.join_trajectories([m.a, m.b.trajectory()])
    assert joined.boundaries.tolist() == [1, 3, 4]
    assert joined.duration == 3
    assert joined.names == ["x", "y", "u", "w"]
    assert joined.time[joined.time == 3].size == 2
    assert joined.x[joined.time == 3].tolist() == [3, 13]
    assert np.isnan(joined.y[: len(m.a.time)]).all()
    assert (joined.y[len(m.a.time) :] == 7).all()
    assert joined.u.shape == joined.points.shape
    assert np.isnan(joined.u[-1])
    assert joined.parts[1].k == 4
    assert m.b.trajectory().time[0] == 0


def test_it_interpolates_on_either_side_of_a_boundary() -> None:
    joined = rcp.join_trajectories(phases().component_objects(pyo.Block))
    assert joined(3.0)["x"] == 3
    assert joined(3.0, after=True)["x"] == 13
    values = joined([1, 2.5, 3.25, 4])
    assert values["x"] == pytest.approx([1, 2.5, 13.25, 14])
    assert values["u"][:2] == pytest.approx([-1, -2.5])
    assert np.isnan(values["u"][2:]).all()
    assert joined(4.0, after=True)["x"] == pytest.approx(14)


@pytest.mark.parametrize("t", [0.5, 4.5, float("nan")])
def test_a_time_outside_is_refused(t: float) -> None:
    with pytest.raises(TrajectoryError, match="runs from"):
        rcp.join_trajectories([phases().a, phases().b])(t)


def test_what_is_unknown_is_named() -> None:
    joined = rcp.join_trajectories([phases().a, phases().b])
    with pytest.raises(AttributeError, match="a joined trajectory of 'a', 'b' has no 'z'"):
        _ = joined.z
    with pytest.raises(TrajectoryError, match="has no 'z'; it has x, y, u, w"):
        joined.plot(["z"])
    with pytest.raises(TrajectoryError, match="was given no name of what to draw"):
        joined.plot([])
    with pytest.raises(TrajectoryError, match="no trajectories to join"):
        rcp.join_trajectories([])


def test_a_name_that_is_a_state_in_one_phase_and_a_control_in_another() -> None:
    m = phases()
    m.c = rcp.PhaseBlock(duration=1, elements=1)
    m.c.u = rcp.State(initial_guess=5)
    joined = rcp.join_trajectories([m.a, m.c])
    assert joined.u.shape == joined.time.shape
    assert joined.u[-1] == 5
    assert joined.u[0] == pytest.approx(-1)


def test_a_plot_breaks_lines_and_marks_the_phases() -> None:
    pytest.importorskip("matplotlib")
    joined = rcp.join_trajectories([phases().a, phases().b])
    figure = joined.plot({"x": "position", "u": "force", "w": "push"})
    axes = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_ylabel() for axis in axes] == ["position", "force", "push"]
    line = axes[0].lines[0].get_ydata()
    assert np.isnan(line).any()
    assert np.nanmin(line) == pytest.approx(1)
    assert np.nanmax(line) == pytest.approx(14)
    assert [text.get_text() for text in axes[0].texts] == ["a", "b"]
    assert all(not axis.texts for axis in axes[1:])
    figure.savefig(io.BytesIO())


@pytest.mark.parametrize(
    ("names", "shown"), [(("wide", "narrow"), ["wide", "narrow"]), (("p[1]", "p[2]"), ["p[1]", "p[2]"])]
)
def test_names_that_fit_are_written(names: Any, shown: list[str]) -> None:
    pytest.importorskip("matplotlib")
    assert _texts(names, [0, 1, 2]) == shown


def test_indexed_names_are_shortened_and_what_is_still_too_wide_left_out() -> None:
    pytest.importorskip("matplotlib")
    assert _texts([f"phases[{i}]" for i in range(10)], list(range(11))) == [str(i) for i in range(10)]
    assert _texts(["long", "short"], [0, 0.001, 1]) == ["", "short"]


def _texts(names: Any, boundaries: list[float]) -> list[str]:
    from matplotlib.figure import Figure

    from pyrobocop_pyomo.plotting import mark_phases

    figure = Figure(figsize=(4, 2))
    figure.subplots(1, 1)
    mark_phases(figure, np.array(boundaries, dtype=float), names)
    return [text.get_text() for text in figure.axes[0].texts]


# --------------------------------------------------------------------
# A trajectory says how the solve ended that has left its values: a guess and a failure look like no plan.


def cart(*, limit: float = 10.0) -> pyo.ConcreteModel:
    start = {"initial": 0, "initial_guess": 0}
    control = {"bounds": (-limit, limit), "initial_guess": 0}
    m, b = mass(x={**start, "final": 1}, v={**start, "final": 0}, u=control, duration=1.0, elements=4)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def test_values_that_no_solve_left_say_so(tmp_path: Path) -> None:
    guess = cart().p.trajectory()
    assert "not solved" in repr(guess)
    assert "not solved" in guess._repr_html_()
    assert "not solved" in guess.plot().get_suptitle()
    assert "not solved" in repr(rcp.Trajectory.load(guess.save(tmp_path / "guess")))


@pytest.mark.ipopt
def test_a_solution_says_so_as_do_its_clones_pickles_and_files_and_doubts_are_told(tmp_path: Path) -> None:
    m = cart()
    result = rcp.solve(m)
    for model in (m, m.clone(), pickle.loads(pickle.dumps(m))):
        plan = model.p.trajectory()
        assert plan.outcome == "solved"
        assert "'p', solved," in repr(plan)
        assert plan.plot().get_suptitle() == "p"
    assert rcp.Trajectory.load(plan.save(tmp_path / "plan")).outcome == "solved"
    assert type(result)(**{**vars(result), "doubts": ("something",)}).outcome == "DOUBTFUL"
    # What is changed after a solve is no solution.
    final = m.p.x[m.p.final_time].value
    m.p.x[0.5].set_value(0.3)
    assert "changed since" in repr(m.p.trajectory())
    m.p.remesh(3)
    assert "changed since" in repr(m.p.trajectory())
    rcp.solve(m)
    assert m.p.trajectory().outcome == "solved"
    assert m.p.x[m.p.final_time].value == pytest.approx(final)


@pytest.mark.ipopt
def test_a_failure_is_told_by_repr_and_titles() -> None:
    m = cart(limit=1.0)
    assert not rcp.solve(m).solved
    plan = m.p.trajectory()
    assert "'p', infeasible," in repr(plan)
    assert plan.plot().get_suptitle() == "p (infeasible)"
    joined = rcp.join_trajectories([plan, m.p])
    assert "infeasible" in repr(joined)
    assert "infeasible" in joined.plot().get_suptitle()


@pytest.mark.ipopt
def test_a_point_that_a_study_loads_is_that_of_its_result() -> None:
    m = cart()
    several = rcp.studies.multistart(m, starts=2)
    assert m.p.trajectory().outcome == "solved"
    m.p.x[0.5].set_value(0.3)
    several.load(1)
    assert m.p.trajectory().outcome == several.outcomes[1].result.outcome == "solved"
