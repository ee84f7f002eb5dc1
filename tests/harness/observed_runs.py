"""What Ipopt and the linear programs are really asked, and what a test can do to them meanwhile."""

import itertools
import time
from collections.abc import Callable
from typing import Any

import pytest
from pyomo.contrib.solver.solvers.ipopt import Ipopt

from pyrobocop_pyomo.ipopt import ipopt_run
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics.linear_programs import LinearAnswer, LinearProgram, LinearStatus

Options = dict[str, Any]


def observe_options(monkeypatch: pytest.MonkeyPatch) -> list[Options]:
    """The options of each run of Ipopt from now on, as the library or the executable receives them."""
    seen: list[Options] = []
    set_options, solve = ipopt_run.set_options, Ipopt.solve

    def observed_library(library: Any, problem: int, options: Any, **rest: Any) -> None:
        seen.append(dict(options))
        set_options(library, problem, options, **rest)

    def observed_executable(self: Any, model: Any, **rest: Any) -> Any:
        seen.append(dict(rest.get("solver_options", {})))
        return solve(self, model, **rest)

    monkeypatch.setattr(ipopt_run, "set_options", observed_library)
    monkeypatch.setattr(Ipopt, "solve", observed_executable)
    return seen


def interrupt_run(monkeypatch: pytest.MonkeyPatch, number: int) -> list[int]:
    """Press Ctrl-C at the start of one run of Ipopt in this process, counted from 0; returns the runs so far.

    No signal is sent: a shell may have told its children to ignore it.
    """
    runs: list[int] = []
    listens = ipopt_run.first_ctrl_c

    def pressed(request: Callable[[], None]) -> Any:
        if len(runs) == number:
            request()
        runs.append(len(runs))
        return listens(request)

    monkeypatch.setattr(ipopt_run, "first_ctrl_c", pressed)
    return runs


def before_linear_programs(monkeypatch: pytest.MonkeyPatch, act: Callable[[int], object]) -> None:
    """Call `act` with the number, from 0, of each linear program before its solve; what it raises comes from there."""
    solve, numbers = LinearProgram.solve, itertools.count()

    def act_and_solve(*arguments: Any, **named: Any) -> Any:
        act(next(numbers))
        return solve(*arguments, **named)

    monkeypatch.setattr(LinearProgram, "solve", act_and_solve)


def count_linear_programs(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The linear programs from now on."""
    seen: list[int] = []
    before_linear_programs(monkeypatch, seen.append)
    return seen


def slow_linear_programs(monkeypatch: pytest.MonkeyPatch, longest: float) -> None:
    """Let each linear program use its whole time limit, at most `longest` seconds, and find nothing."""

    def sleep(_program: Any, deadline: Deadline, *_: Any, **_named: Any) -> Any:
        time.sleep(max(0.0, min(deadline.left, longest)))
        return LinearAnswer(LinearStatus.STOPPED, None)

    monkeypatch.setattr(LinearProgram, "solve", sleep)


def use_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the clock of all deadlines count the time of this process only, not that of others on a busy machine.

    Ipopt and the linear programs go by the clock on the wall and stop the sooner.
    """
    monkeypatch.setattr(time, "perf_counter", time.process_time)
