"""Processes that are killed, interrupted or left alone."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tiny_agents import (
    NAMES,
    SPECS,
    TinyOrder,
    TinySpec,
    contradiction,
    play,
    play_and_kill,
    stop_in_round,
    undisturbed,
    worker_ids,
)

from pyrobocop_pyomo.errors import EngineError, ModelError
from pyrobocop_pyomo.execution.engine import AgentFailure
from pyrobocop_pyomo.execution.engines import SerialEngine
from pyrobocop_pyomo.execution.process_engine import ProcessEngine

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows"),
]


def is_alive(process_id: int) -> bool:
    """Whether a process runs; one that has ended and is not collected yet does not."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def ends_within(seconds: float, process_ids: list[int]) -> bool:
    end = time.monotonic() + seconds
    while any(map(is_alive, process_ids)) and time.monotonic() < end:
        time.sleep(0.02)
    return not any(map(is_alive, process_ids))


def test_kill_interrupt_and_failures() -> None:
    """One pair of processes for all of it: their start takes most of the time."""
    engine = ProcessEngine(workers=2)
    assert engine.start(SPECS) == {name: {"name": name, "size": 5} for name in NAMES}
    assert len(worker_ids()) == 2
    (first,), (second,) = worker_ids("worker-0"), worker_ids("worker-1")
    play_and_kill(engine, second)
    assert worker_ids("worker-0") == [first]
    assert worker_ids("worker-1") != [second]
    assert engine.deaths == {"a": 1}  # and not "c", which lives there as well

    # Dies at each attempt of one order, and is given up; its neighbour in the same process goes on.
    orders = {name: TinyOrder(np.ones(5), "die" if name == "b" else "") for name in NAMES}
    reports = engine.solve(orders)
    failure = reports.pop("b")
    assert isinstance(failure, AgentFailure)
    assert failure.final
    assert "signal 9 (SIGKILL)" in failure.reason
    assert [report.solves for report in reports.values()] == [9, 9, 9]

    # An exception is a report of failure.
    failed = engine.solve({"c": TinyOrder(np.ones(5), "raise")})["c"]
    assert (failed.reason, failed.final) == ("ArithmeticError: log(-1)", False)

    remaining = worker_ids()
    assert len(remaining) == 2
    engine.stop()
    engine.stop()
    assert ends_within(3, remaining)


def test_a_stopped_worker_costs_its_time_and_nothing_else() -> None:
    expected, _ = undisturbed(5)
    with ProcessEngine(workers=2, answer_within=1.0) as engine:
        engine.start(SPECS)
        (stopped,) = worker_ids("worker-1")
        assert play(engine, 5, stop_in_round(2, stopped)) == expected
        assert engine.deaths == {"a": 1}
        assert not is_alive(stopped)


def test_a_stopped_worker_need_not_even_read_what_it_is_sent() -> None:
    specs, order = [TinySpec("a", data=(0, 1_000_000))], {"a": TinyOrder(np.zeros(1))}
    values = []
    for engine in (SerialEngine(), ProcessEngine(workers=1, answer_within=2.0)):
        with engine:
            engine.start(specs)
            engine.solve(order)
            for stopped in worker_ids():
                os.kill(stopped, signal.SIGSTOP)
            values.append(engine.solve(order)["a"].values)
    assert np.array_equal(*values)


@pytest.mark.ctrl_c
def test_ctrl_c_ends_the_workers_in_the_middle_of_a_solve() -> None:
    with ProcessEngine(workers=1) as engine:
        with pytest.raises(ModelError, match="longer than the field"):
            engine.start([TinySpec("b", contradiction)])
        engine.start(SPECS[:2])
        ids = worker_ids()
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            engine.solve({"hub": TinyOrder(np.ones(5)), "a": TinyOrder(np.ones(5), "sleep")})
        assert ends_within(3, ids)
        with pytest.raises(EngineError, match="stopped"):
            engine.states()


def script(body: str) -> str:
    return f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n" + textwrap.dedent(body)


def test_workers_end_with_a_coordinator_that_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "coordinator.py"
    path.write_text(
        script("""
            import numpy as np
            from tiny_agents import SPECS, TinyOrder, worker_ids
            from pyrobocop_pyomo.execution.process_engine import ProcessEngine
            if __name__ == "__main__":
                engine = ProcessEngine(workers=2)
                engine.start(SPECS)
                print(*worker_ids(), flush=True)
                engine.solve({"a": TinyOrder(np.ones(5), "sleep")})
        """)
    )
    with subprocess.Popen([sys.executable, str(path)], stdout=subprocess.PIPE, text=True) as coordinator:
        assert coordinator.stdout is not None
        ids = [int(word) for word in coordinator.stdout.readline().split()]
        assert len(ids) == 2
        coordinator.kill()
    assert ends_within(3, ids)


def test_a_script_that_does_not_protect_its_start_is_told(tmp_path: Path) -> None:
    path = tmp_path / "unprotected.py"
    path.write_text(
        script("""
            from tiny_agents import SPECS
            from pyrobocop_pyomo.execution.process_engine import ProcessEngine
            ProcessEngine(workers=1).start(SPECS)
        """)
    )
    ended = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=900, check=False)
    assert ended.returncode == 1
    last = ended.stderr.strip().splitlines()[-1]
    assert "EngineError" in last
    assert "if __name__ ==" in last
