"""`EngineWithHomes`: agents dealt out to workers in turn, of which each answers one request after the other."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar

from pyrobocop_pyomo.errors import EngineError

from .engine import Engine, Exchange
from .worker_host import Answer, HostedSpec, Lost, Request, packed


def available_cores() -> int:
    """Cores that this process may use: fewer than the machine has where somebody has restricted it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Home(ABC):
    """A worker with a host, seen from the coordinator.

    Attributes
    ----------
    has_ended : bool
        Known once an answer was waited for in vain.
    """

    has_ended = False

    @abstractmethod
    def wait_until_ready(self) -> None:
        """Wait until it takes requests."""

    @abstractmethod
    def send(self, request: Request) -> None:
        """Have a request answered; the one before has been."""

    @abstractmethod
    def receive(self) -> Answer | None:
        """The answer; None when the worker has ended."""

    @abstractmethod
    def how_it_ended(self) -> str:
        """In words."""

    @abstractmethod
    def kill(self) -> None:
        """Give the worker up, which owes an answer."""

    def end(self) -> None:  # noqa: B027 - where the worker is not ours, nothing is left of it
        """Wait until it has ended, not for long."""


HomeType = TypeVar("HomeType", bound=Home)


class EngineWithHomes(Engine, Generic[HomeType]):
    """An engine whose agents live on several workers.

    A worker gets its next request once it has answered the last one: so no connection is ever full, and when the worker
    ends, it is known at what.

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

    def __init__(self, workers: int | None, **of_every_engine: Any) -> None:
        super().__init__(**of_every_engine)
        if workers is not None and workers < 1:
            raise EngineError(f"engine '{self.name}': workers = {workers!r}; expected at least 1.")
        self.workers = workers
        self._home_of: dict[str, int] = {}
        self._homes: dict[int, HomeType] = {}
        self._queues: dict[int, deque[Request]] = {}  # what is not answered; the home works at the first

    @abstractmethod
    def _make_home(self, number: int) -> HomeType:
        """Begin to start a worker."""

    @abstractmethod
    def _ready(self, homes: Sequence[HomeType], timeout: float | None) -> list[HomeType]:
        """Those that have answered or ended, waited for so many seconds."""

    def places(self, most: int) -> int:
        """How many agents can solve side by side."""
        return min(most, self.workers or available_cores())

    def submit(self, request: Request) -> None:
        """Begin with a request, or let it wait where another agent of its worker is at work."""
        number = self._home_of[request.agent]
        self._queues[number].append(request)
        if len(self._queues[number]) == 1:
            self._homes[number].send(request)

    def wait(self, timeout: float | None = None) -> Exchange:
        """Wait for answers and losses."""
        at_work = {self._homes[number]: number for number, queue in self._queues.items() if queue}
        answers: dict[str, Answer] = {}
        lost: dict[str, Lost] = {}
        for home in self._ready(list(at_work), timeout) if at_work else ():
            number = at_work[home]
            queue = self._queues[number]
            asked, answer = queue.popleft().agent, home.receive()
            if answer is None:
                queue.clear()
                of_home = [name for name, other in self._home_of.items() if other == number]
                reason = home.how_it_ended()
                lost.update({name: Lost(reason, at_work=name == asked) for name in of_home})
                continue
            answers[asked] = answer
            if queue:
                home.send(queue[0])
        return answers, lost

    def end_silent_workers(self) -> None:
        """Give up the workers that owe an answer."""
        for number, queue in self._queues.items():
            if queue:
                self._homes[number].kill()

    def respawn(self, agents: Sequence[str]) -> None:
        """Start workers in place of those that have ended."""
        numbers = sorted({self._home_of[name] for name in agents})
        self._start([number for number in numbers if self._homes[number].has_ended])

    def _build_request(self, spec: HostedSpec) -> Request:
        return Request(spec.name, "build", packed(f"agent '{spec.name}'", (spec,), "engine='serial'", EngineError))

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        count = self.places(len(specs))
        self._home_of = {name: i % count for i, name in enumerate(specs)}
        self._queues = {number: deque() for number in range(count)}
        self._start(range(count))

    def _start(self, numbers: Sequence[int]) -> None:
        for number in numbers:  # side by side
            if number in self._homes:
                self._homes[number].end()
            self._homes[number] = self._make_home(number)
        for number in numbers:
            self._homes[number].wait_until_ready()

    def _close(self) -> None:
        homes, self._homes, self._home_of = self._homes, {}, {}
        for number, home in homes.items():
            if self._queues[number]:  # in the middle of a solve it would hear of its end afterwards only
                home.kill()
        for home in homes.values():
            home.end()
