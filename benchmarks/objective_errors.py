"""The estimated error of the objective beside the true one, on three meshes of twenty-two smooth problems each.

    python benchmarks/objective_errors.py [--quick] [--only NAME ...] [--docs FOLDER]

Each problem (``benchmarks/estimate_problems``) is solved on three meshes with the default scheme, three Radau stages
per element, and on three more with another scheme. The estimate is `result.discretisation.objective_error`; the true
error is the distance of the objective from its exact value, or from that on 96 elements with four Radau stages, which
itself has to agree with that on 64 to a tenth of the true error. An error below 1e-9 of the objective is called
rounding, and its estimate has to be as small. With ``--docs docs`` the table on the page
``docs/explanation/mesh-refinement.md`` is written.

The exit code is 0 only if every estimate is within a factor of 10.
"""

from __future__ import annotations

import argparse
import math
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from estimate_problems import FINE, FINER, PROBLEMS, EstimateProblem
from table import Table, markdown, show_progress

import pyrobocop_pyomo as rcp

FACTOR, ROUNDING = 10.0, 1e-9
COLUMNS = [
    ("problem", "<18"), ("with", "<26"), ("scheme", "<14"), ("elements", ">8d"), ("objective", ">14.9g"),
    ("estimate", ">8.1e"), ("true error", ">10.1e"), ("ratio", ">7.2f"), ("verdict", "<20"),
]  # fmt: skip
QUICK = ("integrator", "mixed_limit", "two_linked")
BEGIN, END = "<!-- table of estimates: begin -->", "<!-- table of estimates: end -->"


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
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write the table there")
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
    print(f"\n{right} of {len(table.rows)} estimates within a factor of {FACTOR:g}")
    if arguments.docs is not None and not arguments.only:
        _write(arguments.docs / "explanation" / "mesh-refinement.md", table, right)
    sys.exit(0 if right == len(table.rows) else 1)


def _write(page: Path, table: Table, right: int) -> None:
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    said = f"{right} of {len(table.rows)} estimates are within a factor of {FACTOR:g} of the true error."
    problems = [list(rows) for _, rows in groupby(table.rows, key=lambda row: row[0])]
    rows = markdown(
        ["problem", "with", "schemes", "estimate over true error"], [_summary(of) for of in problems], left=4
    )
    page.write_text(f"{head}{BEGIN}\n\n{said}\n\n{rows}\n\n{END}{tail}", encoding="utf-8")


def _summary(rows: list[Any]) -> list[str]:
    ratios = [row[-2] for row in rows if row[-2] is not None]
    schemes = dict.fromkeys(row[2] for row in rows)
    return [rows[0][0], rows[0][1], ", ".join(schemes), f"{min(ratios):.2f} to {max(ratios):.2f}"]


if __name__ == "__main__":
    main()
