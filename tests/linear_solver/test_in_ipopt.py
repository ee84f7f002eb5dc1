"""The linear solver inside Ipopt: many runs leave no memory behind, and Ctrl-C leaves the process usable."""

import os
import resource
import signal
import sys
import threading

import numpy as np
import pytest
from ipopt.test_linear_solvers import swing

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

pytestmark = [pytest.mark.casadi, pytest.mark.skipif(sys.platform == "win32", reason="signals and memory of POSIX")]

OWN = {"linear_solver": "ldl"}


def test_hundreds_of_runs_leave_no_memory_behind(library):
    nlp = CompiledModel(swing(2), "vectorised").nlp

    def run(times: int) -> None:
        for _ in range(times):
            assert run_ipopt(nlp, {**OWN, "max_iter": 3, "print_level": 0}).iterations == 3

    run(100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    run(300)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 8192 * (1024 if sys.platform == "darwin" else 1)  # a run of this size holds more than 100 kB


@pytest.mark.ctrl_c
def test_ctrl_c_at_any_instant_keeps_a_point_and_the_next_run_is_as_ever(library):
    nlp = CompiledModel(swing(1500), "vectorised").nlp
    whole = run_ipopt(nlp, OWN)
    assert whole.status is IpoptStatus.SOLVED
    for part in range(1, 9):
        reached = threading.Event()
        timer = threading.Timer(0.001 * part, os.kill, (os.getpid(), signal.SIGINT))

        def press_later(record, reached=reached, timer=timer):
            if not reached.is_set():  # no earlier: a press before the run ends the test session
                reached.set()
                timer.start()

        outcome = run_ipopt(nlp, OWN, on_iteration=press_later)
        timer.join()
        assert outcome.status is IpoptStatus.INTERRUPTED
        assert np.isfinite(outcome.x).all()
    again = run_ipopt(nlp, OWN)
    assert again.iterations == whole.iterations
    assert again.objective == whole.objective
