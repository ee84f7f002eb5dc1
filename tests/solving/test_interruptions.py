"""Ctrl-C in whatever solves several times: it stops there, and what was found is kept."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from harness.observed_runs import interrupt_run
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
