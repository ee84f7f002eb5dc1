"""`ProcessEngine`: processes on this machine, each connected by a pipe. Needs no package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from multiprocessing.connection import wait
from typing import Any

from pyrobocop_pyomo.errors import EngineError

from .engine import Engine, Exchange
from .sending import build_request
from .worker_host import HostedSpec, Lost, Request
from .worker_process import WorkerProcess, available_cores

_SECONDS_BETWEEN_INTERRUPTS = 0.1


class ProcessEngine(Engine):
    """Processes on this machine, each connected by a pipe.

    They are no copies of this process: a script that starts them protects its start with
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers : int, optional
        Number of processes; agents are dealt out to them in turn. By default one for each agent, but no more than there
        are processors.
    snapshot_every, deaths_allowed, answer_within
        As of `Engine`.

    Raises
    ------
    EngineError
        When `workers` is no such number.
    """

    name = "process"

    def __init__(self, workers: int | None = None, **of_every_engine: Any) -> None:
        super().__init__(**of_every_engine)
        if workers is not None and workers < 1:
            raise EngineError(f"engine 'process': workers = {workers!r}; expected at least 1.")
        self.workers = workers
        self._homes: dict[str, int] = {}
        self._processes: list[WorkerProcess] = []

    @property
    def process_ids(self) -> dict[str, int]:
        """Of the process in which each agent lives."""
        return {name: self._processes[home].process.pid or 0 for name, home in self._homes.items()}

    def places(self, most: int) -> int:
        """How many agents can solve side by side."""
        return min(most, self.workers or available_cores())

    def submit(self, request: Request) -> None:
        """Begin with a request, or let it wait where another agent of its process is at work."""
        self._processes[self._homes[request.agent]].submit(request)

    def wait(self, timeout: float | None = None) -> Exchange:
        """Wait for answers and losses."""
        at_work = {worker.connection: home for home, worker in enumerate(self._processes) if worker.queue}
        answers, lost = {}, {}
        for connection in wait(list(at_work), timeout) if at_work else ():
            home = at_work[connection]
            worker = self._processes[home]
            asked = worker.queue[0].agent
            answer = worker.receive()
            if answer is not None:
                answers[asked] = answer
                continue
            reason = worker.how_it_ended()
            of_home = [name for name, other in self._homes.items() if other == home]
            lost.update({name: Lost(reason, at_work=name == asked) for name in of_home})
        return answers, lost

    def end_silent_workers(self) -> None:
        """Kill the processes that owe an answer."""
        for worker in self._processes:
            if worker.queue:
                worker.process.kill()

    def interrupt(self) -> Exchange:
        """Let all solves end as Ctrl-C would, and wait for what they have."""
        answers, lost = {}, {}
        while at_work := [worker for worker in self._processes if worker.queue]:
            for worker in at_work:  # again and again: the solve may not have begun to listen
                worker.interrupt()
            more, gone = self.wait(_SECONDS_BETWEEN_INTERRUPTS)
            answers.update(more)
            lost.update(gone)
        return answers, lost

    def respawn(self, agents: Sequence[str]) -> None:
        """Start processes for those that have ended."""
        for home in sorted({self._homes[name] for name in agents}):
            if self._processes[home].has_ended:
                self._processes[home].end()
                self._processes[home] = WorkerProcess(home)
                self._processes[home].wait_until_ready()

    def _build_request(self, spec: HostedSpec) -> Request:
        return build_request(spec, main_is_known=True)

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        count = self.places(len(specs))
        self._homes = {name: i % count for i, name in enumerate(specs)}
        for number in range(count):
            self._processes.append(WorkerProcess(number))
        for worker in self._processes:
            worker.wait_until_ready()

    def _close(self) -> None:
        processes, self._processes, self._homes = self._processes, [], {}
        for worker in processes:
            worker.ask_to_end()
        for worker in processes:
            worker.end()
