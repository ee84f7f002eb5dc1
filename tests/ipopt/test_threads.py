"""Several solves in threads of one process: the same answers, and standard output is there afterwards."""

import io
import os
import subprocess
import sys
import threading

import pytest

from pyrobocop_pyomo.ipopt.c_output import c_output_sent_to, standard_output

SCRIPT = """
import sys, threading
import pyomo.environ as pyo
import pyrobocop_pyomo as rcp

def solve(number, answers):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1), pyo.Var(initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 1 - number) ** 2 + (m.y - 1) ** 2)
    result = rcp.solve(m, tee=tee and number < 2)
    answers[number] = result.solved and abs(result.objective - 1) < 1e-6

threads, warm, tee = int(sys.argv[1]), "warm" in sys.argv, "tee" in sys.argv
if warm:
    solve(0, {})
for _ in range(2):
    answers = {}
    running = [threading.Thread(target=solve, args=(number, answers)) for number in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
print("all solved:", sorted(answers.items()) == [(number, True) for number in range(threads)])
"""


@pytest.mark.ipopt
@pytest.mark.heavy
@pytest.mark.parametrize("words", ["2", "8", "8 warm", "3 tee", "3 warm tee"])
def test_threads_leave_standard_output_and_answers_as_they_are(words: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words.split()],
        capture_output=True,
        text=True,
        timeout=900,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert run.stdout.splitlines()[-1] == "all solved: True", run.stdout + run.stderr


@pytest.mark.ipopt
@pytest.mark.heavy
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_does_not_wait_for_a_thread_that_it_does_not_have() -> None:
    script = """
import os, threading
from pyrobocop_pyomo.ipopt.c_output import c_output_captured, c_output_sent_to
import sys
held, free = threading.Event(), threading.Event()
def hold():
    with c_output_captured():
        held.set()
        free.wait()
thread = threading.Thread(target=hold)
thread.start()
held.wait()
child = os.fork()
if child == 0:
    with c_output_sent_to([sys.stderr]):
        pass
    os._exit(7)
status = os.waitpid(child, 0)[1]
free.set()
thread.join()
print(os.waitstatus_to_exitcode(status))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=900, check=True)
    assert run.stdout.strip() == "7", run.stderr


def test_a_solve_does_not_print_to_what_the_solve_of_another_thread_has_put_in_place_of_standard_output() -> None:
    """It would be closed by the time at which it is its turn."""
    ordinary, held, free, given = sys.stdout, threading.Event(), threading.Event(), []

    def hold() -> None:
        with c_output_sent_to([io.StringIO()]):
            held.set()
            free.wait(60)

    threads = [threading.Thread(target=hold), threading.Thread(target=lambda: given.append(standard_output()))]
    threads[0].start()
    assert held.wait(60)
    replaced = sys.stdout is not ordinary
    threads[1].start()
    free.set()
    for thread in threads:
        thread.join(60)
    assert replaced
    assert given == [ordinary]
