"""What the equations do between instants that are looked at: vibrations with the period of a sampling, and gusts."""

from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, on_the_line, post
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp

DURATION = 2.0


def disc(force: Any, elements: int = 5, *, form: str = "explicit") -> Any:
    """A disc that is planned to stand still, beside a post, under a disturbance of which the plan knows nothing."""
    m = pyo.ConcreteModel("disc")
    m.p = b = rcp.PhaseBlock(duration=DURATION, elements=elements)
    b.x, b.v = rcp.State(initial=0.0), rcp.State(initial=0.0)
    b.u = rcp.Control(initial_guess=0.0, history=0.0)
    if form == "explicit":
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + force(t)})
    elif form == "algebraic":
        b.a = rcp.Algebraic(initial_guess=0.0)
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.a[t]})
        b.residual(lambda b, t: b.a[t] == b.u[t] + force(t))
    else:  # no formula for all elements at once: a delay
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] + force(t) + 0.0 * b.u.delayed(t, 0.3)})
    for name in ("x", "v", "u"):
        for variable in b.component(name).values():
            variable.set_value(0.0)
    keep_clear(b, rcp.Polytope.ball(0.1), post(1.0, 0.0), on_the_line)
    return m


def reported(m: Any) -> float:
    return max(float(pair.interval_deviation.max()) for pair in m.p.avoid.verify().body_pairs)


def true_gust(force: Any, at: float, width: float) -> float:
    """How far the disc gets, by SciPy with small steps where the force is quick."""
    state, far, quick = [0.0, 0.0], 0.0, (at - 10 * width, at + 13 * width)
    for start, end in pairwise(np.unique(np.clip([0.0, *quick, DURATION], 0.0, DURATION)).tolist()):
        largest = width / 5 if start >= quick[0] and end <= quick[1] else 0.1
        found = solve_ivp(
            lambda t, s: [s[1], pyo.value(force(float(t)))],
            (start, end),
            state,
            max_step=largest,
            rtol=1e-9,
            atol=1e-13,
        )
        state, far = found.y[:, -1], max(far, float(np.abs(found.y[0]).max()))
    return far


AMPLITUDE = 30.0


def vibration(frequency: float) -> Any:
    return lambda t: AMPLITUDE * pyo.sin(2 * np.pi * frequency * t)


def true_vibration(frequency: float) -> float:
    """The integral twice over; the velocity is never negative, so that the end is farthest."""
    rate = 2 * np.pi * frequency
    return float(AMPLITUDE / rate * (DURATION - np.sin(rate * DURATION) / rate))


def gust(at: float, width: float, kind: str) -> Any:
    strength = 1.0 / width
    if kind == "bell":
        return lambda t: strength * pyo.exp(-(((t - at) / width) ** 2))
    if kind == "steps":
        return lambda t: strength * (pyo.tanh((t - at) / width) - pyo.tanh((t - at - 3 * width) / width))
    return lambda t: pyo.Expr_if(IF=pyo.inequality(at - width, t, at + width), THEN=strength, ELSE=0.0)


def test_a_vibration_with_the_period_of_the_samples_is_seen() -> None:
    frequency = 16 / DURATION
    far = true_vibration(frequency)
    assert 0.9 * far <= reported(disc(vibration(frequency), elements=1)) <= 1.3 * far


@pytest.mark.parametrize("form", ["explicit", "algebraic", "delayed"])
def test_a_gust_of_two_tenths_of_a_millisecond_is_seen(form: str) -> None:
    force = gust(1.037, 1e-4, "choice")
    far = true_gust(force, 1.037, 1e-4)
    assert far > 0.5
    assert 0.9 * far <= reported(disc(force, form=form)) <= 1.3 * far


@settings(max_examples=5, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    at=st.floats(0.2, 1.8),
    exponent=st.floats(-4.0, -1.0),
    kind=st.sampled_from(["bell", "steps", "choice"]),
    elements=st.integers(3, 12),
)
def test_law_gusts_of_any_width_anywhere(at: float, exponent: float, kind: str, elements: int) -> None:
    width = 10.0**exponent
    force = gust(at, width, kind)
    assert reported(disc(force, elements)) >= 0.9 * true_gust(force, at, width)


@settings(max_examples=5, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(frequency=st.floats(1.0, 12.0), elements=st.integers(3, 12))
def test_law_vibrations_of_any_frequency(frequency: float, elements: int) -> None:
    assert reported(disc(vibration(frequency), elements)) >= 0.9 * true_vibration(frequency)


def test_the_motion_under_what_is_too_quick_to_follow_is_unknown() -> None:
    report = disc(vibration(1e5)).p.avoid.verify()
    assert "so quickly with the time" in str(report)


def test_rules_without_time_are_looked_at_as_ever() -> None:
    m = disc(lambda t: 0.0)
    np.testing.assert_allclose(m.p.reintegrate().fractions, np.linspace(0.0, 1.0, 17))
