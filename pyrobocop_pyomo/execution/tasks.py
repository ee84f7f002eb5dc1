"""`run_tasks`: the solves of a study, in this process or on an engine, with what can happen to workers.

`fingerprint`: by which a file knows what it is of, a team or the case of a sweep.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MethodType
from typing import Any

import numpy as np

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
            requests.append(at_place.request_for("solve", (deadline.left, *task.arguments)))

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


def fingerprint(things: Iterable[Any]) -> str:
    """A number of what things hold, the same in every process and on every machine with the same version of Python.

    Parameters
    ----------
    things : iterable
        Numbers, texts, arrays, sequences, mappings, data frames, functions, classes and dataclasses of such. A function
        counts with its name, its defaults and what it closes over, a component of Pyomo with its name.

    Returns
    -------
    str
        64 hexadecimal digits (SHA-256).

    Raises
    ------
    ModelError
        When something has no such number, such as an open file.
    """
    return hashlib.sha256(repr(_plain(list(things))).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A value as something whose text says all of it, each kind with a mark of its own."""
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, (bool, int, float, complex, str, bytes, type(None))):
        return value
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return "array", value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return {"mapping": [(_plain(key), _plain(item)) for key, item in value.items()]}
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return {"set": sorted(map(repr, value))}
    if isinstance(value, MethodType):
        return {"method": _plain([value.__func__, value.__self__])}
    if hasattr(value, "__qualname__"):
        defaults = getattr(value, "__defaults__", None)
        return {"name": f"{value.__module__}.{value.__qualname__}", "holds": _plain([defaults, *_closed_over(value)])}
    if hasattr(value, "func") and hasattr(value, "keywords"):
        return {"partial": _plain([value.func, value.args, value.keywords])}
    if hasattr(value, "name") and hasattr(value, "ctype"):
        return {"component": value.name}
    if hasattr(value, "to_dict") and hasattr(value, "to_numpy"):  # a data frame or a series
        return _plain(value.to_dict())
    if hasattr(value, "__dict__"):
        return {"object": type(value).__qualname__, "holds": _plain(vars(value))}
    raise ModelError(
        f"a {type(value).__name__} has no fingerprint, by which a file knows what it is of. Give numbers, texts, "
        "arrays, lists and mappings, or go without a file."
    )


def _closed_over(function: Any) -> Iterator[Any]:
    for cell in getattr(function, "__closure__", None) or ():
        with contextlib.suppress(ValueError):  # a name without a value yet
            yield cell.cell_contents
