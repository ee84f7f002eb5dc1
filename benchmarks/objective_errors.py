"""The estimated error of the objective beside the true one, on three meshes of twenty-two smooth problems each.

    python benchmarks/objective_errors.py [--quick] [--only NAME ...]

Each problem (``benchmarks/estimate_problems``) is solved on three meshes with the default scheme, three Radau stages
per element, and on three more with another scheme. The estimate is `result.discretisation.objective_error`; the true
error is the distance of the objective from its exact value, or from that on 96 elements with four Radau stages, which
itself has to agree with that on 64 to a tenth of the true error. An error below 1e-9 of the objective is called
rounding, and its estimate has to be as small.

The exit code is 0 only if every estimate is within a factor of 10.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

from estimate_problems import FINE, FINER, PROBLEMS, EstimateProblem
from table import Table, show_progress

import pyrobocop_pyomo as rcp

FACTOR, ROUNDING = 10.0, 1e-9
COLUMNS = [
    ("problem", "<18"), ("with", "<26"), ("scheme", "<14"), ("elements", ">8d"), ("objective", ">14.9g"),
    ("estimate", ">8.1e"), ("true error", ">10.1e"), ("ratio", ">7.2f"), ("verdict", "<20"),
]  # fmt: skip
QUICK = ("integrator", "mixed_limit", "two_linked")


def objective(problem: EstimateProblem, **how: Any) -> tuple[float, float | None, str]:
    """The answer on a mesh, its estimated error, and the name of the scheme."""
    model = problem.build(**how)
    result = rcp.solve(model, progress=False, mesh_tolerance=None)
    name = rcp.phases_of(model)[0].grid.scheme.name
    if not result.solved:
        return result.objective, math.inf, name
    return result.objective, result.discretisation.objective_error, name


def reference(problem: EstimateProblem) -> tuple[float, float]:
    """The value to compare with, and how far it is to be trusted."""
    if problem.exact is not None:
        return problem.exact, 0.0
    fine, finer = (objective(problem, **how)[0] for how in (FINE, FINER))
    return finer, abs(fine - finer)


def verdict(estimate: float | None, true: float, size: float, trusted: float) -> str:
    """Whether an estimate is right."""
    if estimate is None:
        return "not known"
    if estimate == math.inf:
        return "not solved"
    if true <= ROUNDING * size:
        return "rounding" if estimate <= FACTOR * ROUNDING * size else "too large"
    if trusted > 0.1 * true:
        return "no reference"
    if estimate * FACTOR < true:
        return "too small"
    return "too large" if estimate > FACTOR * true else "within"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [problem.name for problem in PROBLEMS]
    parser.add_argument("--quick", action="store_true", help="three problems")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help="some of the problems")
    arguments = parser.parse_args()
    shown = arguments.only or (QUICK if arguments.quick else names)
    table = Table(COLUMNS)
    table.header()
    for problem in PROBLEMS:
        if problem.name not in shown:
            continue
        show_progress(problem.name)
        value, trusted = reference(problem)
        sets: tuple[tuple[tuple[int, ...], dict[str, Any]], ...]
        sets = ((problem.meshes, {}), (problem.second_meshes, problem.second))
        for meshes, scheme in sets:
            for elements in meshes:
                found, estimate, name = objective(problem, elements=elements, **scheme)
                true = abs(found - value)
                show_progress("")
                table.add(
                    problem.name, problem.what, name, elements, found, estimate, true,
                    estimate / true if estimate is not None and true > 0.0 else None,
                    verdict(estimate, true, abs(value), trusted),
                )  # fmt: skip
    right = sum(row[-1] in ("within", "rounding") for row in table.rows)
    ratios = [row[-2] for row in table.rows if row[-2] is not None]
    extremes = f"{min(ratios, default=math.nan):.2f} to {max(ratios, default=math.nan):.2f}"
    print(f"\n{right} of {len(table.rows)} estimates within a factor of {FACTOR:g}: {extremes} times the true error")
    sys.exit(0 if right == len(table.rows) else 1)


if __name__ == "__main__":
    main()
