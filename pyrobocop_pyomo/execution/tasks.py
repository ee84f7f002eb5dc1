"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import EngineError, ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline

from .engine import Engine
from .engines import find_engine
from .homes import available_cores
from .process_engine import ProcessEngine
from .serial_engine import SerialEngine
from .worker_host import Answer, Lost, Raised, Request

SECONDS_TO_ANSWER = 0.5  # after the deadline, which tasks keep by themselves
GIVEN_UP = "its process ended abruptly, several times"


@dataclass(frozen=True)
class Task:
    """One call of what does the tasks of a study: ``solve(*arguments, deadline=...)`` gives what comes of it.

    Attributes
    ----------
    key : object
        What tells tasks apart.
    arguments : tuple
    """

    key: Any
    arguments: tuple[Any, ...]


Take = Callable[[Any], "Iterable[Task] | None"]
Make = Callable[[], Callable[..., Any]]


def study_engine(workers: Any, engine: str | Engine | None) -> Engine | None:
    """The engine that a study's arguments mean; None where its tasks are done in this process.

    Parameters
    ----------
    workers : int or "all"
        Number of processes; the word stands for one on each core that this process may use.
    engine : str, Engine or None
        As `find_engine` takes it.

    Raises
    ------
    ModelError
        When the number makes no sense, or both are given.
    EngineError
        When there is no such engine, or its package is not installed.
    """
    count = number_of_workers(workers)
    if engine is None:
        return None if count == 1 else ProcessEngine(count)
    if workers != 1:
        raise ModelError(f"workers = {workers!r} and an engine: give one of them; an engine has workers of its own.")
    engine = find_engine(engine)
    return None if isinstance(engine, SerialEngine) else engine


def number_of_workers(workers: Any) -> int:
    """The number of processes that is meant.

    Raises
    ------
    ModelError
    """
    if isinstance(workers, str) and workers == "all":
        return available_cores()
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ModelError(f"workers = {workers!r}; expected a number of processes of at least 1, or 'all' cores.")
    return workers


def run_tasks(
    tasks: Iterable[Task],
    take: Take,
    *,
    make: Make,
    engine: Engine | None,
    most: int,
    deadline: Deadline,
    given_up: Callable[[Task], Any],
) -> None:
    """Do tasks in their order, as far as there is room, until all are done.

    A time limit or Ctrl-C ends it; what was finished until then is taken. The first task is begun in any case.

    Parameters
    ----------
    tasks : iterable of Task
    take : callable
        Told of each result here, in this process; returns further tasks, which come next, or None to begin no more.
    make : callable
        Makes the function that does the tasks: here, or once on each worker, where it comes pickled.
    engine : Engine or None
        None does all in this process.
    most : int
        Workers that can be of use: the number of all tasks, also of those that follow.
    deadline : Deadline
        Tasks end by themselves when it passes; how long they may take to say so is limited here.
    given_up : callable
        The result of a task that took its worker down several times.

    Raises
    ------
    EngineError
        When workers cannot be started, or do not stay until their solver is made.
    Exception
        What a task raises.
    """
    if engine is None:
        _run_here(tasks, take, make(), deadline)
        return
    listed = list(tasks)
    with engine:
        if listed:
            _TaskRun(listed, take, engine, deadline, given_up).run(make, most)


def _run_here(tasks: Iterable[Task], take: Take, solve: Callable[..., Any], deadline: Deadline) -> None:
    waiting, begun = list(tasks)[::-1], False
    try:
        while waiting and not (begun and deadline.has_passed):
            begun = True
            following = take(solve(*waiting.pop().arguments, deadline=deadline))
            if following is None:
                return
            waiting += list(following)[::-1]
    except KeyboardInterrupt:
        return


class _TaskRun:
    """The state of one call on an engine, whose agents are workers that differ in nothing but their names."""

    def __init__(
        self, tasks: list[Task], take: Take, engine: Engine, deadline: Deadline, given_up: Callable[[Task], Any]
    ) -> None:
        self._waiting, self._take, self._engine = tasks[::-1], take, engine
        self._deadline, self._given_up = deadline, given_up
        self._idle: list[str] = []
        self._running: dict[str, Task] = {}
        self._deaths: Counter[Any] = Counter()
        self._begun = False

    def run(self, make: Make, most: int) -> None:
        try:
            names = [f"worker {number}" for number in range(self._engine.places(most))]
            self._engine.start(_WorkerSpec(name, make) for name in names)
            self._idle = names[::-1]
            self._submit()
            while self._running:
                left = self._deadline.left
                heard = self._engine.hear(None if left is None else max(left, 0.0) + SECONDS_TO_ANSWER)
                if heard is None:
                    return  # the end of the engine ends them
                self._take_all(*heard)
                self._submit()
        except KeyboardInterrupt:
            return

    def _submit(self) -> None:
        """Only as many as there is room for: time passes, and whose worker dies is known."""
        if self._waiting and self._begun and self._engine.agreed(self._deadline.has_passed):
            self._waiting = []
        while self._waiting and self._idle:
            name, task = self._idle.pop(), self._waiting.pop()
            self._running[name], self._begun = task, True
            self._engine.submit(Request.of(name, "solve", (task.arguments, self._deadline.left)))

    def _take_all(self, answers: Mapping[str, Answer], lost: Mapping[str, Lost]) -> None:
        for name, answer in answers.items():
            self._idle.append(name)
            del self._running[name]
            value = answer.value
            if answer.raised:
                raise _error_of(value)
            self._go_on_after(value)
        for name, loss in lost.items():
            if self._engine.deaths[name] > self._engine.deaths_allowed:
                raise EngineError(f"a worker ended while it was started again, several times: {loss.reason}")
            # The task is to blame, and the worker may go on.
            del self._engine.deaths[name]
            self._idle.append(name)
            task = self._running.pop(name)
            self._deaths[task.key] += loss.at_work
            if self._deaths[task.key] <= self._engine.deaths_allowed:
                self._waiting.append(task)
            else:
                self._go_on_after(self._given_up(task))

    def _go_on_after(self, result: Any) -> None:
        following = self._take(result)
        if following is None:
            self._waiting = []
        else:
            self._waiting += list(following)[::-1]


def _error_of(raised: Raised) -> BaseException:
    error = raised.original() or PyRobocopError(f"a task raised {raised.reason}")
    error.__cause__ = RuntimeError(f"in a worker\n{raised.traceback}")
    return error


@dataclass(frozen=True)
class _WorkerSpec:
    """How the solver of a study is made on a worker."""

    name: str
    make: Make

    def build(self) -> _Worker:
        return _Worker(self.make())


class _Worker:
    """What does tasks as an agent, which has no state between them."""

    def __init__(self, solve: Callable[..., Any]) -> None:
        self._solve = solve

    def facts(self) -> None:
        """There is nothing to know of it."""

    def solve(self, order: tuple[tuple[Any, ...], float | None]) -> Any:
        """Do a task, in the seconds that are left."""
        arguments, left = order
        return self._solve(*arguments, deadline=Deadline.after(left))
