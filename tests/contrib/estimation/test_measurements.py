"""Measurements labelled for parmest; `test_estimate` compares its answers with ours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EstimationError

pandas = pytest.importorskip("pandas")

TIMES = np.array([0.1, 0.33, 0.8, 1.1, 2.0])


def decay(start: float = 1.0, duration: Any = 2.0) -> Any:
    m = pyo.ConcreteModel("decay")
    m.tank = b = rcp.PhaseBlock(duration=duration, elements=5)
    b.c = rcp.State(initial=start, initial_guess=start)
    b.flow = rcp.Control(initial_guess=lambda t: t)
    b.rate = rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
    b.ode(lambda b, t: {b.c: -b.rate * b.c[t]})
    b.flow.fix()
    return m


def data(start: float = 1.0) -> dict[str, Any]:
    return {"time": TIMES, "c": start * np.exp(-0.7 * TIMES)}


def test_labels_hold_polynomials_at_the_times_of_the_data() -> None:
    m = decay()
    m.tank.initialize(c=lambda t: t**3)
    frame = pandas.DataFrame({"c": TIMES, "flow": -TIMES}, index=TIMES)
    assert rcp.label_measurements(m, m.tank, frame, error={"c": 0.1, "flow": 0.2}, unknown=["rate"]) is m
    predicted = [pyo.value(each) for each in m.experiment_outputs]
    start_fixed = [t**3 for t in TIMES]  # the fixed initial value 1 bends the first element only
    assert predicted[2:5] == pytest.approx(start_fixed[2:], abs=1e-12)
    assert predicted[5:] == pytest.approx(TIMES, abs=1e-12)
    assert list(m.experiment_outputs.values()) == [*TIMES, *-TIMES]
    assert list(m.measurement_error.values()) == [0.1] * 5 + [0.2] * 5
    assert [(each.name, number) for each, number in m.unknown_parameters.items()] == [("tank.rate", 1.0)]
    assert m.tank.c_measured[0.33].index() == 0.33


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data": {"time": [1, 2], "c": [1, np.nan]}}, "the data of 'c' are missing or have a time twice"),
        ({"data": {"time": [1, 1], "c": [1, 1]}}, "the data of 'c' are missing or have a time twice"),
        ({"data": {"time": [1, 3], "c": [1, 1]}}, "measured at t = 3; the phase runs from 0 to 2"),
        ({"outputs": ["flow"]}, "has no data of flow; it has c"),
        ({"unknown": ["mass"]}, "there is no parameter 'mass'; there are rate"),
        ({"error": {"x": 1}}, "has an error for 'x', but no data of it"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    m = decay()
    with pytest.raises(EstimationError, match=message):
        rcp.label_measurements(m, m.tank, **{"data": data(), **changes})
    assert m.component("experiment_outputs") is None


def two_tanks() -> Any:
    m = pyo.ConcreteModel("two tanks")
    m.tank = rcp.PhaseBlock(duration=2.0, elements=5)
    m.second = rcp.PhaseBlock(duration=1.0, start=m.tank, elements=3)
    for b in (m.tank, m.second):
        b.c, b.rate = rcp.State(initial_guess=1.0), rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
        b.ode(lambda b, t: {b.c: -b.rate * b.c[t]})
    m.tank.c.at_start.fix(1.0)
    m.link = rcp.Link(m.tank, m.second, parameters=["rate"])
    rcp.label_measurements(m, m.tank, data(), error=0.01)
    later = {"time": [2.2, 3.0], "c": np.exp(-0.7 * np.array([2.2, 3.0]))}
    return rcp.label_measurements(m, m.second, later, error=0.02, unknown=[])


def test_several_phases_of_a_model_are_labelled() -> None:
    m = two_tanks()
    assert [each.parent_block().name for each in m.experiment_outputs] == ["tank"] * 5 + ["second"] * 2
    assert list(m.measurement_error.values()) == [0.01] * 5 + [0.02] * 2
    assert [each.name for each in m.unknown_parameters] == ["tank.rate"]


@pytest.mark.ipopt
def test_a_parameter_is_estimated_from_the_data_of_two_phases() -> None:
    found = rcp.estimate([two_tanks()])
    assert found.estimates["tank.rate"] == pytest.approx(0.7, abs=1e-4)


def test_a_model_is_labelled_once_and_knows_its_times() -> None:
    m = decay()
    rcp.label_measurements(m, m.tank, data())
    with pytest.raises(EstimationError, match="phase 'tank': 'c' is labelled already"):
        rcp.label_measurements(m, m.tank, data())
    m = decay(duration=rcp.Duration(bounds=(1, 3)))
    with pytest.raises(EstimationError, match="give it a fixed start and duration"):
        rcp.label_measurements(m, m.tank, data())
