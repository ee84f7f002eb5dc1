"""`solve_sequences`: build and solve the model of each sequence of modes, in several processes, and rank them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError, SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import best_backend
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.planning.solve import solve
from pyrobocop_pyomo.solving.iterates import StopReason
from pyrobocop_pyomo.solving.progress import Progress

from .sequence_ranking import SequenceOutcome, SequenceRanking, sense_of

Build = Callable[[tuple[str, ...]], Any]


def solve_sequences(
    build: Build,
    sequences: Iterable[Iterable[str]],
    *,
    workers: int = 1,
    progress: bool | None = None,
    **options: Any,
) -> SequenceRanking:
    """Build and solve the model of each sequence, and rank them.

    Ctrl-C stops the work; what was finished is ranked and returned.

    Parameters
    ----------
    build : callable
        ``build(sequence)`` returns the model of a sequence, the same each time.
    sequences : iterable of tuples of str
        Such as `mode_sequences` gives.
    workers : int
        Number of processes; with 1 all is done in this one. More need a ``build`` that stands at the top level of a
        module (or a `functools.partial` of such), and a script whose work stands under
        ``if __name__ == "__main__":``, since each process imports it.
    progress : bool, optional
        Show a line per sequence; by default only on a terminal.
    **options
        Passed to `solve`.

    Returns
    -------
    SequenceRanking
        Errors of single sequences are in it, as their reason.

    Raises
    ------
    ModelError
        When the arguments make no sense.
    SolverNotFoundError
        When there is no Ipopt.
    """
    tasks = [(each,) if isinstance(each, str) else tuple(each) for each in sequences]
    if not tasks:
        raise ModelError("no sequences to solve; mode_sequences(...) makes them.")
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ModelError(f"workers = {workers!r}; expected a number of processes of at least 1.")
    best_backend()  # raises with the remedies where there is none, once and not for every sequence
    bar = Progress(progress)
    done: dict[int, SequenceOutcome] = {}

    def take(outcome: SequenceOutcome) -> bool:
        """Keep an outcome that Ctrl-C did not cut short."""
        if outcome.result is not None and outcome.result.stop_reason is StopReason.INTERRUPTED:
            return False
        done[outcome.number] = outcome
        found = f"objective {outcome.objective:.7g}" if outcome.feasible else outcome.reason
        bar.line(f"{len(done)}/{len(tasks)} {' - '.join(outcome.sequence)}: {outcome.standing}, {found}")
        if len(done) < len(tasks):
            bar.live(f"{len(tasks) - len(done)} left")
        return True

    if workers == 1:
        _solve_here(build, tasks, options, take)
    else:
        _solve_in_processes(build, tasks, options, min(workers, len(tasks)), take)
    bar.live("")
    left = [task for number, task in enumerate(tasks) if number not in done]
    return SequenceRanking.of([done[number] for number in sorted(done)], left, build)


def _solve_here(build: Build, tasks: list[tuple[str, ...]], options: Mapping[str, Any], take: Any) -> None:
    try:
        for number, task in enumerate(tasks):
            if not take(_solve_one(build, number, task, options)):
                return
    except KeyboardInterrupt:
        return


def _solve_one(build: Build, number: int, sequence: tuple[str, ...], options: Mapping[str, Any]) -> SequenceOutcome:
    started = time.perf_counter()
    try:
        model = build(sequence)
        result = solve(model, progress=False, **options)
    except SolverNotFoundError:
        raise
    except Exception as error:  # whatever goes wrong with one sequence must not lose the others
        reason = f"{type(error).__name__}: {error}"
        return SequenceOutcome(sequence, number, error=reason, seconds=time.perf_counter() - started)
    return SequenceOutcome(
        sequence,
        number,
        result,
        sense=sense_of(model),
        seconds=time.perf_counter() - started,
        values=VariableValues.of_all(model).taken,
    )


def _solve_in_processes(
    build: Build, tasks: list[tuple[str, ...]], options: Mapping[str, Any], workers: int, take: Any
) -> None:
    for what, each in (("build", build), ("the options", dict(options))):
        try:
            pickle.dumps(each)
        except Exception as error:
            raise ModelError(
                f"{what} cannot be sent to another process ({error}). Define functions at the top level of a module "
                "(functools.partial fills in arguments), or use workers=1."
            ) from error
    # Spawned, not forked: a forked child would share the state of threads and solver libraries.
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker, initargs=(stop,))
    futures: list[Future[SequenceOutcome]] = []
    taken: set[int] = set()
    try:
        futures += [executor.submit(_solve_one, build, number, task, options) for number, task in enumerate(tasks)]
        for future in as_completed(futures):
            taken.add(id(future))
            take(future.result())
    except KeyboardInterrupt:
        stop.set()
        executor.shutdown(wait=True, cancel_futures=True)
        for future in futures:
            if id(future) not in taken and not future.cancelled() and future.exception() is None:
                take(future.result())
    except BrokenProcessPool as error:
        raise PyRobocopError(
            "a worker process ended abruptly. A script must keep its work under 'if __name__ == \"__main__\":', since "
            "each worker imports it; workers=1 needs no other process."
        ) from error
    finally:
        stop.set()
        executor.shutdown(wait=True, cancel_futures=True)


def _start_worker(stop: Any) -> None:
    """Let a request to stop reach the solve that runs here, as Ctrl-C would."""
    # On a terminal Ctrl-C reaches every process; here it means something to a running solve only, which puts its own
    # handler in place of this one.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    # One thread each: the processes are the parallelism, and thread pools would fight over the cores.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    threading.Thread(target=_pass_on, args=(stop,), daemon=True).start()


def _pass_on(stop: Any) -> None:
    stop.wait()
    while True:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
