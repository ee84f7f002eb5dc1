"""Parameters of a cart-pole with soft walls from noisy motions: 4 machines, 4 sizes of errors, 50 draws of each.

    python benchmarks/identification.py [--quick] [--workers 2] [--file outcomes.jsonl] [--picture identification.png]

Mass and stiffnesses are drawn uniformly; each machine is excited as in `examples/cart_pole_identification.py`. A fit
starts from that of its machine without errors, whose contacts it takes over, and changes where the data ask for it.
It counts if no other way to touch the walls descends from it: that is proven for each fit. With `--file` what is done
survives a kill, and the same command goes on.

"error" is the largest relative error of the three parameters of a fit; "covered" says how many of the 95 % confidence
intervals hold the truth.

Raghunathan, Jha & Romeres, ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import cache, partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from table import Table

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from cart_pole_identification import NOMINAL, STATES, build, label, measured, record

DEVIATIONS = (1e-4, 1e-3, 1e-2, 5e-2)
# Uniformly between these: mass of the pole in kg, stiffness of the walls in N/m.
LEAST, MOST = np.array([0.08, 5.0, 5.0]), np.array([0.3, 20.0, 20.0])


@cache
def machine(number: int, elements: int) -> tuple[tuple[float, ...], dict[str, np.ndarray]]:
    """True parameters of a machine, and its motion without errors."""
    true = np.random.default_rng(7).uniform(LEAST, MOST, size=(4, 3))[number]
    return tuple(true.tolist()), record(true, elements)


def build_problem(elements: int) -> rcp.estimation.EstimationProblem:
    """The fit, with the data of the first machine in it."""
    return rcp.estimation.EstimationProblem(label(build(elements), machine(0, elements)[1], 1.0))


def put(problem: rcp.estimation.EstimationProblem, case: tuple[int, float, int], elements: int) -> None:
    """Data of a case: machine, standard deviation, draw. The guess is the nominal machine on the measured motion."""
    number, deviation, draw = case
    _, motion = machine(number, elements)
    data = measured(motion, deviation, (number, draw, round(1e6 * deviation)))
    phase = problem.experiments[0].motion
    for t, force in zip(phase.points, motion["force"], strict=True):
        phase.force[t].fix(force)
    for name in STATES:
        for t, value in zip(phase.points, data[name], strict=True):
            phase.component(name)[t].set_value(value)
    problem.put(np.concatenate([data[name] for name in STATES]), error=deviation or 1.0)


def read(problem: rcp.estimation.EstimationProblem, result: rcp.SolveResult) -> dict[str, object]:
    """Estimates, and their intervals."""
    found = rcp.estimation.statistics_of(problem)
    intervals = found.to_pandas()[["lower", "upper"]]
    return {**dict(zip(NOMINAL, found.estimates, strict=True)), "intervals": intervals.to_numpy().ravel()}


def fit(machines: int, deviations: tuple[float, ...], draws: int, elements: int, workers: int, file: str | None):
    """All fits: first those without errors, from which the others start."""
    cases = [(number, 0.0, 0) for number in range(machines)]
    cases += [(n, deviation, draw) for n in range(machines) for deviation in deviations for draw in range(draws)]
    return rcp.sweep(
        partial(build_problem, elements),
        cases,
        put=partial(put, elements=elements),
        read=read,
        start_from=[None if not deviation else number for number, deviation, _ in cases].__getitem__,
        workers=workers,
        file=file,
    )


def errors_of(outcomes, elements: int) -> np.ndarray:
    """Relative errors, shape (fits, 3)."""
    return np.array(
        [
            [outcome.numbers[name] / true - 1 for name, true in zip(NOMINAL, machine(n, elements)[0], strict=True)]
            for outcome in outcomes
            for n in [outcome.case.data[0]]
        ]
    )


def covered_in(outcomes, elements: int) -> np.ndarray:
    """Which intervals hold the truth, shape (fits, 3)."""
    found = []
    for outcome in outcomes:
        lower, upper = np.array(outcome.numbers["intervals"]).reshape(3, 2).T
        true = np.array(machine(outcome.case.data[0], elements)[0])
        found.append((lower <= true) & (true <= upper))
    return np.array(found)


def draw_errors(found, elements: int, deviations: tuple[float, ...], path: str) -> None:
    """A box per size of the errors, a panel per machine and parameter."""
    machines = sorted({outcome.case.data[0] for outcome in found})
    figure = Figure(figsize=(3.2 * len(machines), 6.5), dpi=100, layout="constrained")
    axes = figure.subplots(3, len(machines), sharex=True, squeeze=False)
    for number in machines:
        true = machine(number, elements)[0]
        for row, (name, value) in enumerate(zip(NOMINAL, true, strict=True)):
            fits = [
                [outcome.numbers[name] for outcome in found if outcome.case.data[:2] == (number, deviation)]
                for deviation in deviations
            ]
            axis = axes[row, number]
            axis.boxplot(fits, tick_labels=[f"{deviation:g}" for deviation in deviations], widths=0.6)
            axis.axhline(value, color="C3", linewidth=1)
            axis.grid(alpha=0.3)
            if number == 0:
                axis.set_ylabel(name.replace("_", " "))
        axes[0, number].set_title(f"machine {number + 1}")
        axes[-1, number].set_xlabel("standard deviation of the errors")
    figure.savefig(path)


def main() -> None:
    """Fit all, print a table and draw the boxes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two machines, few draws, few elements")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--file", help="where outcomes are kept; the same command goes on behind them")
    parser.add_argument("--picture", help="where to draw the boxes")
    arguments = parser.parse_args()
    machines, draws, elements = (1, 2, 60) if arguments.quick else (4, 50, 200)
    deviations = DEVIATIONS[1:3] if arguments.quick else DEVIATIONS
    started = time.perf_counter()
    found = fit(machines, deviations, draws, elements, 1 if arguments.quick else arguments.workers, arguments.file)
    elapsed = time.perf_counter() - started
    print(f"cart-pole with soft walls, {elements} elements, {machines} machines, {draws} draws\n")
    table = Table(
        [("deviation", ">9.0e"), ("fits", ">5d"), ("proven", ">6d"), ("median error", ">12.1e"), ("90 %", ">8.1e"),
         ("largest", ">8.1e"), ("covered", ">8.1%"), ("seconds / fit", ">13.3f")]
    )  # fmt: skip
    table.header()
    for deviation in (0.0, *deviations):
        fits = [outcome for outcome in found if outcome.case.data[1] == deviation]
        worst = np.abs(errors_of(fits, elements)).max(axis=1)
        covered = covered_in(fits, elements).mean() if deviation else None
        table.add(
            deviation, len(fits), sum(outcome.certificate == "proven" for outcome in fits), float(np.median(worst)),
            float(np.quantile(worst, 0.9)), float(worst.max()), covered, sum(f.seconds for f in fits) / len(fits),
        )  # fmt: skip
    cold = sum(outcome.started_from is None for outcome in found)
    print(f"\n{len(found)} fits, {cold} of them from scratch, {elapsed:.1f} s")
    if found.failed:
        print(f"{len(found.failed)} failed: {found.failed[0].name}: {found.failed[0].reason}")
    if arguments.picture:
        draw_errors(found, elements, deviations, arguments.picture)
    raise SystemExit(0 if found.reached else 1)


if __name__ == "__main__":
    main()
