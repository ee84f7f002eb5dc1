"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from pyrobocop_pyomo.errors import EngineError, ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline

from .engine import Engine
from .engines import find_engine
from .process_engine import ProcessEngine
from .sending import pickled_by_value
from .serial_engine import SerialEngine
from .worker_host import Answer, Lost, Raised, Request
from .worker_process import available_cores

SECONDS_TO_ANSWER = 0.5  # after the deadline, which tasks keep by themselves
DEATHS_ALLOWED = 2  # workers that one task may take down before it is given up
GIVEN_UP = "its process ended abruptly, several times"


class TaskSolver(Protocol):
    """What does the tasks of a study; one lives on each worker."""

    @property
    def solve(self) -> Callable[..., Any]:
        """Called as ``solve(*arguments, deadline=...)`` for what comes of one task."""
        ...


@dataclass(frozen=True)
class Task:
    """One call of `TaskSolver.solve`.

    Attributes
    ----------
    key : object
        What tells tasks apart.
    arguments : tuple
    """

    key: Any
    arguments: tuple[Any, ...]


Take = Callable[[Any], "Iterable[Task] | None"]


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
    make: Callable[[], TaskSolver],
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
        Makes what does the tasks: here, or once on each worker, where it comes pickled.
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


def _run_here(tasks: Iterable[Task], take: Take, solver: TaskSolver, deadline: Deadline) -> None:
    waiting, begun = list(tasks)[::-1], False
    try:
        while waiting and not (begun and deadline.has_passed):
            begun = True
            following = take(solver.solve(*waiting.pop().arguments, deadline=deadline))
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
        self._running: dict[str, Task | None] = {}  # None while a worker is made again
        self._deaths: dict[Any, int] = {}
        self._begun = False

    def run(self, make: Callable[[], TaskSolver], most: int) -> None:
        packed = pickled_by_value(make)
        try:
            names = [f"worker {number}" for number in range(self._engine.places(most))]
            self._engine.start(_WorkerSpec(name, packed) for name in names)
            self._idle = names[::-1]
            self._submit()
            while self._running:
                left = self._deadline.left
                answers, lost = self._engine.wait(None if left is None else max(left, 0.0) + SECONDS_TO_ANSWER)
                if not answers and not lost:
                    return  # the end of the engine ends them
                for name, answer in answers.items():
                    self._hear(name, answer)
                self._replace(lost)
                self._submit()
        except KeyboardInterrupt:
            answers, _ = self._engine.interrupt()
            self._waiting = []
            for name, answer in answers.items():
                self._hear(name, answer)

    def _submit(self) -> None:
        """Only as many as there is room for: time passes, and whose worker dies is known."""
        if self._waiting and self._begun and self._engine.agreed(self._deadline.has_passed):
            self._waiting = []
        while self._waiting and self._idle:
            name, task = self._idle.pop(), self._waiting.pop()
            self._running[name], self._begun = task, True
            self._engine.submit(Request.of(name, "solve", (task.arguments, self._deadline.left)))

    def _hear(self, name: str, answer: Answer) -> None:
        task = self._running.pop(name)
        self._idle.append(name)
        value = answer.value
        if answer.raised:
            raise _error_of(value)
        if task is None:
            self._deaths.pop(_Starting(name), None)
        else:
            self._go_on_after(value)

    def _go_on_after(self, result: Any) -> None:
        following = self._take(result)
        if following is None:
            self._waiting = []
        else:
            self._waiting += list(following)[::-1]

    def _replace(self, lost: dict[str, Lost]) -> None:
        for name, loss in lost.items():
            if name in self._idle:
                self._idle.remove(name)
            if name not in self._running:
                continue
            task = self._running.pop(name)
            culprit = _Starting(name) if task is None else task.key
            self._deaths[culprit] = self._deaths.get(culprit, 0) + loss.at_work
            often = self._deaths[culprit] >= DEATHS_ALLOWED
            if task is None and often:
                raise EngineError(f"a worker ended while it was started again, several times: {loss.reason}")
            if task is not None and often:
                self._go_on_after(self._given_up(task))
            elif task is not None:
                self._waiting.append(task)
        if lost:
            self._running.update(dict.fromkeys(lost))
            self._engine.build_again(list(lost))


@dataclass(frozen=True)
class _Starting:
    """In place of a task's key: that a worker was made again."""

    name: str


def _error_of(raised: Raised) -> BaseException:
    error = raised.original() or PyRobocopError(f"a task raised {raised.reason}")
    error.__cause__ = RuntimeError(f"in a worker\n{raised.traceback}")
    return error


@dataclass(frozen=True)
class _WorkerSpec:
    """How the solver of a study is made on a worker."""

    name: str
    packed: bytes

    def build(self) -> _Worker:
        try:
            make = pickle.loads(self.packed)
        except Exception as error:
            raise ModelError(
                f"a worker process cannot read what was sent to it ({type(error).__name__}: {error}). Functions have "
                "to stand in a file that other processes can import: next to the notebook, or in a module. workers=1 "
                "needs no other process."
            ) from error
        return _Worker(make())


class _Worker:
    """The solver of a study as an agent, which has no state between its tasks."""

    def __init__(self, solver: TaskSolver) -> None:
        self._solver = solver

    def facts(self) -> None:
        """There is nothing to know of it."""

    def solve(self, order: tuple[tuple[Any, ...], float | None]) -> Any:
        """Do a task, in the seconds that are left."""
        arguments, left = order
        return self._solver.solve(*arguments, deadline=Deadline.after(left))

    def state(self) -> dict[str, Any]:
        """Empty."""
        return {}

    def restore(self, state: Any) -> None:
        """There is nothing to restore."""
