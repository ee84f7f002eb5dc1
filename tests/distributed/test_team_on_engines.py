"""A team of rod and robots gives the same iterates wherever its agents live, whatever dies, and from its file."""

import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from harness.mpi import needs_mpiexec, on_three_ranks, told
from pushing_team import pushing_team
from tiny_agents import worker_ids

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.rounds import Order
from pyrobocop_pyomo.execution.engines import dask_engine

pytestmark = [pytest.mark.slow, pytest.mark.casadi]
METHOD = rcp.teams.Hub(rounds=8)
posix = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")


@pytest.fixture(scope="module")
def serial() -> rcp.teams.TeamResult:
    return pushing_team().solve(METHOD, progress=False)


def same(one: rcp.teams.TeamResult, other: rcp.teams.TeamResult) -> bool:
    rounds = zip(one.rounds, other.rounds, strict=True)
    return (
        all(np.array_equal(one.values[name], other.values[name]) for name in other.values)
        and all(np.array_equal(one.agreed[name], other.agreed[name]) for name in other.agreed)
        and all(np.array_equal(a.disagreement, b.disagreement) and a.objective == b.objective for a, b in rounds)
    )


@posix
def test_a_killed_worker_changes_nothing(serial: rcp.teams.TeamResult) -> None:
    pytest.importorskip("distributed")
    engine = dask_engine(workers=2)
    times: list[float] = []

    def kill(record: rcp.teams.Round) -> None:
        times.append(time.perf_counter())
        if record.number == 2:
            os.kill(max(worker_ids()), signal.SIGKILL)

    result = pushing_team().solve(METHOD, engine=engine, on_round=kill, progress=False)
    assert same(result, serial)
    assert max(np.diff(times)) < 10


@needs_mpiexec
def test_a_killed_job_of_mpi_goes_on_from_its_file(serial: rcp.teams.TeamResult, tmp_path: Path) -> None:
    script = Path(__file__).with_name("mpi_team.py")
    assert on_three_ranks(script, tmp_path, 3) != 0
    assert on_three_ranks(script, tmp_path, -1) == 0
    rounds, values = told(tmp_path)
    assert rounds in (4, 5)
    for name, expected in serial.values.items():
        assert np.abs(np.array(values[name]) - expected).max() <= 1e-12


def test_a_state_is_all_that_a_later_solve_depends_on() -> None:
    """Also after a solve that failed."""
    spec = next(spec for spec in pushing_team(steps=6).problem_specs() if spec.name == "a")
    shared = spec.build().facts().quantities
    penalties = np.concatenate([np.full(len(quantity.keys), quantity.penalty) for quantity in shared])
    first = Order(np.zeros(penalties.size), penalties, 0.1, tolerance=0.1)
    second, third = (replace(first, mu=mu, tolerance=mu) for mu in (0.05, 0.03))
    broken = replace(second, linear=np.full(penalties.size, np.nan))
    for orders in ([broken], [first, second], [first, broken, third, broken]):
        straight, elsewhere = spec.build(), spec.build()
        usable = [straight.solve(order).usable for order in orders]
        assert usable == [order is not broken for order in orders]
        elsewhere.restore(straight.state())
        here, there = straight.solve(third), elsewhere.solve(third)
        assert here.values.tolist() == there.values.tolist()
        assert here.iterations == there.iterations
