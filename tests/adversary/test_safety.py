"""What is called safe is clear, however a motion is spoilt between the points; and the judge that says so sees it."""

from typing import Any

import numpy as np
import pytest

import pyrobocop_pyomo as rcp

from .motions import CLEARANCE, DOCUMENTED, SPOILERS, WITHOUT_PAIRS, nothing, nothing_with_pairs
from .safety import Verdict, smallest_distance, tried

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
    if spoiler in WITHOUT_PAIRS:
        assert [trial.verdict for trial in trials].count(Verdict.TRUE) >= ROUNDS - 1


@pytest.mark.parametrize("seed", [50489, 50965])
def test_a_step_of_a_fifteenth_of_an_element_is_seen_or_not_known(seed: int) -> None:
    """It lies between the stages of longer steps of the integration."""
    assert tried(seed, "step_in_time").verdict in (Verdict.NOT_SAFE, Verdict.TRUE, Verdict.NOT_KNOWN)


@pytest.mark.parametrize(("stated", "by"), [(nothing, 1.0), (nothing_with_pairs, 20.0)])
def test_the_judge_sees_what_a_control_leads_to(stated: Any, by: float) -> None:
    motion = stated(np.random.default_rng(3))
    assert rcp.solve(motion.model, progress=False).safe
    assert smallest_distance(motion) >= 0.99 * CLEARANCE
    for variable in motion.phases[0].u.values():
        variable.set_value(variable.value + by, skip_validation=True)
    assert smallest_distance(motion) < 0.5 * CLEARANCE
