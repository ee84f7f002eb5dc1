"""Pictures of results: what is drawn where, and refusals."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.plotting import plot_history, plot_pair_sides, plot_products

pytest.importorskip("matplotlib")


def chain(index) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="chain")
    m.i = pyo.Set(initialize=index, dimen=None)
    m.a = pyo.Var(m.i, bounds=(0, None), initialize=1)
    m.b = pyo.Var(m.i, bounds=(0, None), initialize=1)
    m.one = rcp.Complementarity(m.i, rule=lambda m, *i: rcp.complements(m.a[i], m.b[i]))
    m.cost = pyo.Objective(expr=sum((m.a[i] - 1 - n) ** 2 + (m.b[i] - 1) ** 2 for n, i in enumerate(m.i)))
    return m


@pytest.fixture(scope="module")
def result() -> rcp.SolveResult:
    return rcp.solve(chain([0.1, 0.3, 0.2]))


@pytest.mark.casadi
def test_the_history_has_every_run_and_marks_the_returned_one(result):
    figure = result.plot()
    upper, lower = figure.axes
    (objective,) = [line for line in upper.lines if line.get_label() != "returned point"]
    ends = np.cumsum([step.iterations for step in result.steps])
    assert list(objective.get_xdata()) == list(ends)
    assert list(objective.get_ydata()) == [step.objective for step in result.steps]
    (marked,) = [line for line in upper.lines if line.get_label() == "returned point"]
    assert marked.get_xdata()[0] == ends[result.best_step]
    names = {line.get_label() for line in lower.lines}
    assert {"delta", "mu", "largest product", "largest |min(first, second)|"} <= names
    delta = next(line for line in lower.lines if line.get_label() == "delta")
    path = [values for _, values in result.steps[0].path]
    assert list(delta.get_ydata())[: len(path)] == path
    assert lower.get_yscale() == "log"
    figure.canvas.draw()


@pytest.mark.casadi
def test_both_sides_are_drawn_over_a_numeric_index_in_its_order(result):
    figure = result.plot_pairs(axis_label="time [s]")
    first, second = figure.axes
    assert list(first.lines[0].get_xdata()) == [0.1, 0.2, 0.3]
    by_index = {pair.index: pair for pair in result.pairs}
    assert list(first.lines[0].get_ydata()) == [by_index[i].first for i in ("0.1", "0.2", "0.3")]
    assert second.get_xlabel() == "time [s]"
    figure.canvas.draw()


@pytest.mark.casadi
def test_other_indices_become_labels():
    found = rcp.solve(chain([(1, "a"), (2, "b")]))
    axis = found.plot_pairs("one").axes[1]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["1,a", "2,b"]


@pytest.mark.casadi
def test_products_against_delta(result):
    (axis,) = result.plot_products().axes
    drawn = next(line for line in axis.lines if line.get_label() == "largest product")
    bounded = [step for step in result.steps if step.delta]
    assert list(drawn.get_xdata()) == [step.delta for step in bounded]
    assert list(drawn.get_ydata()) == [step.largest_product for step in bounded]


@pytest.mark.casadi
def test_a_component_without_pairs_is_refused(result):
    with pytest.raises(ModelError, match=r"no pairs of a component 'two'. Components with pairs: 'one'"):
        result.plot_pairs("two")


@pytest.mark.casadi
def test_a_model_without_pairs_has_a_history_and_nothing_else():
    m = pyo.ConcreteModel(name="plain")
    m.x = pyo.Var(initialize=0)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    found = rcp.solve(m)
    found.plot().canvas.draw()
    with pytest.raises(ModelError, match="no run bounded products"):
        found.plot_products()
    with pytest.raises(ModelError, match=r"a component has to be chosen. Components with pairs: none"):
        found.plot_pairs()


def test_biactive_places_are_shaded():
    place = np.arange(4.0)
    figure = plot_pair_sides("t", place, np.array([0, 1, 0, 2.0]), np.array([1, 0, 0, 0.0]))
    for axis in figure.axes:
        (span,) = axis.patches
        assert (span.get_x(), span.get_x() + span.get_width()) == (1.5, 2.5)
    assert "biactive" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_pictures_go_where_they_are_asked_to():
    matplotlib = pytest.importorskip("matplotlib.figure")
    figure = matplotlib.Figure()
    ones = np.ones(2)
    assert plot_products("t", ones, ones, ones, figure=figure) is figure
    assert plot_pair_sides("t", np.arange(2.0), ones, ones, figure=matplotlib.Figure()) is not figure


def test_runs_of_one_kind_share_a_line_of_the_list():
    labels = ["a", "a", "b", "a"]
    figure = plot_history("t", np.arange(1.0, 5.0), labels, np.arange(4.0), {}, {}, 3)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert "1-2 a\n3 b\n4 a" in texts


def test_many_kinds_of_runs_are_cut_short():
    labels = [f"kind {i}" for i in range(20)]
    figure = plot_history("t", np.arange(1.0, 21.0), labels, np.arange(20.0), {}, {}, 0)
    assert figure.axes[0].texts[-1].get_text().endswith("... 20 runs")
