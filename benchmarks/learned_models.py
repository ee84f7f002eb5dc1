"""A learned model in a plan: written out in Pyomo's expressions, and as a function in Python.

    python benchmarks/learned_models.py [--quick]        (Linux: memory is read from /proc)

The ball in the outer ring of `examples/maze.py`, 90 steps, with the mean of a Gaussian process of nine inputs in each.
"expressions" writes the sum over the centres out in Pyomo, "function" calls `rcp.Function`. Each row is a process of
its own. "build" is the processor time that the model takes, "solve" that of `rcp.solve`, "MB" how far the peak of the
process's memory rises from before the model was built. Learning is not counted.

Written out, 4842 centres do not fit: that row is extrapolated, in proportion to the centres, from the two rows before.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from table import Table

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

import maze
from gaussian_process import GaussianProcessMean

CENTRES = 4842
Measured = tuple[float, float, float, int, float]  # build, solve, megabytes, iterations, objective


def written_out(mean: GaussianProcessMean) -> Any:
    """The mean as an expression in Pyomo."""
    weights = (mean.signal**2 * mean.weights).tolist()
    centres, lengths = mean.centres.tolist(), mean.length_scales.tolist()

    def expression(inputs: list[Any]) -> Any:
        return mean.offset + sum(
            weight
            * pyo.exp(-0.5 * sum(((x - c) / length) ** 2 for x, c, length in zip(inputs, centre, lengths, strict=True)))
            for weight, centre in zip(weights, centres, strict=True)
        )

    return expression


def megabytes() -> float:
    """Peak of this process's memory so far."""
    # What getrusage says begins with the peak of the process that started this one.
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return float(status.partition("VmHWM:")[2].split()[0]) / 1024


def measured(way: str, model: maze.LearnedRing, elements: int) -> Measured:
    """Build and solve once, in this process."""
    if way == "expressions":
        model = maze.LearnedRing(model.weights, written_out(model.mean))
    maze.learned = lambda ring, samples: model
    before, started = megabytes(), time.process_time()
    m = maze.build("outer", elements=elements)
    built = time.process_time()
    result = rcp.solve(m)
    solved = time.process_time()
    return built - started, solved - built, megabytes() - before, result.iterations, result.objective


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few centres and steps")
    quick = parser.parse_args().quick
    elements = 12 if quick else 90
    rows = [("expressions", 20), ("expressions", 40)] if quick else [("expressions", 100), ("expressions", 200)]
    rows += [("function", rows[-1][1])] + ([] if quick else [("function", CENTRES)])
    table = Table(
        [("way", "<12s"), ("centres", ">7d"), ("build", ">8.2f"), ("solve", ">8.2f"), ("MB", ">8.0f"),
         ("iterations", ">10d"), ("objective", ">10.6f")]
    )  # fmt: skip
    table.header()
    found: list[Measured] = []
    learned = maze.learned
    for way, samples in rows:
        model = learned("outer", samples)
        if quick:
            found.append(measured(way, model, elements))
        else:
            # A fresh process: memory that another row took, or the learning, is no part of this one.
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                found.append(pool.apply(measured, (way, model, elements)))
        table.add(way, samples, *found[-1])
    (first, second), (few, more) = found[:2], (rows[0][1], rows[1][1])
    grown = [b + (b - a) / (more - few) * (rows[-1][1] - more) for a, b in zip(first[:3], second[:3], strict=True)]
    if not quick:
        table.add("extrapolated", CENTRES, *grown, None, None)


if __name__ == "__main__":
    main()
