"""Dask's actors: the same reports, also when a worker is killed; one cluster for all tests."""

import os
import signal
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tiny_agents import NAMES, SPECS, TinyOrder, TinySpec, missing_data, play, play_and_kill, stop_in_round, undisturbed

from pyrobocop_pyomo.errors import EngineError
from pyrobocop_pyomo.execution.dask_engine import DaskEngine
from pyrobocop_pyomo.execution.engine import AgentFailure

pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows"),
]


@pytest.fixture(scope="module")
def engine() -> Iterator[DaskEngine]:
    with DaskEngine(workers=2) as started:
        started.start(SPECS)
        yield started


def test_the_same_reports_when_a_worker_is_killed(engine: DaskEngine) -> None:
    ids = play_and_kill(engine)
    assert set(engine.process_ids.values()) & set(ids.values()) == {ids["hub"]}
    assert sum(engine.deaths.values()) == 1


def test_a_stopped_worker_costs_its_time_and_nothing_else() -> None:
    expected, _ = undisturbed(5)
    with DaskEngine(workers=2, answer_within=2.0) as engine:
        engine.start(SPECS)
        stopped = engine.process_ids["a"]
        try:
            assert play(engine, 5, stop_in_round(2, stopped)) == expected
            assert sum(engine.deaths.values()) == 1
        finally:
            os.kill(stopped, signal.SIGCONT)


def test_it_listens_here_only(engine: DaskEngine) -> None:
    workers = [c for p in map(psutil.Process, engine.process_ids.values()) for c in p.net_connections("tcp")]
    assert {c.laddr.ip for c in workers if c.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    scheduler = engine._cluster.scheduler
    assert scheduler.address.startswith("tcp://127.0.0.1:")
    assert [s.getsockname()[0] for s in scheduler.http_server._sockets.values()] == ["127.0.0.1"]
    threads = engine._client.run(os.environ.get, "OMP_NUM_THREADS")
    assert set(threads.values()) == {"1"}


def test_workers_do_not_hear_ctrl_c(engine: DaskEngine) -> None:
    """In a terminal it reaches the whole group of processes."""
    before = engine.process_ids
    for process_id in set(before.values()):
        os.kill(process_id, signal.SIGINT)
    engine.call_all("shift", {"a": (0,)})
    assert engine.process_ids == before


def test_an_address_is_all_that_is_needed(engine: DaskEngine) -> None:
    with DaskEngine(engine._cluster.scheduler_address) as second:
        assert second.start(SPECS[:3])["b"]["name"] == "b"
        assert set(second.process_ids.values()) == set(engine.process_ids.values())
    assert engine._client.run(os.getpid)  # is not ours to end


def test_failures_and_a_client_of_ones_own(engine: DaskEngine) -> None:
    client = engine._client
    with DaskEngine(client=client, deaths_allowed=0) as second:
        with pytest.raises(EngineError, match="agent 'a' could not be built: LookupError"):
            second.start([TinySpec("a", missing_data)])
        assert second.start(SPECS[:2])["a"]["size"] == 5
        failed = second.solve({"a": TinyOrder(np.ones(5), "raise")})["a"]
        assert (failed.reason, failed.final) == ("ArithmeticError: log(-1)", False)
        report = second.solve({"a": TinyOrder(np.ones(5), "die")})["a"]
        assert isinstance(report, AgentFailure)
        assert report.final
        assert "its worker died 1 times; worker tcp://127.0.0.1" in report.reason
    assert client.status == "running"  # is not ours to close
    reports: dict[str, Any] = engine.solve({name: TinyOrder(np.ones(5)) for name in NAMES})  # the others live there too
    assert [report.solves for report in reports.values()] == [9, 9, 9, 9]


def test_bad_arguments() -> None:
    with pytest.raises(EngineError, match="not two of these"):
        DaskEngine("tcp://127.0.0.1:8786", workers=2)
    with pytest.raises(EngineError, match="workers = 0"):
        DaskEngine(workers=0)
