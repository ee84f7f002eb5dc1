"""Four problems by this package and by hand in CasADi; the cart-pole by pyomo.dae and with fatrop as well.

    python benchmarks/ratios.py [--quick] [--problem NAME ...] [--large] [--elements N ...] [--repeat N] [--docs FOLDER]

All ways of a problem state the same equations on the same mesh, with the same initial guess: the cart-pole by
collocation at three Radau points (`cart_pole_ways.py`, `cart_pole_fatrop.py`), a cart-pole between soft walls
("contact"), a quadrotor and a parking car by implicit Euler (`casadi_ways.py`). By hand, contact is solved by a
relaxation that goes down in ten solves; this package takes its first strategy alone, which ends with a polish and a
certificate. "second opinion" lets it cross-check the answer by other strategies, as it does by default. Parking keeps
clear of its neighbours at the nodes, by the same rows in all ways; an `ObstacleAvoidanceBlock` would look between them.

Seconds are CPU seconds of this process and of the processes that it starts, the least of some runs. Columns in
milliseconds are of one iteration: "linear algebra" is all of Ipopt's linear systems, "evaluation" the functions, "rest"
all other work of the solver. fatrop does not measure the CPU time of linear systems: there "rest" contains them.
"around" is everything outside the solver, in all iterations together: stating, transforming, handing over, checking.
"ratio" is the total against the program by hand in CasADi with MUMPS. "faster" marks ways that need less in total than
the fastest of this package.

"rcp.solve, as it is" has nothing chosen: it makes the mesh finer where the error is above its tolerance, tries other
starts, and has second opinions. Its ratio is against the program by hand on the mesh that it ends on.

"rcp.solve" and "SolverFactory" are two doors to the same solver: the latter is `SolverFactory("pyrobocop.ipopt")`, or
`SolverFactory("pyrobocop.mpcc")` where there are pairs. "doors" is the total of the latter against the former with the
same linear solver. With a linear solver in its name, `rcp.solve` makes neither finer meshes nor other starts. Without
pairs it does more than "pyrobocop.ipopt": it checks the model, scales it, recomputes residuals by code of its own,
tests the curvature, and reads what an estimate of the mesh's error needs. Where equations depend on each other at the
initial guess (the quadrotor), it starts from the motion under the controls of the guess. Scaling changes the number of
iterations.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi
import pyomo.environ as pyo
from cart_pole_fatrop import by_fatrop
from cart_pole_ways import ALONE, by_hand_in_casadi, by_pyomo_dae, stated_as_phase
from casadi_ways import CONTACT, PARKING, QUADROTOR, Ended, by_hand, parking_as_phase
from iteration_costs import cpu_seconds
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.util import NoOptimalSolutionError
from table import Table, cells_of, markdown, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable
from pyrobocop_pyomo.linear_solver import find_linear_solver

sys.path.append(str(Path(__file__).parent.parent / "examples"))  # examples are scripts, not a package
import cart_pole_soft_walls  # isort: skip
import quadrotor  # isort: skip

BY_HAND = "CasADi by hand, MUMPS"
BY_DEFAULT = "rcp.solve, as it is"
DOORS = ("rcp.solve", "SolverFactory")
MOST_OF_DOORS = 1.1
ALIKE = 1e-6
FEW = 20
COLUMNS = [
    ("problem", "<9"), ("elements", ">8d"), ("way", "<25"), ("iterations", ">10d"), ("linear algebra", ">14.2f"),
    ("evaluation", ">10.2f"), ("rest", ">6.2f"), ("around (s)", ">10.2f"), ("total (s)", ">9.2f"), ("ratio", ">5.2f"),
    ("doors", ">5.2f"), ("objective", ">11.7f"), ("verdict", "<15"),
]  # fmt: skip

PER_ITERATION = "linear algebra", "evaluation", "rest"  # in milliseconds
Way = Callable[[int, Path], "Costs"]


class Costs(NamedTuple):
    """CPU seconds of one way, and where it ended: with which objective, and on how many elements."""

    algebra: float | None
    evaluation: float
    rest: float
    around: float
    iterations: int
    objective: float
    elements: int

    @property
    def total(self) -> float:
        """From nothing to the answer."""
        return (self.algebra or 0.0) + self.evaluation + self.rest + self.around


class Compared(NamedTuple):
    """A problem, and how it is stated and solved.

    Attributes
    ----------
    phase : callable
        The model for a number of elements.
    by_hand : callable
        The program by hand: ``by_hand(elements, options=...)``.
    sizes : list of int
        Elements, by default.
    solver : str
        Name of the solver of Pyomo.
    choices : dict
        Of `rcp.solve` and of a solver that has the same.
    """

    phase: Callable[[int], pyo.ConcreteModel]
    by_hand: Callable[..., Any]
    sizes: list[int]
    solver: str = "pyrobocop.ipopt"
    choices: dict[str, Any] = {}  # noqa: RUF012


PROBLEMS = {
    "cart_pole": Compared(stated_as_phase, by_hand_in_casadi, [100, 300, 1000]),
    "contact": Compared(
        lambda elements: cart_pole_soft_walls.build(elements=elements),
        partial(by_hand, problem=CONTACT),
        [100, 300],
        "pyrobocop.mpcc",
        {"strategies": rcp.Strategy("barrier", exploration=0)},
    ),
    "quadrotor": Compared(
        lambda elements: quadrotor.build(elements=elements), partial(by_hand, problem=QUADROTOR), [100, 300]
    ),
    "parking": Compared(parking_as_phase, partial(by_hand, problem=PARKING), [100, 300]),
}


def seconds_of_all_processes() -> float:
    """CPU seconds of this process and of those that it started and that ended."""
    return time.process_time() + sum(os.times()[2:4])  # the former is the finer clock


def with_ipopt(way: Callable[..., Any], **own: object) -> Way:
    """A way by Ipopt, measured by Ipopt's statistics."""

    def run(elements: int, folder: Path) -> Costs:
        log_file = folder / "ipopt.log"
        log_file.unlink(missing_ok=True)
        told = {"output_file": str(log_file), "file_print_level": 5, "print_timing_statistics": "yes"}
        gc.collect()  # what the way before has left
        started = seconds_of_all_processes()
        answer = way(elements, options={**own, **told, "file_append": "yes"})
        total = seconds_of_all_processes() - started
        log = log_file.read_text()
        inside, algebra, evaluation = (
            cpu_seconds(log, name) for name in ("OverallAlgorithm", "PDSystemSolverTotal", "Function Evaluations")
        )
        rest = inside - algebra - evaluation
        ended_on = getattr(answer, "elements", None) or elements
        return Costs(algebra, evaluation, rest, total - inside, answer.iterations, answer.objective, ended_on)

    return run


