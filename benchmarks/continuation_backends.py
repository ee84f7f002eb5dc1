"""The same continuation in process and through files, warm and cold.

    python benchmarks/continuation_backends.py [--quick] [--repeats N]

delta goes from 1 to 1e-8 by 0.1 on every backend; each run starts where the last one ended, "warm" with its
multipliers and a small first barrier parameter, "cold" with the point alone. In process the model is written once and a
new delta shifts the relaxed rows; "ASL" and "vectorised" say where derivatives come from. "files" is the
ipopt executable, with ASL: per delta one file is written, one process started, one answer read, and multipliers travel
as suffixes.

Seconds from the stated model to the last answer, relaxing and writing included: the least of the repeats, which take
turns. The ratios are files to ASL, which have the same derivatives. There is no polish and no second strategy: all walk
the same path, and "spread" compares where they end.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from known_mpccs import mpcc_problem
from nonsmooth_problems import PROBLEMS
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.relaxed_model import relaxed_model
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.solving.executable_session import ExecutableSession
from pyrobocop_pyomo.solving.in_process_session import InProcessSession
from pyrobocop_pyomo.solving.ipopt_options import IpoptOptions, warm_continuation
from pyrobocop_pyomo.solving.iterates import Iterate
from pyrobocop_pyomo.solving.strategies import Settings

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

import planar_pushing

PATH = rcp.relaxations.Geometric(first=1.0, factor=0.1, last=1e-8)
OPTIONS = IpoptOptions(default={"max_iter": 500, "bound_relax_factor": 0.0})
CATALOGUE = ("kth3", "bard2", "oligopoly 1.1, 60", "crossed qpec 4x12", "gripper", "string over a floor 31",
             "planted qpec 8x30", "membrane 12x12")  # fmt: skip
MODELS: dict[str, Callable[[], Any]] = {
    **{name: mpcc_problem(name).build for name in CATALOGUE},
    "planar pushing": planar_pushing.build,
    "sliding by step": lambda: PROBLEMS["sliding by step"].build(30),
}
QUICK = ("bard2", "gripper", "sliding by step")
# Name: derivatives, None for the executable; whether multipliers are handed on.
WAYS = {
    "warm ASL": ("asl", True),
    "warm vectorised": ("vectorised", True),
    "warm files": (None, True),
    "cold ASL": ("asl", False),
    "cold files": (None, False),
}


class Walk:
    """One continuation on a new model: what it took and where it ended."""

    def __init__(self, build: Callable[[], Any], derivatives: str | None, warm: bool) -> None:
        model = build()
        deltas = list(PATH.steps())
        started = time.perf_counter()
        with relaxed_model(model, "scholtes", "pair", deltas[0]) as relaxed:
            settings = Settings("scholtes", "pair", Backend.EXECUTABLE)
            is_process = derivatives is None
            session = (
                ExecutableSession(relaxed, settings) if is_process else InProcessSession(relaxed, settings, derivatives)
            )
            try:
                runs: list[Iterate] = []
                for delta in deltas:
                    start = runs[-1] if warm and runs else None
                    purpose = {} if start is None else warm_continuation(delta)
                    runs.append(session.run(delta, OPTIONS.resolve(purpose), NO_DEADLINE, start))
            finally:
                session.close()
        self.seconds = time.perf_counter() - started
        self.iterations = sum(run.iterations for run in runs)
        self.solved = all(run.status.solved for run in runs)
        (objective,) = model.component_data_objects(pyo.Objective, active=True)
        self.objective = float(pyo.value(objective))


def walks(build: Callable[[], Any], repeats: int) -> dict[str, list[Walk]]:
    """Every way, so many times, in turns: what slows the machine down for a while slows down all of them."""
    done: dict[str, list[Walk]] = {way: [] for way in WAYS}
    for _ in range(repeats):
        for way, (derivatives, warm) in WAYS.items():
            done[way].append(Walk(build, derivatives, warm))
    return done


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three models, once")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    names, repeats = (QUICK, 1) if arguments.quick else (tuple(MODELS), arguments.repeats)

    every = {}
    print("seconds\n")
    seconds = Table(
        [
            ("model", "<24"),
            *((way, f">{len(way)}.3f") for way in WAYS),
            ("warm ratio", ">10.1f"),
            ("cold ratio", ">10.1f"),
        ]
    )
    seconds.header()
    for name in names:
        show_progress(name)
        Walk(MODELS[name], "asl", True)  # the first one imports and loads what all need
        every[name] = walks(MODELS[name], repeats)
        show_progress("")
        least = {way: min(walk.seconds for walk in done) for way, done in every[name].items()}
        seconds.add(
            name, *least.values(), least["warm files"] / least["warm ASL"], least["cold files"] / least["cold ASL"]
        )
    columns = list(zip(*(row[1:] for row in seconds.rows), strict=True))
    sums = [sum(column) for column in columns[: len(WAYS)]]
    by_way = dict(zip(WAYS, sums, strict=True))
    seconds.add("sum", *sums, by_way["warm files"] / by_way["warm ASL"], by_way["cold files"] / by_way["cold ASL"])
    seconds.add("median", *(None for _ in WAYS), *(statistics.median(column) for column in columns[len(WAYS) :]))

    print("\niterations of Ipopt, over all deltas; * where a run did not end solved\n")
    iterations = Table([("model", "<24"), *((way, f">{len(way)}") for way in WAYS), ("cold / warm", ">11.2f"),
                        ("objective", ">12.6g"), ("spread", ">8.0e")])  # fmt: skip
    iterations.header()
    totals = dict.fromkeys(WAYS, 0)
    for name, done in every.items():
        first = {way: found[0] for way, found in done.items()}
        for way, walk in first.items():
            totals[way] += walk.iterations
        ends = [walk.objective for walk in first.values()]
        iterations.add(
            name,
            *(f"{walk.iterations}{'' if walk.solved else '*'}" for walk in first.values()),
            first["cold ASL"].iterations / first["warm ASL"].iterations,
            ends[0],
            (max(ends) - min(ends)) / max(1.0, abs(ends[0])),
        )
    iterations.add(
        "sum", *(str(total) for total in totals.values()), totals["cold ASL"] / totals["warm ASL"], None, None
    )


if __name__ == "__main__":
    main()
