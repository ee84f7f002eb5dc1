"""When paths of cars are searched for as starts of plans, and when not."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any

import pytest
from obstacle_problems.scattered import scattered

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.planning.recovery import Recovery

IN_VAIN = SimpleNamespace(
    constraint_violation=1.0, quality=rcp.Quality.INFEASIBLE, stop_reason=rcp.StopReason.ITERATION_LIMIT
)
PLANNING = SimpleNamespace(
    solve=lambda purpose, **_: IN_VAIN,
    may_go_on=lambda result: True,
    seconds_left=lambda: math.inf,
    solve_without_obstacles=lambda: False,
)


@pytest.mark.parametrize("is_for_a_start", [True, False])
def test_no_path_is_searched_twice_in_vain(is_for_a_start: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not farther from obstacles where there is none near them, and not for a start that another mesh improves."""
    m = scattered("unicycle", 6, 100, 20)
    m.move.avoid.initialize()
    recovery = Recovery(m, [m.move.avoid], [], PLANNING)
    recovery.is_for_a_start = is_for_a_start
    searched: list[float] = []

    def in_vain(*_: Any, clearance: float, **__: Any) -> None:
        searched.append(clearance)
        raise rcp.errors.InitialGuessError("none")

    monkeypatch.setattr("pyrobocop_pyomo.contrib.vehicles.recognised_car.staged_search", in_vain)
    count = sum(step() is not None for step in itertools.islice(recovery.steps(), 3))
    assert count == (2 if is_for_a_start else 3)
    assert len(searched) == (0 if is_for_a_start else 1)