def fatrop(elements: int, folder: Path) -> Costs:
    """The way of fatrop; raises when it did not solve."""
    started = seconds_of_all_processes()
    answer = by_fatrop(elements)
    total = seconds_of_all_processes() - started
    if not answer.success:
        raise RuntimeError(f"fatrop did not converge in {answer.iterations} iterations")
    rest = answer.inside - answer.evaluation
    return Costs(None, answer.evaluation, rest, total - answer.inside, answer.iterations, answer.objective, elements)


def by_solve(elements: int, problem: Compared, options: dict[str, object], **choices: Any) -> Ended:
    """The phase by `rcp.solve`; raises when it did not solve."""
    result = rcp.solve(problem.phase(elements), progress=False, options=options, **{**ALONE, **choices})
    if not result.solved:
        raise RuntimeError(f"rcp.solve: {result.outcome}")
    return Ended(result.objective, result.iterations)


def by_default(elements: int, problem: Compared, options: dict[str, object]) -> Ended:
    """The phase by `rcp.solve` with nothing chosen, wherever its mesh ends; raises when it did not solve."""
    model = problem.phase(elements)
    result = rcp.solve(model, progress=False, options=options)
    if not result.solved:
        raise RuntimeError(f"rcp.solve: {result.outcome}")
    return Ended(result.objective, result.iterations, sum(phase.grid.mesh.elements for phase in rcp.phases_of(model)))


