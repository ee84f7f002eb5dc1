"""What a re-solve costs beyond Ipopt, when only the initial state of a cart-pole changes.

    python benchmarks/receding_horizon.py [--quick]

"re-solve" is `PersistentNLP.solve` alone: reading the changed numbers, Ipopt, writing the answer. "step" is a step of
`RecedingHorizon`, which also moves the plan ahead and hands it out as a trajectory. "Ipopt" is the time inside Ipopt
with its functions and derivatives. "exported" is a step of the same controller in C. Milliseconds, medians; the ratios
are to Ipopt in the same solves, that of "exported" to Ipopt in the steps beside. "from scratch" builds, hands over and
solves the same problem anew.
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from math import pi
from pathlib import Path

from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.export import export_controller
from pyrobocop_pyomo.ipopt.backends import load_ipopt_library
from pyrobocop_pyomo.native.shared_library import FLAGS
from pyrobocop_pyomo.studies import PersistentNLP

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from cart_pole_closed_loop import STATES, build


def disturbed(k: int) -> dict[str, float]:
    """A start near the upright pole, another one each time."""
    return dict(zip(STATES, (0.1 * (-1) ** k, pi + 0.05 * (k % 5 - 2), 0.0, 0.1 * (k % 3 - 1)), strict=True))


def resolve(elements: int, repeats: int) -> tuple[list[float], list[float]]:
    """Milliseconds of each re-solve, and of Ipopt in it."""
    m = build(elements)
    kept = PersistentNLP(m)
    total, ipopt = [], []
    for k in range(repeats + 1):
        for name, number in disturbed(k).items():
            m.ahead.component(name)[m.ahead.initial_time].set_value(number)
        started = time.perf_counter()
        outcome = kept.solve()
        total.append(1e3 * (time.perf_counter() - started))
        ipopt.append(1e3 * outcome.seconds)
        assert outcome.status.solved
    assert kept.preparations == 1
    return total[1:], ipopt[1:]


def steps(elements: int, repeats: int) -> tuple[list[float], list[float], list[int]]:
    """Milliseconds of each step of a receding horizon, of Ipopt in it, and iterations."""
    m = build(elements)
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    done, total = [], []
    for k in range(repeats + 1):
        started = time.perf_counter()
        made = controller.step(disturbed(k), advance=0.04 if k else 0.0)
        made.plan.force[0]  # a plan is made at its first use
        total.append(1e3 * (time.perf_counter() - started))
        done.append(made)
        assert made.solved
    return total[1:], [1e3 * made.ipopt_seconds for made in done[1:]], [made.iterations for made in done[1:]]


def exported(elements: int, repeats: int) -> list[float] | None:
    """Milliseconds of each step of the controller in C; None without a compiler."""
    compiler, ipopt = shutil.which("cc") or shutil.which("gcc"), Path(load_ipopt_library().path)
    if compiler is None:
        return None
    m = build(elements)
    with tempfile.TemporaryDirectory() as name:
        folder = export_controller(rcp.studies.RecedingHorizon(m, m.ahead), Path(name) / "robot", advance=0.04).parent
        library = folder / "controller.so"
        # Symbols are bound within the library: those of the linear solver stand in others of this process as well.
        link = [str(ipopt), f"-Wl,-rpath,{ipopt.parent}", "-Wl,-Bsymbolic", "-ldl", "-lm"]
        flags = [flag for flag in FLAGS if flag != "-fvisibility=hidden"]
        subprocess.run([compiler, *flags, *map(str, folder.glob("*.c")), "-o", str(library), *link], check=True)
        functions = ctypes.CDLL(str(library))
    states, controls = (ctypes.c_int.in_dll(functions, f"controller_{what}").value for what in ("states", "controls"))
    names = (ctypes.c_char_p * states).in_dll(functions, "controller_state_names")
    total = []
    for k in range(repeats + 1):
        measured = disturbed(k)
        state = (ctypes.c_double * states)(*(measured[name.decode()] for name in names if name))
        started = time.perf_counter()
        assert functions.controller_step(state, (ctypes.c_double * controls)()) == 0
        total.append(1e3 * (time.perf_counter() - started))
    return total[1:]


def from_scratch(elements: int) -> float:
    """Milliseconds to build, hand over and solve."""
    started = time.perf_counter()
    m = build(elements)
    for name, number in disturbed(1).items():
        m.ahead.component(name)[m.ahead.initial_time].set_value(number)
    assert rcp.solve(m).solved
    return 1e3 * (time.perf_counter() - started)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 elements, a few times")
    arguments = parser.parse_args()
    table = Table(
        [
            ("elements", ">8d"), ("re-solve", ">9.2f"), ("Ipopt", ">8.2f"), ("ratio", ">6.2f"), ("step", ">8.2f"),
            ("Ipopt", ">8.2f"), ("ratio", ">6.2f"), ("exported", ">8.2f"), ("ratio", ">6.2f"), ("iterations", ">10.1f"),
            ("from scratch", ">12.1f"),
        ]
    )  # fmt: skip
    table.header()
    for elements in (20,) if arguments.quick else (50, 500):
        repeats = 5 if arguments.quick else 40
        show_progress(f"{elements} elements")
        total, ipopt = resolve(elements, repeats)
        step, step_ipopt, iterations = steps(elements, repeats)
        in_c = exported(elements, repeats)
        scratch = min(from_scratch(elements) for _ in range(2))
        show_progress("")
        table.add(
            elements,
            *(statistics.median(times) for times in (total, ipopt)), sum(total) / sum(ipopt),
            *(statistics.median(times) for times in (step, step_ipopt)), sum(step) / sum(step_ipopt),
            *((None, None) if in_c is None else (statistics.median(in_c), sum(in_c) / sum(step_ipopt))),
            statistics.mean(iterations), scratch,
        )  # fmt: skip


if __name__ == "__main__":
    main()
