"""What Ipopt and the linear programs are really asked, and what a test can do to them meanwhile."""

from __future__ import annotations

import inspect
import itertools
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from pyomo.contrib.solver.solvers.ipopt import Ipopt

from pyrobocop_pyomo.ipopt import ipopt_run
from pyrobocop_pyomo.mpcc import mixed_integer

Options = dict[str, Any]
SIGNATURE = inspect.signature(mixed_integer.minimise)


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
    enter = ipopt_run.Interruption.__enter__

    def pressed(self: Any) -> Any:
        entered = enter(self)
        if len(runs) == number:
            entered.requested = True
        runs.append(len(runs))
        return entered

    monkeypatch.setattr(ipopt_run.Interruption, "__enter__", pressed)
    return runs


class LinearProgram(NamedTuple):
    """One that is about to be solved; those of the exploration have a limit of nodes."""

    number: int
    time_limit: float
    explores: bool


def before_linear_programs(monkeypatch: pytest.MonkeyPatch, act: Callable[[LinearProgram], object]) -> None:
    """Call `act` before each linear program, numbered from 0; what it raises comes from there."""
    minimise = mixed_integer.minimise
    numbers = itertools.count()

    def acting(*arguments: Any, **rest: Any) -> Any:
        given = SIGNATURE.bind(*arguments, **rest).arguments
        act(LinearProgram(next(numbers), given["time_limit"], given.get("node_limit") is not None))
        return minimise(*arguments, **rest)

    _replace_minimise(monkeypatch, acting)


def count_linear_programs(monkeypatch: pytest.MonkeyPatch) -> list[LinearProgram]:
    """The linear programs from now on."""
    seen: list[LinearProgram] = []
    before_linear_programs(monkeypatch, seen.append)
    return seen


def slow_linear_programs(monkeypatch: pytest.MonkeyPatch, longest: float) -> None:
    """Let each linear program use its whole time limit, at most `longest` seconds, and find nothing."""

    def sleeping(*arguments: Any, **rest: Any) -> tuple[None, bool]:
        limit = SIGNATURE.bind(*arguments, **rest).arguments["time_limit"]
        time.sleep(max(0.0, min(limit, longest)))
        return None, False

    _replace_minimise(monkeypatch, sleeping)


def _replace_minimise(monkeypatch: pytest.MonkeyPatch, new: Any) -> None:
    """Replace the solver of linear programs in every module of the package that has imported it."""
    old = mixed_integer.minimise
    for name, module in list(sys.modules.items()):
        if name.startswith("pyrobocop_pyomo") and getattr(module, "minimise", None) is old:
            monkeypatch.setattr(module, "minimise", new)


def use_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the clock of all deadlines count the time of this process only, not that of others on a busy machine.

    Ipopt and the linear programs go by the clock on the wall and stop the sooner.
    """
    monkeypatch.setattr(time, "perf_counter", time.process_time)
