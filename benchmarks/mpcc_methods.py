"""Ways to solve problems with complementarity, on the catalogue of problems with known answers.

    python benchmarks/mpcc_methods.py [--quick] [--methods WORD ...] [--problems WORD ...] [--backend WORD]
                                      [--time-limit SECONDS] [--details]
                                      [--random N [--first SEED]]

Each problem starts from its own start values, and the point that a method leaves on the model is checked from the
statement of the model by code that no method shares (``tests/mpcc_catalogue/point_check.py``):

solved    violation <= 1e-6, natural residuals <= 1e-4, and the objective as good as the best known, up to
          1e-4 max(1, |best|)
strict    solved, and every natural residual <= 1e-6
feasible  as solved, whatever the objective: the rest are local optima
false     infeasible problems that the method reports as solved
broken    an exception instead of a point

The natural residual is min(a, b), or the distance of a range from its projection. Products are shown and not checked: a
product of 1e-3 may be 1e5 times 1e-8, which is complementary, and one of 1e-4 may be 1e-2 times 1e-2, which is not.

``--methods`` and ``--problems`` take parts of names; problems are found by their tags as well. Methods that go through
Pyomo's own transformation get the pairs as pairs of pyomo.mpec. ``--random`` makes fresh problems of eight families
(``known_mpccs/random_families.py``); ``seconds`` are CPU seconds.
"""

from __future__ import annotations

import argparse
import logging
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from known_mpccs import MpccProblem, mpcc_problems
from known_mpccs.random_families import random_problems
from mpcc_ways import METHODS, Effort
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mpcc_catalogue.point_check import Point, PointCheck

QUICK = ("kth3", "ralph1", "bard1", "toll road", "both at least one")
BACKENDS = ("asl", "vectorised", "executable")


@dataclass(frozen=True)
class Outcome:
    """What became of one problem by one method."""

    problem: MpccProblem
    point: Point | None
    effort: Effort | None
    seconds: float
    error: str
    maximise: bool

    @property
    def feasible(self) -> bool:
        """Whether the point satisfies the constraints and the pairs."""
        p = self.point
        return p is not None and p.violation <= 1e-6 and p.natural <= 1e-4

    @property
    def solved(self) -> bool:
        """Whether the point is feasible and as good as the best known."""
        return self.feasible and self.problem.feasible and self.point.as_good_as(self.problem.best, self.maximise)

    @property
    def strict(self) -> bool:
        """Whether it is solved, and the pairs are met to 1e-6."""
        return self.solved and self.point.natural <= 1e-6

    @property
    def claims(self) -> bool:
        """Whether the method says that it has solved the problem."""
        return self.effort is not None and self.effort.claims

    def verdict(self) -> str:
        """One word."""
        if self.error:
            return self.error
        if not self.problem.feasible:
            return "falsely solved" if self.claims else "refused"
        words = {self.strict: "strict", self.solved and not self.strict: "solved"}
        return words.get(True, "local" if self.feasible else "failed")


def run(problem: MpccProblem, method: Callable[..., Effort], backend: str, limit: float) -> Outcome:
    """Solve one problem by one method; an exception is part of the answer."""
    model = problem.build()
    check = PointCheck(model)
    started = time.process_time()
    effort, error = None, ""
    try:
        effort = method(model, backend, limit)
    except Exception as exception:  # whatever a method raises counts against it, and the next problem is tried
        error = type(exception).__name__
    seconds = time.process_time() - started
    return Outcome(problem, None if error else check.point(), effort, seconds, error, check.maximise)


def chosen(names: list[str] | None, known: Any, words: Callable[[Any], list[str]]) -> list[Any]:
    """Those of `known` one of whose words holds one of `names`; all without names."""
    if not names:
        return list(known)
    return [candidate for candidate in known if any(name in word for name in names for word in words(candidate))]


def summary(method: str, outcomes: list[Outcome]) -> tuple[Any, ...]:
    """One line of the table."""
    feasible = [outcome for outcome in outcomes if outcome.problem.feasible]
    counts = [outcome.effort.iterations for outcome in feasible if outcome.effort is not None]
    return (
        method,
        sum(outcome.solved for outcome in feasible),
        sum(outcome.strict for outcome in feasible),
        sum(outcome.feasible for outcome in feasible),
        sum(outcome.claims for outcome in outcomes if not outcome.problem.feasible),
        sum(bool(outcome.error) for outcome in outcomes),
        sum(counts),
        int(statistics.median(counts)) if counts else None,
        sum(outcome.seconds for outcome in outcomes),
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="five problems")
    parser.add_argument("--methods", nargs="+", metavar="WORD")
    parser.add_argument("--problems", nargs="+", metavar="WORD", help="names or tags")
    parser.add_argument("--backend", choices=BACKENDS, help="which Ipopt; by default the best that is present")
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds per problem and method")
    parser.add_argument("--random", type=int, metavar="N", help="instead: N problems of each of eight random families")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="of the first random problem")
    parser.add_argument("--details", action="store_true", help="one line per problem as well")
    arguments = parser.parse_args()
    logging.getLogger("pyomo").setLevel(logging.CRITICAL)  # what a method says about a point is in the table

    words = {"IN_PROCESS_ASL": "asl", "IN_PROCESS_VECTORISED": "vectorised"}
    backend = arguments.backend or words.get(rcp.ipopt.available_backends()[0].name, "executable")
    known = mpcc_problems() if arguments.random is None else [*random_problems(arguments.first, arguments.random)]
    problems = chosen(arguments.problems, known, lambda problem: [problem.name, *problem.tags])
    if arguments.quick:
        problems = [problem for problem in problems if problem.name in QUICK]
    methods = chosen(arguments.methods, METHODS.items(), lambda item: [item[0]])

    count = sum(problem.feasible for problem in problems)
    print(f"{count} feasible and {len(problems) - count} infeasible problems, backend {backend}\n")
    results: dict[str, list[Outcome]] = {}
    table = Table(
        [
            ("method", "<38"), ("solved", ">6d"), ("strict", ">6d"), ("feasible", ">8d"), ("false", ">5d"),
            ("broken", ">6d"), ("iterations", ">10d"), ("median", ">6d"), ("seconds", ">7.1f"),
        ]
    )  # fmt: skip
    table.header()
    for name, method in methods:
        results[name] = []
        for number, problem in enumerate(problems, start=1):
            show_progress(f"{name}: {number} of {len(problems)}, {problem.name}")
            results[name].append(run(problem, method, backend, arguments.time_limit))
        show_progress("")
        table.add(*summary(name, results[name]))
    if arguments.details:
        show_details(results)


def show_details(results: dict[str, list[Outcome]]) -> None:
    """One line per problem and method."""
    print()
    table = Table(
        [
            ("problem", "<32"), ("method", "<38"), ("verdict", "<20"), ("objective", ">14.7g"), ("best", ">14.7g"),
            ("violation", ">9.1e"), ("a*b", ">8.1e"), ("natural", ">8.1e"), ("iterations", ">10d"),
            ("seconds", ">7.2f"),
        ]
    )  # fmt: skip
    table.header()
    for outcomes in zip(*results.values(), strict=True):
        for name, outcome in zip(results, outcomes, strict=True):
            p = outcome.point
            numbers = (None,) * 4 if p is None else (p.objective, p.violation, p.product, p.natural)
            iterations = None if outcome.effort is None else outcome.effort.iterations
            table.add(
                outcome.problem.name, name, outcome.verdict(), numbers[0], outcome.problem.best, *numbers[1:],
                iterations, outcome.seconds,
            )  # fmt: skip


if __name__ == "__main__":
    main()
