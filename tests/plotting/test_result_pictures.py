"""Pictures of results: what is drawn where, and refusals."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.plotting import plot_history

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


def test_runs_of_one_kind_share_a_line_of_the_list():
    labels = ["a", "a", "b", "a"]
    figure = plot_history("t", np.arange(1.0, 5.0), labels, np.arange(4.0), {}, {}, 3)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert "1-2 a\n3 b\n4 a" in texts


def test_many_kinds_of_runs_are_cut_short():
    labels = [f"kind {i}" for i in range(20)]
    figure = plot_history("t", np.arange(1.0, 21.0), labels, np.arange(20.0), {}, {}, 0)
    assert figure.axes[0].texts[-1].get_text().endswith("... 20 runs")