def by_solver(elements: int, problem: Compared, options: dict[str, object]) -> Ended:
    """The phase by a solver of Pyomo, which raises when it did not solve."""
    choices = {**ALONE, **problem.choices} if problem.choices else {}
    results = SolverFactory(problem.solver).solve(problem.phase(elements), solver_options=options, **choices)
    return Ended(results.incumbent_objective, results.extra_info.iteration_count)


def ways(name: str) -> dict[str, Way]:
    """What can be measured of a problem on this machine."""
    problem = PROBLEMS[name]
    found: dict[str, Way] = {BY_HAND: with_ipopt(problem.by_hand)}
    found[BY_DEFAULT] = with_ipopt(partial(by_default, problem=problem))
    if name == "cart_pole" and casadi.has_nlpsol("fatrop"):
        found["CasADi by hand, fatrop"] = fatrop
    if name == "cart_pole" and find_ipopt_executable() is not None:
        found["pyomo.dae, executable"] = with_ipopt(by_pyomo_dae)
    solve = partial(by_solve, problem=problem, **problem.choices)
    found["rcp.solve, MUMPS"] = with_ipopt(solve, linear_solver="mumps")
    last = "MUMPS" if find_linear_solver() is None else "ldl"
    found[f"rcp.solve, {last}"] = with_ipopt(solve, linear_solver=last.lower())
    found[f"SolverFactory, {last}"] = with_ipopt(partial(by_solver, problem=problem), linear_solver=last.lower())
    if problem.choices:
        found["rcp.solve, second opinion"] = with_ipopt(partial(by_solve, problem=problem), linear_solver=last.lower())
    return found


def measured(found: dict[str, Way], elements: int, repeat: int, folder: Path) -> dict[str, Costs | str]:
    """The least of some runs of each way, taken in turn; what a way says that did not solve."""
    costs: dict[str, Costs | str] = {}
    for _ in range(repeat):
        for name, way in found.items():
            show_progress(f"{name}, {elements} elements")
            known = costs.get(name)
            if isinstance(known, str):
                continue
            try:
                again = way(elements, folder)
            except (RuntimeError, NoOptimalSolutionError) as error:
                costs[name] = str(error).splitlines()[0]
            else:
                costs[name] = again if known is None or again.total < known.total else known
    show_progress("")
    return costs


def by_hand_on_other_meshes(way: Way, costs: dict[str, Costs | str], repeat: int, folder: Path) -> dict[int, Costs]:
    """The program by hand on the meshes that other ways ended on, by their elements."""
    by_hand, found = costs[BY_HAND], {}
    for cost in costs.values():
        if isinstance(cost, Costs) and isinstance(by_hand, Costs) and cost.elements != by_hand.elements:
            there = measured({BY_HAND: way}, cost.elements, repeat, folder)[BY_HAND]
            if isinstance(there, Costs):
                found[cost.elements] = there
    return found


def add_rows(
    table: Table, problem: str, elements: int, costs: dict[str, Costs | str], elsewhere: dict[int, Costs]
) -> None:
    """Show how the ways compare on one mesh, and one that ended on another mesh with the program by hand there."""
    own = {
        name: found
        for name, found in costs.items()
        if name.startswith(DOORS) and name != BY_DEFAULT and isinstance(found, Costs)
    }
    best = min((found.total for found in own.values()), default=0.0)
    for name, found in costs.items():
        first = costs[BY_HAND] if isinstance(found, str) else elsewhere.get(found.elements, costs[BY_HAND])
        if isinstance(found, str) or isinstance(first, str):
            table.add(problem, elements, name, *[None] * 9, str(found))
            continue
        each = [None if part is None else 1e3 * part / found.iterations for part in found[:3]]
        said = "faster" if found.total < best else ""
        if found.elements != elements:
            said = f"on {found.elements} elements"
        elif abs(found.objective - first.objective) > ALIKE * abs(first.objective):
            said = "other objective"
        other = own.get(name.replace(*reversed(DOORS))) if name.startswith(DOORS[1]) else None
        table.add(
            problem, elements, name, found.iterations, *each, found.around, found.total, found.total / first.total,
            None if other is None else found.total / other.total, found.objective, said,
        )  # fmt: skip


