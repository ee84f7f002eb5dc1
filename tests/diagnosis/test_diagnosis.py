"""The report itself: counts and words. Who is found is in the catalogue."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import contents, with_phase
from harness.scenes import avoiding, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Severity
from pyrobocop_pyomo.errors import ModelError


def pushing(**options: Any) -> pyo.ConcreteModel:
    """A mass with a force, a pair that stops it, and two rows of very different size."""
    m, b = with_phase("p", "pushing", **{"elements": 5, "stages": 2, **options})
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0)
    b.stop = rcp.Algebraic(bounds=(0, None))
    b.u = rcp.Control(bounds=(-50, 50))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - b.stop[t]})
    b.complementarity(lambda b, t: rcp.complements(2 - b.x[t] >= 0, b.stop[t] >= 0))
    b.constraint(lambda b, t: 1e7 * b.u[t] <= 4e8)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def test_counts_are_those_of_the_model() -> None:
    phase, whole = rcp.diagnose(pushing()).counts
    assert whole.startswith("pushing: ")
    assert phase == (
        f"p: {2 * 11 + 10 + 10} variables (3 fixed), 20 equalities, 10 inequalities, 10 pairs: "
        f"{42 - 3 - 20} degrees of freedom (10 in controls)"
    )


def test_relaxed_or_not_the_pairs_are_counted_once() -> None:
    m = pushing()
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m)
    assert all(" 10 pairs: " in counts for counts in rcp.diagnose(m).counts)


@pytest.mark.parametrize("duration", [1.0, rcp.Duration(bounds=(0.5, 2))], ids=["fixed", "free"])
def test_nothing_is_changed(duration: Any) -> None:
    m = pushing(duration=duration)
    before = contents(m), [(v.value, v.fixed, v.bounds, v.stale) for v in m.component_data_objects(pyo.Var)]
    rcp.diagnose(m)
    assert (contents(m), [(v.value, v.fixed, v.bounds, v.stale) for v in m.component_data_objects(pyo.Var)]) == before


def test_the_report_begins_with_the_worst() -> None:
    m = pushing()
    m.switch = pyo.Constraint(expr=m.p.x[1.0] * m.p.u[1.0] == 0)
    m.second = pyo.Objective(expr=m.p.x[1.0])
    diagnosis = rcp.diagnose(m)
    assert [finding.severity for finding in diagnosis.findings] == [Severity.ERROR, Severity.WARNING]
    text = str(diagnosis)
    assert text.startswith("Diagnosis of 'pushing': 1 error, 1 other finding")
    assert "18 degrees of freedom (10 in controls)" in text
    assert "- error: 2 objectives are active: 'cost', 'second'." in text
    assert "- warning: constraint 'switch' states that a product is zero" in text
    assert diagnosis.findings[1].components == ("switch",)
    with pytest.raises(ModelError, match="'pushing': error: 2 objectives"):
        diagnosis.raise_for_errors()
    m.second.deactivate()
    rcp.diagnose(m).raise_for_errors()


def test_a_variable_without_value_is_remarked_and_spoils_nothing() -> None:
    m = pushing()
    m.z = pyo.Var()
    m.row = pyo.Constraint(expr=m.z == m.p.x[1.0])
    diagnosis = rcp.diagnose(m)
    assert diagnosis.errors == []
    assert diagnosis.remarks == ("rows that hold a variable without a value: z",)


def test_several_phases_at_once_are_refused() -> None:
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock([1, 2])
    with pytest.raises(ModelError, match="'p' is no model and no single phase"):
        rcp.diagnose(m.p)
    assert rcp.diagnose(m.p[1]).counts[0].startswith("p[1]: ")


@pytest.mark.parametrize("emptied", [False, True])
def test_what_has_no_value_yet_is_said_once_and_not_logged(emptied: bool, caplog: pytest.LogCaptureFixture) -> None:
    m = turning_move()
    if emptied:
        for variable in m.component_data_objects(pyo.Var):
            variable.set_value(None if not variable.fixed else variable.value, skip_validation=True)
    avoiding(m)
    assert "not checked: rows that hold a variable without a value: move.avoid" in str(rcp.diagnose(m))
    assert caplog.records == []
