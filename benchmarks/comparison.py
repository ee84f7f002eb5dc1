"""Pendulum, acrobot and quadrotor by this package, by hand in CasADi and by ``pyomo.dae``, and as published.

    python benchmarks/comparison.py [--quick] [--repeat N] [--docs FOLDER]

Every way states the same problem: the published mesh, implicit Euler, a guess of zero, Ipopt's tolerances. Where rates
have bounds (the acrobot's), all of them keep derivatives as variables; elsewhere ``pyomo.dae`` does so and the others
substitute. Objective, residual and re-integration error are computed from the states and controls that a way found, by
the same few lines (``smooth_problems/problem.py``). CPU seconds are from nothing to the answer, the least of some runs.

With ``--docs docs`` the page ``docs/examples/comparison.md`` is written. The exit code is 1 where an answer does not
meet its equations, or the objectives of a problem differ.
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from smooth_problems import PROBLEMS, Answer, SmoothProblem, solved_by_casadi, solved_by_phase, solved_by_pyomo_dae
from table import Table, cells_of, markdown, show_progress

import pyrobocop_pyomo as rcp

Solve = Callable[[SmoothProblem, int], Answer]

COLUMNS = [
    ("problem", "<9"), ("way", "<21"), ("variables", ">9d"), ("rows", ">5d"), ("iterations", ">10d"),
    ("CPU s", ">6.2f"), ("J", ">11.7f"), ("residual", ">8.1e"), ("re-integration", ">14.1e"),
]  # fmt: skip
# (iterations, J) of the authors' package with Ipopt 3.11.9; it gives no number for the quadrotor.
PUBLISHED = {"pendulum": (23, 19.8856274), "acrobot": (318, 62.5233007)}


def ways() -> dict[str, Solve]:
    """What can be run on this machine."""
    found: dict[str, Solve] = {"rcp.solve": solved_by_phase, "CasADi by hand": solved_by_casadi}
    if rcp.ipopt.Backend.EXECUTABLE in rcp.ipopt.available_backends():
        found["pyomo.dae"] = solved_by_pyomo_dae
    return found


def measured(
    solve: Callable[[SmoothProblem, int], Answer], problem: SmoothProblem, elements: int, repeat: int
) -> Answer:
    """The answer of some runs, with the least seconds."""
    answers = []
    for _ in range(repeat):
        gc.collect()
        answers.append(solve(problem, elements))
    return replace(answers[0], seconds=min(answer.seconds for answer in answers))


def page(rows: list[tuple]) -> str:
    """The page of the documentation."""
    return f"""# The same problems, stated in other ways

Written by `python benchmarks/comparison.py --docs docs`. Three smooth problems are solved like for like: the published
mesh, implicit Euler, an initial guess of zero, and Ipopt's own tolerances. The versions by hand are in
`benchmarks/smooth_problems`, one short file each. Rows "PYROBOCOP" are values of the authors' package (Raghunathan,
Jha & Romeres, ICRA 2022, doi:10.1109/ICRA46639.2022.9812069), as far as they are known.

{markdown([title for title, _ in COLUMNS], cells_of(rows, COLUMNS), left=2)}

The same code computes objective, residual and re-integration error for all ways, from the states and controls alone.
The residual is the largest violation of an equation, a bound or a boundary value. The re-integration error says how far
the states are from the true motion under these controls: it is the error of implicit Euler, grows along a motion that
is unstable, and is the same for all ways that find the same optimum. CPU seconds are from nothing to the answer; for
`rcp.solve` they include the recomputation of the answer's residuals.

* The acrobot's bounds on rates keep derivatives as variables in all versions. It has many local optima, and a long path
  from a guess of zero: the number of iterations depends on rounding and on the order of variables.
* Elsewhere `pyomo.dae` keeps derivatives as variables, while the others substitute them.
* `benchmarks/cart_pole_transcription.py` measures where the time of a modelling layer goes.
"""


def main() -> None:
    """Print the table and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the pendulum on 20 elements, once")
    parser.add_argument("--repeat", type=int, default=3, help="runs of each; the fastest counts")
    parser.add_argument("--docs", type=Path, help="folder of the documentation, to write the page there")
    arguments = parser.parse_args()
    repeat = 1 if arguments.quick else arguments.repeat
    table = Table(COLUMNS)
    table.header()
    agree = True
    for problem in [PROBLEMS["pendulum"]] if arguments.quick else PROBLEMS.values():
        elements = 20 if arguments.quick else problem.elements
        objectives = []
        for way, solve in ways().items():
            show_progress(f"{problem.name}: {way}")
            answer = measured(solve, problem, elements, repeat)
            show_progress("")
            residual = answer.residual(problem)
            objectives.append(answer.objective(problem))
            agree = agree and residual < 1e-6 and abs(objectives[-1] - objectives[0]) < 1e-5 * objectives[0]
            table.add(
                problem.name, way, answer.variables, answer.rows, answer.iterations, answer.seconds,
                objectives[-1], residual, answer.reintegration_error(problem),
            )  # fmt: skip
        if problem.name in PUBLISHED and not arguments.quick:
            iterations, objective = PUBLISHED[problem.name]
            table.add(problem.name, "PYROBOCOP, published", None, None, iterations, None, objective, None, None)
    if arguments.docs is not None:
        (arguments.docs / "examples").mkdir(parents=True, exist_ok=True)
        (arguments.docs / "examples" / "comparison.md").write_text(page(table.rows), encoding="utf-8")
    print("all objectives agree" if agree else "the answers differ, or do not meet their equations")
    raise SystemExit(0 if agree else 1)


if __name__ == "__main__":
    main()
