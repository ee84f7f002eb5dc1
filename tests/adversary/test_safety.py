"""What is called safe is clear, however a motion is spoilt between the points; and the judge that says so sees it."""

from __future__ import annotations

import numpy as np
import pytest

import pyrobocop_pyomo as rcp

from .safety import CLEARANCE, DOCUMENTED, SPOILERS, UNSPOILT, Verdict, nothing, smallest_distance, tried

ROUNDS = 2

pytestmark = pytest.mark.ipopt


@pytest.mark.slow
@pytest.mark.parametrize(
    "spoiler",
    [name for name in SPOILERS if name not in DOCUMENTED],
)
def test_what_is_called_safe_is_clear(spoiler: str) -> None:
    first = list(SPOILERS).index(spoiler)
    trials = [tried(first + turn * len(SPOILERS)) for turn in range(ROUNDS)]
    assert not [str(trial) for trial in trials if trial.verdict is Verdict.FAULT]
    if spoiler in UNSPOILT:
        assert [trial.verdict for trial in trials].count(Verdict.TRUE) >= ROUNDS - 1


@pytest.mark.parametrize("seed", [50489, 50965])
def test_a_step_of_a_fifteenth_of_an_element_is_seen(seed: int) -> None:
    """It lies between the stages of longer steps of the integration."""
    assert tried(seed).verdict in (Verdict.NOT_SAFE, Verdict.TRUE)


def test_the_judge_sees_what_a_control_leads_to() -> None:
    motion = nothing(np.random.default_rng(3))
    assert rcp.solve(motion.model, progress=False).safe
    assert smallest_distance(motion) >= 0.99 * CLEARANCE
    for variable in motion.phases[0].u.values():
        variable.set_value(variable.value + 1.0)
    assert smallest_distance(motion) < 0.5 * CLEARANCE
