"""What plans are compared with: simulations that locate switches, held to closed forms."""

from itertools import pairwise
from math import exp, log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nonsmooth_problems import discs, throw
from nonsmooth_problems.filippov import DelayedRelay, Filippov

SIGN = Filippov(
    rates=lambda x, u, w: np.array([u - (2 * w - 1)]), surface=lambda x: x[0], gradient=lambda x: np.array([1.0])
)

# Rates that round to zero when squared are left out: the integrator's own estimate of its error is 0 / 0 there.
WEAK = st.floats(-0.9, 0.9).filter(lambda u: u == 0 or abs(u) > 1e-100)


@given(start=st.floats(0.1, 2.0), u=WEAK, side=st.sampled_from([-1.0, 1.0]))
def test_a_motion_that_reaches_an_attracting_surface_stays_on_it(start: float, u: float, side: float) -> None:
    arrival = start / (1 - u * side)
    times = [0.0, arrival / 2, arrival, arrival + 1]
    x = SIGN.simulate(times, [u] * 3, [side * start])[:, 0]
    assert x == pytest.approx([side * start, side * start / 2, 0, 0], abs=1e-9)


@given(hold=WEAK, leave=st.floats(1.1, 3.0))
def test_sliding_ends_when_the_control_wins(hold: float, leave: float) -> None:
    x = SIGN.simulate([0.0, 1.0, 2.0, 3.0], [hold, leave, -leave], [0.0])[:, 0]
    assert x[:3] == pytest.approx([0, 0, leave - 1], abs=1e-9)
    back = (leave - 1) / (leave + 1)  # until the surface is met again, with the slower rate beyond it
    assert x[3] == pytest.approx(-(leave - 1) * (1 - back), abs=1e-9)


def test_a_thermostat_without_inertia_switches_when_the_logarithms_say() -> None:
    relay = DelayedRelay(rates=lambda x, u, w: 2 * (1 - w) - x, signal=lambda x: x[0], on=1.0, off=0.5)
    warm, cool, rewarm = log(2), log(2), log((2 - 0.5) / (2 - 1))
    expected = np.cumsum([warm, cool, rewarm, cool])
    states, switches = relay.simulate([0.0, float(expected[-1]) + 0.1], [0.0], [0.0], output=0.0)
    assert switches == pytest.approx(expected, abs=1e-8)
    assert states[-1, 0] == pytest.approx(2 - 1.5 * exp(-0.1), abs=1e-8)


def test_catching_up_never_overlaps_and_keeps_the_symmetry() -> None:
    times, push = np.linspace(0, 4, 21), np.tile([0.75, 0.0], (20, 1))
    states = discs.catch_up(times, push)
    p, upper, lower = states[:, :2], states[:, 2:4], states[:, 4:]
    assert np.linalg.norm(upper - p, axis=1).min() >= 1 - 1e-9
    assert np.abs(p[:, 1]).max() < 1e-12
    assert upper == pytest.approx(lower * [1, -1], abs=1e-12)
    assert upper[-1, 1] > upper[0, 1] + 0.1  # it was pushed aside


@given(v=st.floats(0.5, 3.0), w=st.floats(0.1, 1.0))
def test_a_thrown_puck_never_sinks_and_stops_where_the_formula_says(v: float, w: float) -> None:
    path = throw.motion(v, w, np.linspace(0, 5, 400))
    assert path[:, 1].min() >= 0
    assert all(after >= before for before, after in pairwise(path[:, 0]))
    stop = 2 * v * w / throw.GRAVITY + max(0.0, v - throw.FRICTION * w) ** 2 / (2 * throw.FRICTION * throw.GRAVITY)
    assert path[-1, 0] == pytest.approx(stop)
