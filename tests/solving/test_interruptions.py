"""Ctrl-C in whatever solves several times: it stops there, and what was found is kept."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import interrupt_run
from harness.timed_models import sequence_of_pushes
from known_mpccs import mpcc_problem
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import TerminationCondition

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.solving import PersistentNLP

pytestmark = pytest.mark.casadi


@pytest.mark.parametrize("run", [3, 7])
def test_several_starts_end_where_they_were_interrupted(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = interrupt_run(monkeypatch, run)
    m = mpcc_problem("bard1").build()
    found = rcp.studies.multistart(m, 6, progress=False)
    assert len(runs) == run + 1
    assert len(found) + len(found.remaining) == 6
    assert len(found.remaining) >= 1
    (cost,) = m.component_data_objects(pyo.Objective)
    assert pyo.value(cost) == pytest.approx(found.best.objective)


def swing(mesh: Any) -> pyo.ConcreteModel:
    """A smooth motion whose error needs several meshes."""
    m = pyo.ConcreteModel(name="swing")
    m.phase = b = rcp.PhaseBlock(duration=3.0, mesh=mesh)
    b.q, b.v = rcp.State(initial=2.0), rcp.State(initial=0.0)
    b.u = rcp.Control(bounds=(-1, 1))
    b.ode(lambda b, t: {b.q: b.v[t], b.v: b.u[t] - 9.81 * pyo.sin(b.q[t])})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.q[t] ** 2 + 0.1 * b.u[t] ** 2))
    return m


@pytest.mark.parametrize("run", [0])
def test_refinement_ends_with_the_mesh_that_was_interrupted(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(rcp.studies.solve_refined(swing, 1e-7, elements=5, progress=False)) > 2
    runs = interrupt_run(monkeypatch, run)
    found = rcp.studies.solve_refined(swing, 1e-7, elements=5, progress=False)
    assert len(runs) == run + 1
    assert len(found) == run + 1
    assert found.result.stop_reason is rcp.StopReason.INTERRUPTED


@pytest.mark.parametrize("run", [0, 2, 5])
def test_sequences_of_phases_end_where_they_were_interrupted(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = interrupt_run(monkeypatch, run)
    sequences = rcp.studies.mode_sequences(["soft", "hard"], [2])
    ranking = rcp.studies.solve_sequences(sequence_of_pushes, sequences, exploration=0, progress=False)
    assert len(runs) == run + 1
    assert all(outcome.result.stop_reason is not rcp.StopReason.INTERRUPTED for outcome in ranking)
    assert len(ranking) < len(sequences)


def test_a_persistent_program_goes_on_after_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    m = pyo.ConcreteModel()
    m.start, m.x = pyo.Param(initialize=1.0, mutable=True), pyo.Var(initialize=0.0)
    m.cost = pyo.Objective(expr=(m.x - m.start) ** 4 + m.x**2)
    kept = PersistentNLP(m)
    assert kept.solve().status.solved
    with monkeypatch.context() as pressed:
        interrupt_run(pressed, 0)
        m.start = 5.0
        assert kept.solve().status is IpoptStatus.INTERRUPTED
    assert kept.solve().status.solved


def test_pyomos_interface_tells_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    interrupt_run(monkeypatch, 0)
    results = SolverFactory("pyrobocop.mpcc").solve(
        mpcc_problem("bard1").build(), load_solutions=False, raise_exception_on_nonoptimal_result=False
    )
    assert results.termination_condition is TerminationCondition.interrupted
