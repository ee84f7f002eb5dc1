"""Where a phase starts is what all rows say that tie it to the motion of other phases, however they are written."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, post
from harness.ties import TIES, tie

import pyrobocop_pyomo as rcp


def states(b: Any, x: float | None, y: float | None) -> None:
    b.x, b.y = rcp.State(initial=x), rcp.State(initial=y)
    b.ode(lambda b, t: {b.x: 0.3 * b.y[t], b.y: pyo.cos(2 * b.time_at(t)) - 0.2 * b.y[t]})


def halves(joined: str) -> Any:
    """A motion in two phases on a coarse mesh, from whose start its equations lead far away."""
    m = pyo.ConcreteModel(name=joined)
    m.one = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    m.two = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler", start=m.one)
    states(m.one, 0.0, 1.0)
    states(m.two, None, None)
    ends = {name: m.one.component(name)[m.one.final_time] for name in "xy"}
    m.one.initialize(m.one.simulate(method="scheme"))
    m.two.initialize(m.two.simulate(method="scheme", initial={name: end.value for name, end in ends.items()}))
    tie(m, joined)
    return m


def verified(m: Any) -> Any:
    keep_clear(m.two, rcp.Polytope.box(0.1, 0.1), post(9.0, 9.0), clearance=0.1)
    return m.two.avoid.verify()


def test_linked_phases_drift_as_one_phase_with_the_same_elements_does() -> None:
    whole = pyo.ConcreteModel()
    whole.two = rcp.PhaseBlock(duration=2.0, elements=8, scheme="implicit_euler")
    states(whole.two, 0.0, 1.0)
    whole.two.initialize(whole.two.simulate(method="scheme"))
    (expected,) = verified(whole).body_pairs
    (found,) = verified(halves("link")).body_pairs
    np.testing.assert_allclose(found.interval_deviation, expected.interval_deviation[4:], rtol=1e-6)


@pytest.mark.parametrize("joined", TIES)
def test_rows_that_say_the_same_tie_the_same(joined: str) -> None:
    (expected,) = verified(halves("link")).body_pairs
    (found,) = verified(halves(joined)).body_pairs
    np.testing.assert_allclose(found.interval_deviation, expected.interval_deviation, rtol=1e-9)
    assert found.interval_deviation[0] > 0.15  # as far as the first phase ends from its plan


@pytest.mark.parametrize("joined", ["band", "link"])
def test_a_start_that_the_rows_do_not_determine_is_not_known(joined: str) -> None:
    m = halves(joined)
    if joined == "link":
        (x, y), (x_0, y_0) = ([b.x[t], b.y[t]] for b, t in ((m.one, m.one.final_time), (m.two, m.two.initial_time)))
        m.contradiction = pyo.Constraint(expr=x_0 + y_0 == x + 2.0 * y - m.one.y[0.0] - 0.0368407744)
    report = verified(m)
    assert report.safe is None
    assert str(report).startswith("clear; the motion under the controls was not replayed: phase 'two'")


def test_rows_about_later_states_and_other_starts_tie_nothing() -> None:
    m = halves("none")
    expected = verified(m).body_pairs[0].interval_deviation
    m.budget = pyo.Constraint(expr=sum(m.one.x.values()) + sum(m.two.x.values()) <= 100.0)
    m.beside = pyo.Constraint(expr=m.two.x[m.two.initial_time] >= m.one.x[0.0])
    assert m.two.avoid.verify().safe
    np.testing.assert_array_equal(m.two.avoid.verify().body_pairs[0].interval_deviation, expected)


@pytest.mark.parametrize(("elements", "known"), [(4, False), (40, True)])
def test_equations_that_read_another_phase_need_to_know_its_motion(elements: int, known: bool) -> None:
    """Two phases side by side: the second one repeats what the first one does."""
    m = pyo.ConcreteModel()
    m.leader = a = rcp.PhaseBlock(duration=1.0, elements=elements, scheme="radau", stages=2)
    m.follower = b = rcp.PhaseBlock(duration=1.0, elements=elements, scheme="radau", stages=2)
    a.x = rcp.State(initial=0.0)
    a.ode(lambda a, t: {a.x: 1.0 - 5.0 * a.x[t]})
    b.y = rcp.State(initial=0.0)
    b.ode(lambda b, t: {b.y: m.leader.x[t]})
    a.initialize(a.simulate(method="scheme"))
    b.initialize(b.simulate(method="scheme"))
    keep_clear(b, rcp.Polytope.box(0.1, 0.1), post(9.0, 9.0), lambda b, t: rcp.planar_pose(b.y[t], 0.0), 0.1)
    report = b.avoid.verify()
    assert report.safe is (known or None)
    assert known or "read states of 'leader'" in report.not_replayed
