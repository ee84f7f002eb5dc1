"""The cart-pole by this package, by pyomo.dae, and by hand in CasADi with MUMPS and with fatrop.

    python benchmarks/ratios.py [--quick] [--large] [--elements N ...] [--docs FOLDER]

All ways state the same collocation at Radau points, with the same initial guess (``cart_pole_ways.py``,
``cart_pole_fatrop.py``). Seconds are CPU seconds of this process and of the processes that it starts. Columns in
milliseconds are of one iteration: "linear algebra" is all of Ipopt's linear systems, "evaluation" the functions,
"rest" all other work of the solver. fatrop does not measure the CPU time of linear systems: there "rest" contains them.
"around" is everything outside the solver, in all iterations together: stating, transforming, handing over, checking.
"ratio" is the total against the first row. "faster" marks ways that need less in total than this package.

With ``--docs docs`` the page ``docs/examples/ratios.md`` is written.
"""

from __future__ import annotations

import argparse
import gc
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import casadi
from cart_pole_fatrop import by_fatrop
from cart_pole_ways import as_phase, by_hand_in_casadi, by_pyomo_dae
from iteration_costs import cpu_seconds
from table import Table, cells_of, markdown, show_progress

from pyrobocop_pyomo.ipopt.ipopt_executable import find_ipopt_executable
from pyrobocop_pyomo.linear_solver import find_linear_solver

BY_HAND = "CasADi by hand, MUMPS"
ALIKE = 1e-6
COLUMNS = [
    ("elements", ">8d"), ("way", "<23"), ("iterations", ">10d"), ("linear algebra", ">14.2f"), ("evaluation", ">10.2f"),
    ("rest", ">6.2f"), ("around (s)", ">10.2f"), ("total (s)", ">9.2f"), ("ratio", ">5.2f"), ("objective", ">11.7f"),
    ("verdict", "<15"),
]  # fmt: skip


class Costs(NamedTuple):
    """CPU seconds of one way, and where it ended."""

    algebra: float | None
    evaluation: float
    rest: float
    around: float
    iterations: int
    objective: float

    @property
    def total(self) -> float:
        """From nothing to the answer."""
        return (self.algebra or 0.0) + self.evaluation + self.rest + self.around


def seconds_of_all_processes() -> float:
    """CPU seconds of this process and of those that it started and that ended."""
    return sum(os.times()[:4])


def with_ipopt(way: Callable[..., object], *arguments: object, **own: object) -> Callable[[int, Path], Costs]:
    """A way by Ipopt, measured by Ipopt's statistics."""

    def run(elements: int, folder: Path) -> Costs:
        log_file = folder / "ipopt.log"
        told = {"output_file": str(log_file), "file_print_level": 5, "print_timing_statistics": "yes"}
        gc.collect()  # what the way before has left
        started = seconds_of_all_processes()
        answer = way(elements, *arguments, options={**own, **told})
        total = seconds_of_all_processes() - started
        log = log_file.read_text()
        inside, algebra, evaluation = (
            cpu_seconds(log, name) for name in ("OverallAlgorithm", "PDSystemSolverTotal", "Function Evaluations")
        )
        rest = inside - algebra - evaluation
        return Costs(algebra, evaluation, rest, total - inside, answer.iterations, answer.objective)

    return run


def fatrop(elements: int, folder: Path) -> Costs:
    """The way of fatrop; raises when it did not solve."""
    started = seconds_of_all_processes()
    answer = by_fatrop(elements)
    total = seconds_of_all_processes() - started
    if not answer.success:
        raise RuntimeError(f"fatrop did not converge in {answer.iterations} iterations")
    rest = answer.inside - answer.evaluation
    return Costs(None, answer.evaluation, rest, total - answer.inside, answer.iterations, answer.objective)


def ways() -> dict[str, Callable[[int, Path], Costs]]:
    """What can be measured on this machine."""
    found = {BY_HAND: with_ipopt(by_hand_in_casadi)}
    if casadi.has_nlpsol("fatrop"):
        found["CasADi by hand, fatrop"] = fatrop
    if find_ipopt_executable() is not None:
        found["pyomo.dae, executable"] = with_ipopt(by_pyomo_dae)
    found["this package, MUMPS"] = with_ipopt(as_phase, "vectorised", linear_solver="mumps")
    if find_linear_solver() is not None:
        found["this package, ldl"] = with_ipopt(as_phase, "vectorised", linear_solver="ldl")
    return found


def page(rows: list[tuple[object, ...]]) -> str:
    """The page of the documentation."""
    quicker = sum(row[-1] == "faster" for row in rows)
    text = (__doc__ or "").split("\n\n")[2].strip().replace("``", "`")
    table = markdown([title for title, _ in COLUMNS], cells_of(rows, COLUMNS), left=2)
    return (
        "# Ratios\n\nThe cart-pole swing-up by several programs, measured in one run by "
        f"`python benchmarks/ratios.py --docs docs`. {text}\n\n{table}\n\n"
        f"{quicker} of {len(rows)} rows need less than this package with its default linear solver, ldl, on the same "
        "mesh.\n"
    )


def main() -> None:
    """Print the table, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 elements")
    parser.add_argument("--large", action="store_true", help="3000 and 10 000 elements as well")
    parser.add_argument("--elements", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write the page there")
    arguments = parser.parse_args()
    sizes = [10] if arguments.quick else [*arguments.elements, *([3000, 10_000] if arguments.large else [])]
    table, found = Table(COLUMNS), ways()
    table.header()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for way in found.values():
            way(10, folder)  # what is imported and loaded on first use
        for elements in sizes:
            costs: dict[str, Costs | str] = {}
            for way_name, way in found.items():
                show_progress(f"{way_name}, {elements} elements")
                try:
                    costs[way_name] = way(elements, folder)
                except RuntimeError as error:
                    costs[way_name] = str(error)
            add_rows(table, elements, costs)
    if arguments.docs is not None:
        (arguments.docs / "examples").mkdir(parents=True, exist_ok=True)
        (arguments.docs / "examples" / "ratios.md").write_text(page(table.rows), encoding="utf-8")


def add_rows(table: Table, elements: int, costs: dict[str, Costs | str]) -> None:
    """Show how the ways compare on one mesh."""
    first = costs[BY_HAND]
    best = min(found.total for name, found in costs.items() if name.startswith("this") and isinstance(found, Costs))
    for name, found in costs.items():
        if isinstance(found, str) or isinstance(first, str):
            table.add(elements, name, *[None] * 8, str(found))
            continue
        each = [None if part is None else 1e3 * part / found.iterations for part in found[:3]]
        said = "faster" if found.total < best else ""
        if abs(found.objective - first.objective) > ALIKE * abs(first.objective):
            said = "other objective"
        table.add(
            elements, name, found.iterations, *each, found.around, found.total, found.total / first.total,
            found.objective, said,
        )  # fmt: skip


if __name__ == "__main__":
    main()
