"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline

from .engine import AgentFailure, Engine, available_cores
from .engines import find_engine
from .process_engine import ProcessEngine
from .worker_host import Request, packed

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
    return None if engine.in_this_process else engine


def run_tasks(
    tasks: Iterable[Task],
    take: Callable[[Any, Any], Iterable[Task] | None],
    *,
    make: Make,
    engine: Engine | None,
    most: int,
    deadline: Deadline,
) -> None:
    """Do tasks in their order, as far as there is room, until all are done.

    A time limit or Ctrl-C ends it; what was finished until then is taken. The first task is begun in any case.

    Parameters
    ----------
    tasks : iterable of Task
    take : callable
        Told of each key and result here, in this process; the result is None where a task took its worker down several
        times. Returns further tasks, which come next, or None to begin no more.
    make : callable
        Makes the function that does the tasks: here, or once on each worker, where it comes pickled.
    engine : Engine or None
        None does all in this process.
    most : int
        Workers that can be of use: the number of all tasks, also of those that follow.
    deadline : Deadline
        Tasks end by themselves when it passes; how long they may take to say so is limited here.

    Raises
    ------
    EngineError
        When workers cannot be started.
    Exception
        What a task raises.
    """
    waiting = list(tasks)[::-1]  # the next one last
    if engine is None:
        results = _done_here(waiting, make, deadline)
    else:
        results = _done_on_engine(waiting, engine, make, most, deadline)
    with contextlib.suppress(KeyboardInterrupt):
        for key, result in results:
            following = take(key, result)
            waiting[:] = [] if following is None else [*waiting, *list(following)[::-1]]


def _done_here(waiting: list[Task], make: Make, deadline: Deadline) -> Iterator[tuple[Any, Any]]:
    """Keys and results of tasks; others may follow from each."""
    solve, begun = make(), False
    while waiting and not (begun and deadline.has_passed):
        task, begun = waiting.pop(), True
        yield task.key, solve(*task.arguments, deadline=deadline)


def _done_on_engine(
    waiting: list[Task], engine: Engine, make: Make, most: int, deadline: Deadline
) -> Iterator[tuple[Any, Any]]:
    """Keys and results of tasks; at most one is begun at each place, since time passes."""
    idle = list(range(engine.places(most)))[::-1]
    spec = packed("what solves the cases", _Solver(make), "workers=1")
    requests: list[Request] = []

    def begin() -> None:
        while waiting and idle:
            task = waiting.pop()
            at_place = Request("solver", spec, idle.pop(), task.key)
            requests.append(at_place.calling("solve", (deadline.left, *task.arguments)))

    with engine:
        engine.deaths.clear()
        engine.open(len(idle))
        begin()
        for request, reply in engine.replies(requests, deadline.earlier_by(-SECONDS_TO_ANSWER)):
            idle.append(request.place)
            if isinstance(reply, AgentFailure):
                yield request.label, None
            elif reply.raised:
                raise reply.error(Exception, PyRobocopError(f"a task raised {reply.raised}"), "a worker")
            else:
                yield request.label, reply.value
            if not deadline.has_passed:
                begin()


@dataclass
class _Solver:
    """What does the tasks of a study on a worker, where it is made: an agent without a state."""

    make: Make

    def build(self) -> _Solver:
        self._do = self.make()
        return self

    def solve(self, left: float | None, *arguments: Any) -> Any:
        """Do a task, in the seconds that are left."""
        return self._do(*arguments, deadline=Deadline.after(left))
