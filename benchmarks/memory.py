"""Memory that solves leave behind: a receding horizon runs for days.

    python benchmarks/memory.py [--quick] [--solves 1000] [--warm-up 50]

Each row is a process of its own that solves one small model again and again, with or without pairs, on one kind of
derivatives. Counted is the memory in use after garbage collection, by the C library and by Python, and the resident
size beside it, from the end of the warm-up on. For Linux with the GNU C library. The exit code is 0 only where no row
grows by 2 MB or more.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import subprocess
import sys
from pathlib import Path

import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp

COLUMNS = [("model", "<8"), ("derivatives", "<12"), ("solves", ">6d"), ("MB in use", ">10.3f"),
           ("MB resident", ">12.3f")]  # fmt: skip
MODELS = ("plain", "pairs")
MOST = 2.0  # MB


class _InUse(ctypes.Structure):
    """What ``mallinfo2`` returns."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "a", "b", "uordblks", "c", "d")
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="30 solves after 20")
    parser.add_argument("--solves", type=int, default=1000, metavar="N", help="after the warm-up; 1000 by default")
    parser.add_argument("--warm-up", type=int, default=50, metavar="N", help="50 by default")
    parser.add_argument("--row", nargs=2, metavar=("MODEL", "BACKEND"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    solves, warm_up = (30, 20) if arguments.quick else (arguments.solves, arguments.warm_up)
    if arguments.row:
        print(*growth(*arguments.row, solves, warm_up))
        return
    table, worst = Table(COLUMNS), 0.0
    table.header()
    for model in MODELS:
        for backend in (kind.derivatives for kind in rcp.ipopt.available_backends()):
            if backend is None:
                continue  # the executable is a process of its own
            show_progress(f"{model}, {backend}")
            command = [sys.executable, str(Path(__file__)), "--row", model, backend]
            command += ["--solves", str(solves), "--warm-up", str(warm_up)]
            printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            in_use, resident = map(float, printed.split())
            show_progress("")
            table.add(model, backend, solves, in_use, resident)
            worst = max(worst, in_use)
    sys.exit(worst >= MOST)


def growth(model: str, backend: str, solves: int, warm_up: int) -> tuple[float, float]:
    """By how many MB the memory in use grows, and the resident one, after the warm-up."""
    m, before = _model(model), (0.0, 0.0)
    for done in range(warm_up + solves + 1):
        if done == warm_up:
            before = _memory()
        m.x.value, m.y.value = 1.0, 1.0
        rcp.solve(m, backend=backend, progress=False)
    after = _memory()
    return after[0] - before[0], after[1] - before[1]


def _model(kind: str) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="small")
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + pyo.exp(m.y))
    if kind == "pairs":
        m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    else:
        m.row = pyo.Constraint(expr=m.x * m.y >= 2)
    return m


def _memory() -> tuple[float, float]:
    """In use, and resident, in MB."""
    gc.collect()
    library = ctypes.CDLL(None)
    library.mallinfo2.restype = _InUse
    known = library.mallinfo2()
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * 4096
    return (known.uordblks + known.hblkhd) / 1e6, resident / 1e6


if __name__ == "__main__":
    main()
