"""`ProcessEngine`: processes on this machine, each connected by a pipe. Needs no package."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.connection import wait
from typing import Any

from .homes import EngineWithHomes
from .worker_process import WorkerProcess


class ProcessEngine(EngineWithHomes[WorkerProcess]):
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
        super().__init__(workers, **of_every_engine)

    @property
    def process_ids(self) -> dict[str, int]:
        """Of the process in which each agent lives."""
        return {name: self._homes[home].process.pid or 0 for name, home in self._home_of.items()}

    def _make_home(self, number: int) -> WorkerProcess:
        return WorkerProcess(number)

    def _ready(self, homes: Sequence[WorkerProcess], timeout: float | None) -> list[WorkerProcess]:
        of_connection = {home.connection: home for home in homes}
        return [of_connection[connection] for connection in wait(list(of_connection), timeout)]
