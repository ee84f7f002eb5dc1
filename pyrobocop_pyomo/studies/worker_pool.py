"""`run_in_processes`: tasks of a study in processes of their own, with what can happen to these."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import forkserver
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.optional_imports import cloudpickle, cloudpickle_available

SECONDS_TO_ANSWER = 0.5
# One thread each: the processes are the parallelism, and pools of threads would fight over the cores. Libraries read
# these when they are loaded.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
DEATHS_ALLOWED = 2  # processes that one task may take down before it is given up


@dataclass(frozen=True)
class Task:
    """A call in another process; function and arguments are pickled.

    Attributes
    ----------
    key : object
        What tells tasks apart.
    function : callable
        At the top level of a module.
    arguments : tuple
    """

    key: Any
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


def number_of_workers(workers: Any) -> int:
    """The number of processes that is meant.

    Parameters
    ----------
    workers : int or "all"
        The word stands for one process on each core that this process may use.

    Raises
    ------
    ModelError
    """
    if isinstance(workers, str) and workers == "all":
        return available_cores()
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ModelError(f"workers = {workers!r}; expected a number of processes of at least 1, or 'all' cores.")
    return workers


def available_cores() -> int:
    """Cores that this process may use: fewer than the machine has where somebody has restricted it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def pickled_by_value(thing: Any) -> bytes:
    """A pickle that holds functions where cloudpickle is installed, and their names where it is not."""
    return bytes(cloudpickle.dumps(thing)) if cloudpickle_available else pickle.dumps(thing)


def check_picklable(things: Mapping[str, Any], *, by_value: bool = False) -> None:
    """Refuse what cannot be sent to another process.

    Parameters
    ----------
    things : mapping of what it is to the thing
    by_value : bool
        Whether they are sent by `pickled_by_value`.

    Raises
    ------
    ModelError
        Naming the first that cannot.
    """
    with_cloudpickle = ", or install cloudpickle" if by_value and not cloudpickle_available else ""
    for what, sent in things.items():
        try:
            (pickled_by_value if by_value else pickle.dumps)(sent)
        except Exception as error:
            raise ModelError(
                f"{what} cannot be sent to another process ({error}). Define functions at the top level of a module "
                f"(functools.partial fills in arguments){with_cloudpickle}, or use workers=1."
            ) from error
        function = getattr(sent, "func", sent)
        if by_value and cloudpickle_available:
            continue
        if getattr(function, "__module__", "") == "__main__" and not hasattr(sys.modules["__main__"], "__file__"):
            raise ModelError(
                f"{what} is defined in a notebook or at a prompt, which other processes cannot import. Write it into a "
                "file next to the notebook and import it from there, or use workers=1."
            )


def run_in_processes(
    tasks: Iterable[Task],
    take: Callable[[Any], Iterable[Task]],
    *,
    workers: int,
    deadline: Deadline,
    given_up: Callable[[Task], Iterable[Task]] | None = None,
    common: Any = None,
) -> None:
    """Run tasks in processes, in their order as far as there is room, until all are done.

    A time limit or Ctrl-C ends it; what was finished until then is taken.

    Parameters
    ----------
    tasks : iterable of Task
    take : callable
        Told of each result here, in this process; returns further tasks.
    workers : int
        Number of processes.
    deadline : Deadline
        Tasks end by themselves when it passes; how long they may take to say so is limited here.
    given_up : callable, optional
        Told of a task that took its process down several times; returns further tasks. Without it that is an error.
    common : object, optional
        Pickled once and sent to each process; tasks get it by `common_to_tasks`.

    Raises
    ------
    PyRobocopError
        When processes end abruptly before any of them has given a result.
    """
    _PooledRun(take, workers, deadline, given_up, common).run(tasks)


