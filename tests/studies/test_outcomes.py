"""What studies give back agrees: `best`, `result`, `reached`, `remaining`, the table and the data frame."""

import json
from dataclasses import replace
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import integrator
from harness.safety_reports import report_of_a_collision

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.studies.outcomes import Outcome, StudyResult
from pyrobocop_pyomo.studies.sweep import outcome_from_json, outcome_to_json
from pyrobocop_pyomo.studies.sweep_cases import SweepCase

pytestmark = pytest.mark.casadi


def build() -> Any:
    m, b = integrator(x={"initial": 0}, u={"bounds": (-9, 9)}, elements=10)
    m.goal = pyo.Param(initialize=1.0, mutable=True)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2) + (b.x[b.final_time] - m.goal) ** 2)
    return m


STUDIES = {
    "multistart": lambda: rcp.studies.multistart(build(), 2),
    "sweep": lambda: rcp.sweep(build(), [{"goal": 1.1}, {"goal": 1.0}]),
}


@pytest.fixture(scope="module", params=STUDIES)
def study(request: pytest.FixtureRequest) -> StudyResult:
    return STUDIES[request.param]()


def test_the_best_outcome_answers_the_study(study: StudyResult) -> None:
    assert study.best in list(study)
    assert study.result is study.best.result
    assert study.result.objective == pytest.approx(0.5, abs=1e-6)
    assert study.reached is True
    assert study.remaining == ()
    study.raise_for_status()


def test_a_sequence_of_outcomes_adds_up(study: StudyResult) -> None:
    assert [study[k] for k in range(len(study))] == list(study) == list(study.outcomes)
    assert study.iterations == sum(outcome.result.iterations for outcome in study)
    assert study.seconds >= 0.99 * sum(outcome.seconds for outcome in study)
    for outcome in study:
        assert (outcome.feasible, outcome.verdict, outcome.reason, outcome.cut_short) == (True, "optimal", "", False)


def test_the_table_and_the_frame_have_a_row_per_outcome(study: StudyResult) -> None:
    pytest.importorskip("pandas")
    header, *rows = study.table().splitlines()
    assert len(rows) == len(study)
    assert study.table() in str(study)
    frame = study.to_pandas()
    assert len(frame) == len(study)
    assert list(frame.columns)[-6:] == list(study[0].row())
    assert header.split()[0] == frame.index.name
    assert list(frame["objective"]) == [outcome.objective for outcome in study]


def test_what_a_file_has_of_a_motion_that_is_not_safe_is_not_solved() -> None:
    result = rcp.solve(build())
    unsafe = replace(result, safety=report_of_a_collision(), standing=replace(result.standing, shortfall=1.0))
    outcome = Outcome.of(SweepCase(0, "near", {"goal": 1.0}), unsafe)
    again = outcome_from_json(outcome.case, json.loads(json.dumps(outcome_to_json(outcome))))
    assert (again.solved, again.reason) == (outcome.solved, outcome.reason) == (False, outcome.reason)
