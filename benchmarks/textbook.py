"""Published problems of optimal control: the published value, ours, and how far ours says it may be off.

    python benchmarks/textbook.py [--quick] [--only NAME ...] [--plain | --refine] [--limit SECONDS]
                                  [--docs FOLDER]

Each problem is stated as its source states it, with a natural initial guess (``benchmarks/textbook_problems`` and
``examples/textbook``), and solved with defaults: by `solve` on the mesh of the table, and where that answer does not
say of itself that it is within the tolerance, also with a smaller `mesh_tolerance`; with ``--refine`` in any case.
Shown are the published value; the answers of both and how far each is from it, relatively; what the better one
estimates as its own error of discretisation; elements, iterations of all runs of Ipopt together, and CPU seconds of
both together. The verdict says whether the better answer is within 1e-3 of the published value, and whether that
answer itself said so. A value marked with * was found on a fine mesh, where no source gives enough digits.

With ``--docs docs`` the page ``docs/examples/textbook.md`` is written, with pictures in ``docs/images/textbook``.
The exit code is 0 only if no answer claims to be within the tolerance without being so.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import io
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from example_table import small
from matplotlib.figure import Figure
from table import Table, cells_of, markdown, show_progress
from textbook_problems import EXAMPLES, PROBLEMS, TextbookProblem

import pyrobocop_pyomo as rcp

TOLERANCE = 1e-3
FINER = 1e-4
COLUMNS = [
    ("problem", "<23"), ("source", "<28"), ("published", ">12.7g"), ("solve", ">12.7g"), ("off", ">7.0e"),
    ("refined", ">12.7g"), ("off", ">7.0e"), ("estimated", ">9.0e"), ("elements", ">8d"), ("iterations", ">10d"),
    ("CPU s", ">6.1f"), ("verdict", "<22"),
]  # fmt: skip
QUICK = ("brachistochrone", "bryson_denham", "stirred_tank")


@dataclass(frozen=True)
class Answer:
    """What one way to solve gave.

    Attributes
    ----------
    model : ConcreteModel or None
        Solved; None where the run ended with an error.
    objective : float or None
    estimated : float
        Relative error of the objective that the answer estimates of itself; infinite where it is not solved.
    iterations, elements : int
    seconds : float
        Of the processor.
    message : str
        Of an error.
    """

    model: pyo.ConcreteModel | None
    objective: float | None
    estimated: float
    iterations: int
    elements: int
    seconds: float
    message: str = ""

    @property
    def claims(self) -> bool:
        """Whether it says of itself that it is within the tolerance."""
        return self.estimated <= TOLERANCE

    def off(self, published: float) -> float | None:
        """Relative distance of the objective from a value."""
        return None if self.objective is None else abs(self.objective - published) / abs(published)


def by_solve(problem: TextbookProblem) -> Answer:
    """On the mesh of the table."""

    def run() -> tuple[pyo.ConcreteModel, rcp.SolveResult, int]:
        model = problem.build(elements=problem.elements)
        result = rcp.solve(model)
        return model, result, result.iterations

    return _answer(run)


def by_refinement(problem: TextbookProblem, limit: float) -> Answer:
    """On the finer meshes of a smaller tolerance."""

    def run() -> tuple[pyo.ConcreteModel, rcp.SolveResult, int]:
        model = problem.build(elements=problem.elements)
        result = rcp.solve(model, mesh_tolerance=FINER, progress=False, time_limit=limit)
        return model, result, result.iterations

    return _answer(run)


def _answer(run: Callable[[], tuple[pyo.ConcreteModel, rcp.SolveResult, int]]) -> Answer:
    started = time.process_time()
    try:
        model, result, iterations = run()
    except rcp.errors.PyRobocopError as error:  # a row of the table says so; the others go on
        return Answer(None, None, inf, 0, 0, time.process_time() - started, str(error))
    spent = time.process_time() - started
    error = result.discretisation.relative_objective_error if result.solved else None
    elements = sum(phase.grid.mesh.elements for phase in rcp.phases_of(model))
    return Answer(model, result.objective, inf if error is None else error, iterations, elements, spent)


def verdict(problem: TextbookProblem, answer: Answer) -> str:
    """Whether the answer is within the tolerance, and whether it says so itself."""
    off = answer.off(problem.published)
    if off is None:
        return "failed"
    if off <= TOLERANCE:
        return "within" if answer.claims else "within, not said"
    return "WRONG: said within" if answer.claims else "beyond, and says so"


def better(problem: TextbookProblem, plain: Answer, refined: Answer | None) -> Answer:
    """The answer that claims the smaller error of itself; a user has no published value to choose by."""
    return plain if refined is None or plain.estimated < refined.estimated else refined


def row(problem: TextbookProblem, plain: Answer, refined: Answer | None) -> tuple[Any, ...]:
    """Of the table."""
    chosen = better(problem, plain, refined)
    return (
        problem.name,
        problem.source + (" *" if problem.computed else ""),
        problem.published,
        plain.objective,
        plain.off(problem.published),
        refined and refined.objective,
        refined and refined.off(problem.published),
        chosen.estimated,
        chosen.elements,
        plain.iterations + (refined.iterations if refined else 0),
        plain.seconds + (refined.seconds if refined else 0.0),
        verdict(problem, chosen),
    )


def page(rows: list[tuple[Any, ...]], names: list[str]) -> str:
    """Pictures and numbers of the examples, and the table of all problems."""
    found = {one[0]: one for one in rows}
    within = sum(one[-1].startswith("within") for one in rows)
    parts = [
        "# Textbook problems",
        "Published problems of optimal control, stated as their sources state them and solved with defaults: "
        f"{within} of {len(rows)} within {TOLERANCE:g} of the published value. {len(names)} are examples of one file "
        "each. This page is written by `python benchmarks/textbook.py --docs docs`.",
    ]
    for name in names:
        text = ast.get_docstring(ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))) or ""
        title, *rest = text.split("\n\n")
        parts += [
            f"## {name.replace('_', ' ').capitalize()}",
            f"**{' '.join(title.split())}**",
            *(" ".join(paragraph.split()) for paragraph in rest),
            *([_numbers(found[name])] if name in found else []),
            f"```{{image}} ../images/textbook/{name}.png\n:alt: {name.replace('_', ' ')}\n:width: 640px\n```",
            f"```bash\npython examples/textbook/{name}.py\n```",
        ]
    parts += [
        "## All problems",
        "`off` is the relative distance from the published value, `estimated` the error of discretisation that the "
        "better answer estimates. A source with * gives too few digits: the value beside it was found on a fine mesh.",
        markdown([title for title, _ in COLUMNS], cells_of(rows, COLUMNS), left=2),
    ]
    return "\n\n".join(parts) + "\n"


def _numbers(row: tuple[Any, ...]) -> str:
    _, _, published, plain, _, refined, _, estimated, *_ = row
    shown = (("published", published), ("`solve`", plain), ("refined", refined))
    numbers = ", ".join(f"{what} {value:.8g}" for what, value in shown if value is not None)
    return f"Objective: {numbers}; estimated relative error {estimated:.0e}."


def picture(name: str, model: pyo.ConcreteModel) -> bytes:
    """What the example draws of a solved model."""
    figure = Figure(figsize=(8.0, 4.0), dpi=100, layout="constrained")
    importlib.import_module(name).draw(figure, model)
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return small(written.getvalue())


def main() -> None:
    """Run, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three problems")
    names = [problem.name for problem in PROBLEMS]
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help="some of the problems")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--plain", action="store_true", help="by solve only")
    how.add_argument("--refine", action="store_true", help="with a smaller mesh_tolerance as well, in any case")
    parser.add_argument("--limit", type=float, default=300, metavar="SECONDS", help="for each refinement; 300")
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write the page and pictures there")
    arguments = parser.parse_args()
    shown = arguments.only or (QUICK if arguments.quick else names)
    examples = sorted(path.stem for path in EXAMPLES.glob("*.py") if "def build" in path.read_text(encoding="utf-8"))
    table, rows = Table(COLUMNS), []
    table.header()
    for problem in PROBLEMS:
        if problem.name not in shown:
            continue
        show_progress(problem.name)
        plain = by_solve(problem)
        content = plain.claims and not arguments.refine
        refined = None if arguments.plain or arguments.quick or content else by_refinement(problem, arguments.limit)
        show_progress("")
        rows.append(row(problem, plain, refined))
        table.add(*rows[-1])
        for answer in (plain, refined):
            if answer is not None and answer.message:
                print(f"    {answer.message}")
        if (
            arguments.docs is not None
            and problem.name in examples
            and (chosen := better(problem, plain, refined)).model
        ):
            folder = arguments.docs / "images" / "textbook"
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{problem.name}.png").write_bytes(picture(problem.name, chosen.model))
    within = sum(one[-1].startswith("within") for one in rows)
    print(f"\n{within} of {len(rows)} within {TOLERANCE:g} of the published value")
    if arguments.docs is not None and not arguments.only:
        for name in set(examples) - set(names):  # no published value to compare with
            model = importlib.import_module(name).build(elements=200)
            rcp.solve(model)
            (arguments.docs / "images" / "textbook" / f"{name}.png").write_bytes(picture(name, model))
        (arguments.docs / "examples").mkdir(parents=True, exist_ok=True)
        (arguments.docs / "examples" / "textbook.md").write_text(page(rows, examples), encoding="utf-8")
    sys.exit(1 if any(one[-1].startswith("WRONG") for one in rows) else 0)


if __name__ == "__main__":
    main()
