"""Executors, a pool of processes and Dask: the same reports wherever they send an agent, and when one is killed."""

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from test_process_engine import ends_within
from tiny_agents import (
    NAMES,
    SPECS,
    TinyOrder,
    TinySpec,
    missing_data,
    play,
    play_and_kill,
    undisturbed,
    worker_ids,
)

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.execution.engine import AgentFailure
from pyrobocop_pyomo.execution.engines import ExecutorEngine, dask_engine

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows"),
]


@pytest.fixture
def pool() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(2, multiprocessing.get_context("forkserver")) as executor:
        yield executor


def test_a_pool_of_processes_gives_the_same_reports_and_says_when_it_is_broken(pool: ProcessPoolExecutor) -> None:
    expected, _ = undisturbed(8)
    engines = [ExecutorEngine(pool, workers=2) for _ in range(2)]
    for engine in engines:
        engine.start(SPECS)
    for first in (0, 4):  # in turn, so that neither finds its agents as it has left them
        for engine in engines:
            assert play(engine, first + 4, first=first) == expected[first : first + 4]
    message = r"takes no more work \(BrokenProcessPool.*engine='process', which goes on"
    with pytest.raises(EngineError, match=message):
        engines[0].solve({"a": TinyOrder(np.ones(5), "die")})
    with pytest.raises(EngineError, match=message):
        engines[1].solve({"a": TinyOrder(np.ones(5))})


def test_a_task_that_ends_its_worker_is_given_up_and_the_caller_goes_on() -> None:
    with ThreadPoolExecutor(2) as executor:
        engine = ExecutorEngine(executor, workers=2)
        engine.start(SPECS)
        found = engine.solve({"a": TinyOrder(np.ones(5), "exit")})
        assert isinstance(found["a"], AgentFailure)
        assert not isinstance(engine.solve({"b": TinyOrder(np.ones(5))})["b"], AgentFailure)


# ---------------------------------------------------------------- Dask; one cluster for all tests


@pytest.fixture(scope="module")
def engine() -> Iterator[ExecutorEngine]:
    pytest.importorskip("distributed")
    with dask_engine(workers=2) as started:
        started.start(SPECS)
        yield started
        ids = worker_ids()
    assert ends_within(3, ids)


def test_the_same_reports_when_a_worker_is_killed(engine: ExecutorEngine) -> None:
    play_and_kill(engine, max(worker_ids()))
    engine._executor._client.wait_for_workers(2)  # Dask starts another in its place


def test_it_listens_here_only(engine: ExecutorEngine) -> None:
    psutil = pytest.importorskip("psutil")
    workers = [c for p in map(psutil.Process, worker_ids()) for c in p.net_connections("tcp")]
    assert {c.laddr.ip for c in workers if c.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    client = engine._executor._client
    scheduler = client.cluster.scheduler
    assert scheduler.address.startswith("tcp://127.0.0.1:")
    assert [s.getsockname()[0] for s in scheduler.http_server._sockets.values()] == ["127.0.0.1"]
    assert set(client.run(os.environ.get, "OMP_NUM_THREADS").values()) == {"1"}


def test_workers_do_not_hear_ctrl_c(engine: ExecutorEngine) -> None:
    """In a terminal it reaches the whole group of processes."""
    before = sorted(worker_ids())
    for process_id in before:
        os.kill(process_id, signal.SIGINT)
    engine.call_all("shift", {"a": (0,)})
    assert sorted(worker_ids()) == before


def test_failures_and_a_client_of_ones_own(engine: ExecutorEngine) -> None:
    client = engine._executor._client
    second = ExecutorEngine(client.get_executor(), workers=2, deaths_allowed=0)
    with pytest.raises(EngineError, match="agent 'a' could not be built: LookupError"):
        second.start([TinySpec("a", missing_data)])
    assert second.start(SPECS[:2])["a"]["size"] == 5
    failed = second.solve({"a": TinyOrder(np.ones(5), "raise")})["a"]
    assert (failed.reason, failed.final) == ("ArithmeticError: log(-1)", False)
    reports = second.solve({"a": TinyOrder(np.ones(5), "die"), "hub": TinyOrder(np.ones(5))})
    assert isinstance(reports["a"], AgentFailure)
    assert reports["a"].final
    assert "its worker died 1 times; Attempted to run task" in reports["a"].reason
    assert reports["hub"].solves == 1
    second.stop()
    assert client.status == "running"  # is not ours to close
    reports = engine.solve({name: TinyOrder(np.ones(5)) for name in NAMES})  # it goes on with what it had
    assert [report.solves for report in reports.values()] == [9, 9, 9, 9]


def test_bad_arguments() -> None:
    with pytest.raises(EngineError, match="workers = 0"):
        dask_engine(workers=0)
