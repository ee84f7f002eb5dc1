"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from pyrobocop_pyomo.errors import EngineError, ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline

from .engine import Engine
from .engines import SerialEngine, find_engine
from .homes import available_cores
from .process_engine import ProcessEngine
from .worker_host import Answer, Lost, Request

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
    if workers != "all" and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise ModelError(f"workers = {workers!r}; expected a number of processes of at least 1, or 'all' cores.")
    count = available_cores() if workers == "all" else workers
    if engine is None:
        return None if count == 1 else ProcessEngine(count)
    if workers != 1:
        raise ModelError(f"workers = {workers!r} and an engine: give one of them; an engine has workers of its own.")
    engine = find_engine(engine)
    return None if isinstance(engine, SerialEngine) else engine


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
    run = _TaskRun(list(tasks)[::-1], take, deadline, given_up)
    with contextlib.suppress(KeyboardInterrupt):
        if engine is None:
            run.here(make())
        else:
            with engine:
                run.on_engine(engine, make, most)


@dataclass
class _TaskRun:
    """The state of one call; on an engine, whose agents are workers that differ in nothing but their names."""

    waiting: list[Task]  # the next one last
    take: Take
    deadline: Deadline
    given_up: Callable[[Task], Any]
    idle: list[str] = field(default_factory=list)
    running: dict[str, Task] = field(default_factory=dict)
    deaths: Counter[Any] = field(default_factory=Counter)
    begun: bool = False

    def here(self, solve: Callable[..., Any]) -> None:
        while self.waiting and not (self.begun and self.deadline.has_passed):
            self.begun = True
            self._go_on_after(solve(*self.waiting.pop().arguments, deadline=self.deadline))

    def on_engine(self, engine: Engine, make: Make, most: int) -> None:
        if not self.waiting:
            return
        names = [f"worker {number}" for number in range(engine.places(most))]
        engine.start(_WorkerSpec(name, make) for name in names)
        self.idle = names[::-1]
        self._submit(engine)
        while self.running:
            left = self.deadline.left
            heard = engine.hear(None if left is None else max(left, 0.0) + SECONDS_TO_ANSWER)
            if heard is None:
                return  # the end of the engine ends them
            self._take_all(engine, *heard)
            self._submit(engine)

    def _submit(self, engine: Engine) -> None:
        """Only as many as there is room for: time passes, and whose worker dies is known."""
        if self.waiting and self.begun and engine.agreed(self.deadline.has_passed):
            self.waiting = []
        while self.waiting and self.idle:
            name, task = self.idle.pop(), self.waiting.pop()
            self.running[name], self.begun = task, True
            engine.submit(Request.of(name, "solve", self.deadline.left, *task.arguments))

    def _take_all(self, engine: Engine, answers: Mapping[str, Answer], lost: Mapping[str, Lost]) -> None:
        for name, answer in answers.items():
            self.idle.append(name)
            del self.running[name]
            if answer.raised:
                raise answer.error(Exception, PyRobocopError(f"a task raised {answer.raised}"), "a worker")
            self._go_on_after(answer.value)
        for name, loss in lost.items():
            if engine.deaths[name] > engine.deaths_allowed:
                raise EngineError(f"a worker ended while it was started again, several times: {loss.reason}")
            # The task is to blame, and the worker may go on.
            del engine.deaths[name]
            self.idle.append(name)
            task = self.running.pop(name)
            self.deaths[task.key] += loss.at_work
            if self.deaths[task.key] <= engine.deaths_allowed:
                self.waiting.append(task)
            else:
                self._go_on_after(self.given_up(task))

    def _go_on_after(self, result: Any) -> None:
        following = self.take(result)
        if following is None:
            self.waiting = []
        else:
            self.waiting += list(following)[::-1]


@dataclass(frozen=True)
class _WorkerSpec:
    """How the solver of a study is made on a worker; it is an agent without a state."""

    name: str
    make: Make

    def build(self) -> Any:
        solve = self.make()

        def in_time(left: float | None, *arguments: Any) -> Any:
            """Do a task, in the seconds that are left."""
            return solve(*arguments, deadline=Deadline.after(left))

        return SimpleNamespace(facts=lambda: None, solve=in_time)