class _PooledRun:
    """The state of one call: executors die with their processes, and are replaced."""

    def __init__(
        self,
        take: Callable[[Any], Iterable[Task]],
        workers: int,
        deadline: Deadline,
        given_up: Callable[[Task], Iterable[Task]] | None,
        common: Any,
    ) -> None:
        self._take, self._workers, self._deadline, self._given_up = take, workers, deadline, given_up
        self._common = None if common is None else pickled_by_value(common)
        self._context = process_context()
        self._deaths: dict[Any, int] = {}
        self._answered = False

    def run(self, tasks: Iterable[Task]) -> None:
        waiting = list(tasks)
        while waiting:
            waiting = self._run_on_one_executor(waiting, self._workers)
            # Whose fault it was is found out by running the suspects one by one.
            suspects = [task for task in waiting if self._deaths.get(task.key)]
            waiting = [task for task in waiting if not self._deaths.get(task.key)]
            for task in suspects:
                waiting += self._run_on_one_executor([task], 1)

    def _run_on_one_executor(self, tasks: list[Task], workers: int) -> list[Task]:
        """Run tasks and all that follow from them; returns those that are left when a process ended abruptly."""
        # Not an Event: setting one waits for every process that waits for it, and one of them may be dead.
        told, teller = self._context.Pipe(duplex=False)
        executor = ProcessPoolExecutor(
            workers,
            mp_context=self._context,
            initializer=_start_worker,
            initargs=(told, self._common, {**ONE_THREAD, **os.environ}),
        )
        running: dict[Future[Any], Task] = {}
        waiting = list(tasks)[::-1]
        in_time = True
        try:
            while waiting or running:
                # Only as many as there is room for: what runs when a process dies is under suspicion.
                while waiting and len(running) < workers:
                    task = waiting.pop()
                    running[executor.submit(task.function, *task.arguments)] = task
                left = self._deadline.left
                timeout = None if left is None else max(left, 0.0) + SECONDS_TO_ANSWER
                done, _ = wait(running, timeout=timeout, return_when=FIRST_COMPLETED)
                if not done:
                    in_time = False
                    return []
                followers: list[Task] = []
                for future in done:
                    result = future.result()
                    del running[future]
                    self._answered = True
                    followers += self._take(result)
                waiting += followers[::-1]
        except KeyboardInterrupt:
            teller.close()
            executor.shutdown(wait=True, cancel_futures=True)
            for future in running:
                if not future.cancelled() and future.exception() is None:
                    self._take(future.result())
        except BrokenProcessPool as error:
            return [*self._suspected(list(running.values()), error), *waiting[::-1]]
        finally:
            teller.close()
            # A process that is still starting needs what the executor holds: it is kept until all have ended.
            closing = threading.Thread(target=executor.shutdown, kwargs={"cancel_futures": True})
            closing.start()
            if in_time:
                closing.join()
        return []

    def _suspected(self, tasks: list[Task], error: BaseException) -> list[Task]:
        left: list[Task] = []
        for task in tasks:
            self._deaths[task.key] = self._deaths.get(task.key, 0) + 1
            if self._deaths[task.key] < DEATHS_ALLOWED and self._given_up is not None and self._answered:
                left.append(task)
            elif self._given_up is None or not self._answered:
                raise PyRobocopError(
                    "a worker process ended abruptly. A script must keep its work under 'if __name__ == "
                    '"__main__":\', since each worker imports it; workers=1 needs no other process.'
                ) from error
            else:
                left += self._given_up(task)
        return left


def process_context() -> Any:
    """How processes are started: never as a copy of this one, with its threads and the state of its solvers.

    On Linux they are copies of a server that has imported this package and done nothing else. It lives as long as this
    process, so that all processes but the first start in hundredths of a second. Elsewhere each imports by itself.
    """
    if not sys.platform.startswith("linux"):
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["pyrobocop_pyomo.studies.worker_imports"])
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update({name: number for name, number in ONE_THREAD.items() if before[name] is None})
    try:
        forkserver.ensure_running()
    finally:
        for name, number in before.items():
            if number is None:
                del os.environ[name]
    return context


class _Process:
    """What a worker process was given when it started."""

    pickled: bytes | None = None
    common: Any = None


def common_to_tasks() -> Any:
    """What was sent to this process once for all tasks.

    Raises
    ------
    ModelError
        When it cannot be read here.
    """
    if _Process.pickled is not None:
        try:
            _Process.common = pickle.loads(_Process.pickled)
        except Exception as error:
            raise ModelError(
                f"a worker process cannot read what was sent to it ({type(error).__name__}: {error}). Functions have "
                "to stand in a file that other processes can import: next to the notebook, or in a module. workers=1 "
                "needs no other process."
            ) from error
        _Process.pickled = None
    return _Process.common


def _start_worker(told: Any, pickled: bytes | None, environment: Mapping[str, str]) -> None:
    """Let a request to stop reach the solve that runs here, as Ctrl-C would."""
    _Process.pickled = pickled
    # The server was started with the environment of another time.
    for name in set(os.environ) - set(environment):
        del os.environ[name]
    os.environ.update(environment)
    # On a terminal Ctrl-C reaches every process; here it means something to a running solve only, which puts its own
    # handler in place of this one.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    threading.Thread(target=_pass_on, args=(told,), daemon=True).start()


def _pass_on(told: Any) -> None:
    told.poll(None)  # until the other end is closed, also by the death of the process that holds it
    while True:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
