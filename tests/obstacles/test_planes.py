"""Planes per interval and per node, on one scene and from one initial guess."""

import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, solve_once, turning_move

pytestmark = pytest.mark.executable


def solved(norm="sphere"):
    m = turning_move()
    avoid = avoiding(m, between=None)
    avoid.initialize()
    avoid.set_norm(norm)
    solve_once(m)
    return m, avoid


@pytest.fixture(scope="module")
def reference():
    return pyo.value(solved()[0].effort)


def test_both_norms_agree(reference):
    m, avoid = solved("ball")
    assert pyo.value(m.effort) == pytest.approx(reference, rel=1e-5)
    closest = min(exact(m.move, ARROW, WALL, m.move.time))
    # The wall is in the way: the clearance is used up, and kept up to the solver's tolerance.
    assert closest == pytest.approx(0.05, abs=1e-6)
    for (_, _, time), proven in avoid.separation_gaps().items():
        assert 0.05 - 1e-6 <= proven <= exact(m.move, ARROW, WALL, [time])[0] + 1e-9