def summary(rows: list[tuple[Any, ...]]) -> str:
    """Which rows are faster, and how the doors compare."""
    quicker, doors = sum(row[-1] == "faster" for row in rows), [row[-3] for row in rows if row[-3] is not None]
    text = f"{quicker} of {len(rows)} rows need less than the fastest of this package on the same mesh."
    if doors:
        above = sum(max(ratio, 1.0 / ratio) > MOST_OF_DOORS for ratio in doors)
        text += f" The doors: {min(doors):.2f} to {max(doors):.2f}; {above} of {len(doors)} differ by more than 10 %."
    return text


def page(rows: list[tuple[Any, ...]]) -> str:
    """The page of the documentation."""
    text = "\n\n".join((__doc__ or "").strip().split("\n\n")[2:])
    return (
        "# Ratios\n\nFour problems by several programs, measured in one run by "
        f"`python benchmarks/ratios.py --docs docs`.\n\n{text}\n\n{tables(cells_of(rows, COLUMNS))}\n\n## Together\n\n"
        f"{summary(rows)}\n"
    )


def tables(cells: list[list[str]]) -> str:
    """Two tables for each problem: what is for all iterations together, and what is for one."""
    titles = [title for title, _ in COLUMNS]
    together = [titles.index(title) for title in titles if title not in ("problem", *PER_ITERATION)]
    single = [titles.index(title) for title in ("elements", "way", *PER_ITERATION)]
    found = []
    for problem in dict.fromkeys(row[0] for row in cells):
        of_problem = [row for row in cells if row[0] == problem]
        found.append(f"## {problem}")
        for places in (together, single):
            chosen = [[row[k] for k in places] for row in of_problem]
            found.append(markdown([titles[k] for k in places], chosen, left=2))
    return "\n\n".join(found)


def main() -> None:
    """Print the table, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"{FEW} elements, once")
    parser.add_argument("--problem", nargs="+", choices=list(PROBLEMS), default=list(PROBLEMS))
    parser.add_argument("--large", action="store_true", help="the cart-pole on 3000 and 10 000 elements as well")
    parser.add_argument("--elements", type=int, nargs="+", help="instead of each problem's own sizes")
    parser.add_argument("--repeat", type=int, default=3, help="runs of each way; the fastest counts")
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write the page there")
    arguments = parser.parse_args()
    table = Table(COLUMNS)
    table.header()
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.problem:
            found = ways(name)
            for way in found.values():
                way(FEW, Path(folder))  # what is imported and loaded on first use
            sizes = [FEW] if arguments.quick else arguments.elements or PROBLEMS[name].sizes
            if arguments.large and name == "cart_pole":
                sizes = [*sizes, 3000, 10_000]
            for elements in sizes:
                repeat = 1 if arguments.quick else arguments.repeat
                costs = measured(found, elements, repeat, Path(folder))
                elsewhere = by_hand_on_other_meshes(found[BY_HAND], costs, repeat, Path(folder))
                add_rows(table, name, elements, costs, elsewhere)
    print(summary(table.rows))
    if arguments.docs is not None:
        (arguments.docs / "examples").mkdir(parents=True, exist_ok=True)
        (arguments.docs / "examples" / "ratios.md").write_text(page(table.rows), encoding="utf-8")


if __name__ == "__main__":
    main()
