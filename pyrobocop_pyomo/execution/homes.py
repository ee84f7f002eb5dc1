"""`EngineWithHomes`: agents dealt out to workers in turn, of which each answers one request after the other."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any, Generic, TypeVar, Union

from pyrobocop_pyomo.errors import EngineError

from .engine import Engine, Exchange
from .worker_host import Answer, HostedSpec, Lost, Request

AnswerOrEnd = Union[Answer, str]  # noqa: UP007


def available_cores() -> int:
    """Cores that this process may use: fewer than the machine has where somebody has restricted it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Home(ABC):
    """A worker with a host, seen from the coordinator; a thread of its own waits for its answers.

    Attributes
    ----------
    thread : ThreadPoolExecutor
        Asks one request after the other: so no connection is ever full, and when the worker ends, it is known at what.
    has_ended : bool
        Known once an answer was waited for in vain.
    """

    has_ended = False

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(1)

    @abstractmethod
    def wait_until_ready(self) -> None:
        """Wait until it takes requests."""

    @abstractmethod
    def ask(self, request: Request) -> AnswerOrEnd:
        """Have a request answered; where the worker has ended, gives how, in words."""

    @abstractmethod
    def kill(self) -> None:
        """Give the worker up, which owes an answer."""

    def end(self) -> None:
        """Wait until it has ended, not for long."""
        self.thread.shutdown(cancel_futures=True)


HomeType = TypeVar("HomeType", bound=Home)


class EngineWithHomes(Engine, Generic[HomeType]):
    """An engine whose agents live on several workers.

    Parameters
    ----------
    workers : int or None
        By default one for each agent, but no more than there are processors.
    **of_every_engine
        As of `Engine`.

    Raises
    ------
    EngineError
        When `workers` is no such number.
    """

    def __init__(self, workers: int | None = None, **of_every_engine: Any) -> None:
        super().__init__(**of_every_engine)
        if workers is not None and workers < 1:
            raise EngineError(f"engine '{self.name}': workers = {workers!r}; expected at least 1.")
        self.workers = workers
        self._home_of: dict[str, int] = {}
        self._homes: dict[int, HomeType] = {}
        self._agent_of: dict[Future[AnswerOrEnd], str] = {}  # of what is not answered, in the order of submission

    @property
    def process_ids(self) -> dict[str, int]:
        """Of the process in which each agent lives, on the machine of its worker."""
        return self.call_all("process_id", dict.fromkeys(self._specs, ()))

    @abstractmethod
    def _make_home(self, number: int) -> HomeType:
        """Begin to start a worker."""

    def places(self, most: int) -> int:
        """How many agents can solve side by side."""
        return min(most, self.workers or available_cores())

    def submit(self, request: Request) -> None:
        """Begin with a request, or let it wait where another agent of its worker is at work."""
        home = self._homes[self._home_of[request.agent]]
        self._agent_of[home.thread.submit(home.ask, request)] = request.agent

    def wait(self, timeout: float | None = None) -> Exchange:
        """Wait for answers and losses."""
        wait(self._agent_of, timeout, FIRST_COMPLETED)
        answers: dict[str, Answer] = {}
        lost: dict[str, Lost] = {}
        for future in [future for future in self._agent_of if future.done()]:
            if future not in self._agent_of:
                continue  # its home ended at an earlier request
            agent, found = self._agent_of.pop(future), future.result()
            if isinstance(found, Answer):
                answers[agent] = found
                continue
            number = self._home_of[agent]
            self._homes[number].has_ended = True
            of_home = [name for name, other in self._home_of.items() if other == number]
            lost.update({name: Lost(found, at_work=name == agent) for name in of_home})
            self._agent_of = {other: name for other, name in self._agent_of.items() if name not in of_home}
        return answers, lost

    def end_silent_workers(self) -> None:
        """Give up the workers that owe an answer."""
        for number in {self._home_of[agent] for agent in self._agent_of.values()}:
            self._homes[number].kill()

    def respawn(self, agents: Sequence[str]) -> None:
        """Start workers in place of those that have ended."""
        numbers = sorted({self._home_of[name] for name in agents})
        self._start([number for number in numbers if self._homes[number].has_ended])

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        count = self.places(len(specs))
        self._home_of = {name: i % count for i, name in enumerate(specs)}
        self._start(range(count))

    def _start(self, numbers: Sequence[int]) -> None:
        for number in numbers:  # side by side
            if number in self._homes:
                self._homes[number].end()
            self._homes[number] = self._make_home(number)
        for number in numbers:
            self._homes[number].wait_until_ready()

    def _close(self) -> None:
        self.end_silent_workers()  # in the middle of a solve they would hear of their end afterwards only
        homes, self._homes, self._home_of, self._agent_of = self._homes, {}, {}, {}
        for home in homes.values():
            home.end()
