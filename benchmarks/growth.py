"""How the cost of a model grows with its mesh: the cart-pole from 100 to 10 000 elements of three Radau stages.

    python benchmarks/growth.py [--quick]

From nothing to what Ipopt can start with: stated, transcribed, handed over. "phase, vectorised" prepares the evaluator
in memory, "phase, ASL" writes a ``.nl`` file and loads it, "pyomo.dae" writes one; "pyomo.dae, ours" is the same model
through `pyrobocop.collocation`, with the evaluator in memory. CPU seconds and peak memory of a
process that does nothing else, less what a tiny model needs. "per element" tells whether the growth is linear.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

from cart_pole_ways import stated_as_phase, stated_with_pyomo_dae, transcribed_by_pyomo_dae
from table import Table, show_progress

from pyrobocop_pyomo.programs.compiled_model import CompiledModel

WAYS = {"phase, vectorised": "vectorised", "phase, ASL": "asl", "pyomo.dae": None, "pyomo.dae, ours": "vectorised"}


def hand_over(way: str, elements: int) -> object:
    """Everything up to where Ipopt could start; what is returned is what has to stay in memory."""
    derivatives = WAYS[way]
    if derivatives is None:
        m = transcribed_by_pyomo_dae(stated_with_pyomo_dae(), elements)
        m.write("/dev/null", format="nl")
        return m
    if way == "pyomo.dae, ours":
        m = transcribed_by_pyomo_dae(stated_with_pyomo_dae(), elements, "pyrobocop.collocation")
        return CompiledModel(m, derivatives)
    return CompiledModel(stated_as_phase(elements), derivatives)


def measure(way: str, elements: int) -> None:
    """Print CPU seconds and megabytes; called in a process of its own."""
    hand_over(way, 2)  # what is imported or compiled at first use belongs to no mesh
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.process_time()
    kept = hand_over(way, elements)
    seconds = time.process_time() - started
    print(seconds, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
    del kept


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="100 elements")
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.measure[0], int(arguments.measure[1]))
        return
    table = Table(
        [("way", "<18"), ("elements", ">8d"), ("seconds", ">8.3f"), ("ms per element", ">14.3f"), ("MB", ">7.1f")]
    )
    table.header()
    for way in WAYS:
        for elements in (100,) if arguments.quick else (100, 1000, 10000):
            show_progress(f"{way}, {elements} elements")
            command = [sys.executable, str(Path(__file__)), "--measure", way, str(elements)]
            runs = [
                tuple(map(float, subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()))
                for _ in range(1 if arguments.quick or elements > 1000 else 2)
            ]
            seconds, memory = min(run[0] for run in runs), min(run[1] for run in runs)
            show_progress("")
            table.add(way, elements, seconds, 1e3 * seconds / elements, memory)


if __name__ == "__main__":
    main()
