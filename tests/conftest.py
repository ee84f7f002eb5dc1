"""Which ways to Ipopt the tests may use, and marks that tell the truth about that."""

import contextlib
import functools
import gc
import os
import signal
import sys
import time
from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import is_hypothesis_test, settings

from pyrobocop_pyomo.ipopt.backends import (
    available_backends,
    configure_ipopt_executable,
    find_ipopt_library,
    load_ipopt_library,
)
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

# A time limit per example fails on a busy machine, not on a wrong law. In CI the same examples come every time, so that
# no change is refused for an old fault; "thorough" (nightly) tries ten times as many, whatever a test asks for.
# ("ci" is hypothesis' own).
settings.register_profile("dev", deadline=None)
settings.register_profile("thorough", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "dev")

FINDERS = {
    "executable": lambda: configure_ipopt_executable() is not None,
    "asl": lambda: asl_available() and find_ipopt_library() is not None,
    "casadi": lambda: casadi_available() and find_ipopt_library() is not None,
    "ipopt": lambda: bool(available_backends()),
}
# How a test with such a mark may start Ipopt; without any mark it may not. `solve` improves in this process, where it
# can, what the executable found.
ALLOWED = {
    "executable": {"in this process", "as a process"},
    "asl": {"in this process"},
    "casadi": {"in this process"},
    "ipopt": {"in this process", "as a process"},
}


_started: set[str] = set()


def pytest_addoption(parser: pytest.Parser) -> None:
    """What `.ci/run` needs to end in time on a machine that is ten times slower than ours."""
    parser.addoption(
        "--begin-before", type=float, metavar="EPOCH_SECONDS", help="skip, and count, tests not begun by then"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Watch every start of Ipopt, and look for no garbage among what is imported: it stays."""
    gc.disable()
    sys.addaudithook(_note_executable)
    path = find_ipopt_library()
    if path is not None:
        functions = load_ipopt_library(path).functions
        functions.IpoptSolve = functools.partial(_note_and_solve, functions.IpoptSolve)


def _note_executable(event: str, arguments: tuple[Any, ...]) -> None:
    # Of any driver and by whichever of Pyomo's ways; asking for the version is no solve.
    if event == "subprocess.Popen" and "-AMPL" in str(arguments[1]):
        _started.add("as a process")


def _note_and_solve(solve: Any, *arguments: Any) -> int:
    _started.add("in this process")
    return solve(*arguments)


@pytest.hookimpl(tryfirst=True)  # before `-m` looks at the marks
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is quick: it needs no Ipopt, is neither heavy nor slow, and tries no hundred examples of a law."""
    longer = {*FINDERS, "heavy", "slow"}
    laws = {item.function for item in items if is_hypothesis_test(getattr(item, "function", None))}
    # Whole files, for their fixtures' sake: of quick tests first, with a slow one last. A run that has to end early has
    # then missed as few tests as possible.
    cost = dict.fromkeys((item.path for item in items), 0)
    for item in items:
        marks = {mark.name for mark in item.iter_markers()}
        if getattr(item, "function", None) not in laws and longer.isdisjoint(marks):
            item.add_marker("quick")
        else:
            cost[item.path] = max(cost[item.path], 2 if "slow" in marks else 1)
    items.sort(key=lambda item: cost[item.path])
    if config.getoption("--hypothesis-profile") == "thorough":
        for law in laws:
            asked = law._hypothesis_internal_use_settings
            law._hypothesis_internal_use_settings = settings(asked, max_examples=10 * asked.max_examples)


def pytest_collection_finish(session: pytest.Session) -> None:
    """From here on there is garbage. Python seldom searches all objects for it, once it knows how many there are."""
    gc.collect()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> bool | None:
    """Report a test as skipped when it is too late to begin it."""
    latest = item.config.getoption("--begin-before")
    if latest is None or time.time() <= latest:
        return None
    reason = (__file__, 0, "not begun within the time of this run (--begin-before)")
    item.ihook.pytest_runtest_logreport(
        report=pytest.TestReport(item.nodeid, item.location, {}, "skipped", reason, "setup")
    )
    return True


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a backend that is missing; fail instead where all backends are promised, as in our CI."""
    _started.clear()
    if item.get_closest_marker("ctrl_c") is not None and sys.platform == "win32":
        pytest.skip("on Windows a process that sends itself Ctrl-C is ended")
    for backend, found in FINDERS.items():
        if item.get_closest_marker(backend) is not None and not found():
            message = f"no backend '{backend}' on this machine; see: python -m pyrobocop_pyomo doctor"
            if os.environ.get("PYROBOCOP_REQUIRE_ALL_BACKENDS") == "1":
                pytest.fail(message, pytrace=False)
            pytest.skip(message)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Refuse a start of Ipopt that no mark tells of: on a machine without it the test would fail, not be skipped."""
    allowed = set().union(*(ALLOWED[name] for name in ALLOWED if item.get_closest_marker(name) is not None))
    with _python_hears_ctrl_c() if item.get_closest_marker("ctrl_c") else contextlib.nullcontext():
        result = yield
    if unmarked := sorted(_started - allowed):  # by the test or by its fixtures
        pytest.fail(
            f"this test starts Ipopt {' and '.join(unmarked)}, which its marks do not tell. Mark it 'ipopt' if any "
            "backend will do, or with the backend that it asks for: 'executable', 'asl' or 'casadi'.",
            pytrace=False,
        )
    return result


@contextlib.contextmanager
def _python_hears_ctrl_c() -> Generator[None]:
    """Put Python's own handler in place, also for child processes: a job in a shell's background ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
