"""The linear solver of this package and Ipopt's MUMPS on the same sixty problems.

    python benchmarks/linear_solvers.py [--quick] [--only NAME ...] [--always]

Problems of textbooks, examples with contact and obstacles, nonsmooth problems, programs with pairs, and the cart-pole
in growing numbers of elements, each solved by `solve` with defaults, without exploration (whose budget is time). Shown
for MUMPS and for what `solve` takes by default, which is the solver of this package (ldl) where no dense part of the
system is too large, with `--always` in all: iterations of all runs of Ipopt, CPU seconds that Ipopt spent on linear
systems (its own "PDSystemSolverTotal"), and the objective. Two answers are alike where both are solved and the
objectives agree to 1e-6; chaotic runs of nonconvex problems end in different optima, by the least change of rounding.
"""

from __future__ import annotations

import argparse
import importlib
import io
import re
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyomo.environ as pyo
from cart_pole_ways import stated_as_phase, stated_with_pyomo_dae, transcribed_by_pyomo_dae
from known_mpccs import mpcc_problem
from nonsmooth_problems import PROBLEMS as NONSMOOTH
from table import Table, show_progress
from textbook_problems import PROBLEMS as TEXTBOOK

import pyrobocop_pyomo as rcp

COLUMNS = [
    ("problem", "<28"), ("iterations", ">10d"), ("ldl", ">6d"), ("systems, s", ">10.3f"), ("ldl", ">8.3f"),
    ("ratio", ">6.2f"), ("objective", ">14.8g"), ("ldl", ">14.8g"), ("verdict", "<12"),
]  # fmt: skip
ALIKE = 1e-6
MEASURABLE = 0.02  # CPU seconds below which Ipopt's clock, of a thousandth, tells nothing
QUICK = ("bryson_denham", "stirred_tank")
EXAMPLES = {
    "planar_pushing": {}, "pushing_among_obstacles": {"elements": 40}, "parking": {}, "quadrotor": {"elements": 50},
    "quadrotor_window": {"elements": 12}, "stick_slip": {"elements": 30}, "crossing": {"elements": 16},
    "acrobot": {}, "two_link_arm": {"elements": 20},
}  # fmt: skip
PAIRS = ("ralph1", "planted qpec 8x30", "planted qpec 30x300", "aligned qpec 20x150", "oligopoly 1.0, 150", "braess")


@dataclass(frozen=True)
class Ended:
    """How one solve ended; `sign` makes a minimum of the objective."""

    solved: bool
    objective: float
    sign: float
    iterations: int
    seconds: float


def problems() -> dict[str, Callable[[], pyo.ConcreteModel]]:
    """Builders of all problems."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    found: dict[str, Callable[[], pyo.ConcreteModel]] = {}
    for problem in TEXTBOOK:
        found[problem.name] = lambda problem=problem: problem.build(elements=problem.elements)
    for name, how in EXAMPLES.items():
        found[name] = lambda name=name, how=how: importlib.import_module(name).build(**how)
    for name, nonsmooth in NONSMOOTH.items():
        found[name] = lambda nonsmooth=nonsmooth: nonsmooth.build(20, 2, "radau")
    for name in PAIRS:
        found[name] = lambda name=name: mpcc_problem(name).build()
    for elements in (100, 1000):
        found[f"cart-pole {elements} x 3"] = lambda elements=elements: stated_as_phase(elements)
    found["pyomo.dae 200"] = lambda: transcribed_by_pyomo_dae(stated_with_pyomo_dae(), 200)
    return found


def solve(model: pyo.ConcreteModel, linear_solver: str | None) -> Ended:
    """One solve with a linear solver, or with that of the defaults."""
    log = io.StringIO()
    options = {"print_timing_statistics": "yes", "print_level": 3}
    if linear_solver is not None:
        options["linear_solver"] = linear_solver
    try:
        result = rcp.solve(model, options=options, tee=[log], strategies=rcp.Strategy(exploration=0), progress=False)
    except rcp.errors.PyRobocopError:
        return Ended(False, float("nan"), 1.0, 0, 0.0)
    seconds = sum(map(float, re.findall(r"PDSystemSolverTotal\.*: *([\d.]+)", log.getvalue())))
    objective = next(model.component_data_objects(pyo.Objective, active=True))
    sign = -1.0 if objective.sense == pyo.maximize else 1.0
    return Ended(result.solved, float(result.objective), sign, result.iterations, seconds)


def verdict(mumps: Ended, own: Ended) -> str:
    """What the second solve is, beside the first."""
    if mumps.solved != own.solved:
        return "better" if own.solved else "WORSE"
    if not own.solved:
        return "both fail"
    difference = (own.objective - mumps.objective) / max(1.0, abs(mumps.objective))
    if abs(difference) <= ALIKE:
        return "alike"
    return "other, better" if mumps.sign * difference < 0 else "other, worse"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two problems")
    parser.add_argument("--only", nargs="+", help="these problems")
    parser.add_argument("--always", action="store_true", help="ldl also where MUMPS would be taken")
    arguments = parser.parse_args()
    chosen = arguments.only or (QUICK if arguments.quick else None)
    table, ratios, verdicts = Table(COLUMNS), [], []
    table.header()
    for name, build in problems().items():
        if chosen is not None and name not in chosen:
            continue
        show_progress(name)
        ended = [solve(build(), linear_solver) for linear_solver in ("mumps", "ldl" if arguments.always else None)]
        mumps, own = ended
        ratio = own.seconds / mumps.seconds if mumps.seconds >= MEASURABLE else None
        said = verdict(mumps, own)
        table.add(
            name, mumps.iterations, own.iterations, mumps.seconds, own.seconds, ratio, mumps.objective, own.objective,
            said,
        )  # fmt: skip
        verdicts.append(said)
        if ratio is not None:
            ratios.append(ratio)
    good = sum(said not in ("WORSE", "other, worse") for said in verdicts)
    print(f"\n{good} of {len(verdicts)} end as well as with MUMPS")
    if ratios:
        print(f"time for linear systems, ratio: median {statistics.median(ratios):.2f}, largest {max(ratios):.2f}")


if __name__ == "__main__":
    main()
