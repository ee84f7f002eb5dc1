"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers."""

from __future__ import annotations

import contextlib
import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline

from .engine import AgentFailure, Engine, available_cores
from .engines import find_engine
from .process_engine import ProcessEngine
from .worker_host import Request

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
    return None if engine.name == "serial" else engine


def run_tasks(
    tasks: Iterable[Task],
    take: Take,
    *,
    make: Make,
    engine: Engine | None,
    most: int,
    deadline: Deadline,
    given_up: Callable[[Any], Any],
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
        The result of a task, by its key, that took its worker down several times.

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
        results = _done_on_engine(waiting, engine, make, most, deadline, given_up)
    with contextlib.suppress(KeyboardInterrupt):
        for result in results:
            following = take(result)
            waiting[:] = [] if following is None else [*waiting, *list(following)[::-1]]


def _done_here(waiting: list[Task], make: Make, deadline: Deadline) -> Iterator[Any]:
    """The results of tasks; others may follow from each."""
    solve, begun = make(), False
    while waiting and not (begun and deadline.has_passed):
        begun = True
        yield solve(*waiting.pop().arguments, deadline=deadline)


def _done_on_engine(
    waiting: list[Task], engine: Engine, make: Make, most: int, deadline: Deadline, given_up: Callable[[Any], Any]
) -> Iterator[Any]:
    """The results of tasks; at most one is begun at each place, since time passes."""
    idle = list(range(engine.places(most)))[::-1]
    spec = engine.sent(_SolverSpec(make), "what solves the cases", "workers=1")
    requests: list[Request] = []

    def begin() -> None:
        while waiting and idle:
            task = waiting.pop()
            arguments = pickle.dumps((deadline.left, *task.arguments), pickle.HIGHEST_PROTOCOL)
            requests.append(Request("solver", spec, "solve", arguments, task.key, idle.pop()))

    with engine:
        engine.deaths.clear()
        engine.open(len(idle))
        begin()
        for request, reply in engine.replies(requests, deadline.earlier_by(-SECONDS_TO_ANSWER)):
            idle.append(request.place)
            if isinstance(reply, AgentFailure):
                yield given_up(request.label)
            elif reply.raised:
                raise reply.error(Exception, PyRobocopError(f"a task raised {reply.raised}"), "a worker")
            else:
                yield reply.value
            if not engine.agreed(deadline.has_passed):
                begin()


@dataclass(frozen=True)
class _SolverSpec:
    """How the solver of a study is made on a worker; it is an agent without a state."""

    make: Make
    name: str = "solver"

    def build(self) -> Any:
        solve = self.make()

        def in_time(left: float | None, *arguments: Any) -> Any:
            """Do a task, in the seconds that are left."""
            return solve(*arguments, deadline=Deadline.after(left))

        return SimpleNamespace(solve=in_time)
