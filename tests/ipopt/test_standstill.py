"""A run that no longer moves from a feasible point is told to stop; one that moves, or is not feasible, goes on."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.ipopt.standstill import ITERATIONS, Standstill


def _records(
    *, restoration: bool = False, objective: float = 0.0, primal: float = 1e-11, step: float = 1e-12, mu: float = 0.0
) -> Iterator[IterationRecord]:
    """Of a run; `objective` and `mu` are what an iteration changes."""
    for i in range(10 * ITERATIONS):
        yield IterationRecord(i, restoration, 1 + i * objective, primal, 1e3, 1e-6 - i * mu, step, 1e12, 1.0, 1.0, 1)


@pytest.mark.parametrize("how", [{}, {"restoration": True, "step": 1e-7, "objective": 1e-8}])
def test_a_run_that_stands_is_stopped(how: dict[str, float]) -> None:
    standstill = Standstill()
    went_on = [standstill(record) for record in _records(**how)]  # type: ignore[arg-type]
    assert went_on.index(False) == ITERATIONS
    assert not all(went_on)


@pytest.mark.parametrize(
    "how",
    [
        {"objective": 1e-6},
        {"step": 1e-6},
        {"mu": 1e-12},
        {"primal": 1e-3},
        {"restoration": True, "primal": 1e-3},
    ],
)
def test_a_run_that_moves_or_is_not_feasible_goes_on(how: dict[str, float]) -> None:
    standstill = Standstill()
    assert all(standstill(record) for record in _records(**how))  # type: ignore[arg-type]
    assert not standstill.reached


def test_the_user_is_asked_first_and_told_of_every_iteration() -> None:
    seen: list[int] = []
    standstill = Standstill(lambda record: bool(seen.append(record.iteration)) or record.iteration < 7)
    assert [standstill(record) for record in _records()].index(False) == 7
    assert seen[:8] == list(range(8))
    assert not standstill.reached or len(seen) > ITERATIONS
