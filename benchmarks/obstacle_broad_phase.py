"""What obstacles cost that are never near: all pairs, a broad phase, or only the pairs that a person would state.

    python benchmarks/obstacle_broad_phase.py [--quick] [--obstacles N] [--elements N] [--seeds SEED ...]

A rectangle crosses a field of obstacles. "all pairs" keeps it from each of them on each interval; "broad phase" leaves
out, interval by interval, what is farther away than 1 m at the initial guess, a straight line; "by hand" states the
pairs with obstacles within 1 m of that line. The motion is verified against all obstacles each time. "build" includes
the start of the separations at their exact distances, "ratio" is to "by hand".
"""

from __future__ import annotations

import argparse
import time

from obstacle_problems import field, model_size, near_pairs
from table import Table, show_progress

import pyrobocop_pyomo as rcp

REACH = 1.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 obstacles, 25 intervals, one field")
    parser.add_argument("--obstacles", type=int, default=20)
    parser.add_argument("--elements", type=int, default=100)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    arguments = parser.parse_args()
    obstacles, elements = (10, 25) if arguments.quick else (arguments.obstacles, arguments.elements)
    seeds = [0] if arguments.quick else arguments.seeds

    print(f"{obstacles} obstacles, {elements} intervals; seconds\n")
    table = Table(
        [
            ("field", "<5"), ("stated", "<11"), ("variables", ">9d"), ("rows", ">7d"), ("build", ">7.2f"),
            ("solve", ">8.2f"), ("verify", ">7.2f"), ("iterations", ">10d"), ("rounds", ">6d"), ("ratio", ">6.2f"),
            ("objective", ">10.6f"), ("closest", ">8.4f"), ("verdict", "<8"),
        ]
    )  # fmt: skip
    table.header()
    for seed in seeds:
        shown = []
        for stated in ("by hand", "broad phase", "all pairs"):
            show_progress(f"field {seed}: {stated}")
            shown.append((str(seed), stated, *measured(stated, obstacles, elements, seed)))
        show_progress("")
        by_hand = shown[0][4] + shown[0][5]
        for row in reversed(shown):
            table.add(*row[:9], (row[4] + row[5]) / by_hand, *row[9:])


def measured(stated: str, obstacles: int, elements: int, seed: int) -> tuple:
    """One row: size, seconds, iterations and rounds, and what came out."""
    options = {
        "all pairs": {"broad_phase": None},
        "broad phase": {"broad_phase": REACH},
        "by hand": {"body_pairs": near_pairs(obstacles, seed, REACH), "broad_phase": None},
    }[stated]
    started = time.perf_counter()
    m = field(obstacles, elements, seed, **options)
    m.move.avoid.equations = False
    m.move.avoid.initialize()
    build = time.perf_counter() - started
    size = model_size(m)
    result = rcp.solve(m, progress=False)
    # The pairs that a person left out are not in the block: this model has all of them.
    complete = field(obstacles, elements, seed)
    complete.move.initialize(m.move.trajectory())
    started = time.perf_counter()
    report = complete.move.avoid.verify(equations=False)
    verify = time.perf_counter() - started
    verdict = report.worst.verdict if result.solved else "unsolved"
    taken = (build, result.seconds, verify, result.iterations, len(result.rounds))
    return (*size, *taken, result.objective, report.worst.distance, verdict)


if __name__ == "__main__":
    main()
