"""Measurements labelled for parmest, and a parameter estimated by it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.contrib.parmest import parmest
from pyomo.contrib.parmest.experiment import Experiment

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import DeclarationError

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


class Decay(Experiment):
    def __init__(self, start: float) -> None:
        super().__init__(model=None)
        self.start = start

    def get_labeled_model(self) -> Any:
        m = decay(self.start)
        return rcp.label_measurements(m, m.tank, data(self.start), outputs=["c"], error=0.01)


@pytest.mark.executable
def test_parmest_finds_the_parameter_and_its_variance() -> None:
    estimator = parmest.Estimator([Decay(1.0), Decay(2.0)], obj_function="SSE_weighted")
    objective, found = estimator.theta_est()
    assert found["tank.rate"] == pytest.approx(0.7, abs=1e-5)
    assert objective == pytest.approx(0, abs=1e-5)
    # Of independent errors of 0.01 in start exp(-rate t), by hand.
    information = sum(((start * TIMES * np.exp(-0.7 * TIMES)) ** 2).sum() for start in (1.0, 2.0)) / 0.01**2
    assert estimator.cov_est().to_numpy()[0, 0] == pytest.approx(1 / information, rel=1e-2)


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
        ({"data": {"c": TIMES}}, "the data have no 'time'; they have c"),
        ({"data": 5}, "are a data frame with times as index, or a mapping"),
        ({"data": {"time": TIMES, "c": ["a"] * 5}}, "are a data frame with times as index, or a mapping"),
        ({"data": {"time": TIMES, "c": [1, 2]}}, "the data of 'c' are not 5 finite numbers"),
        ({"data": {"time": TIMES, "c": TIMES * np.nan}}, "the data of 'c' are not 5 finite numbers"),
        ({"data": {"time": [1, 1], "c": [1, 1]}}, "a time twice"),
        ({"data": {"time": [1, 3], "c": [1, 1]}}, "measured at t = 3; the phase runs from 0 to 2"),
        ({"outputs": ["flow"]}, "output 'flow' is not in the data"),
        ({"outputs": ["rate"]}, "output 'rate' is no variable of the phase; the phase has c, flow, the data c"),
        ({"unknown": ["mass"]}, "'mass' is to be estimated; its parameters are rate"),
        ({"error": {"x": 1}}, r"error has \['x'\], the outputs are \['c'\]"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    m = decay()
    with pytest.raises(DeclarationError, match=message):
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
    with pytest.raises(DeclarationError, match="phase 'tank': 'c' is labelled already"):
        rcp.label_measurements(m, m.tank, data())
    m = decay(duration=rcp.Duration(bounds=(1, 3)))
    with pytest.raises(DeclarationError, match="give the phase a fixed duration"):
        rcp.label_measurements(m, m.tank, data())
