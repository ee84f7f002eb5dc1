"""Four robots push a rod, planned by one planner, by the hub method and by the method of the DisCo paper.

``network`` is the hub method where one robot answers three rounds late, and a tenth of all reports are lost.

    python benchmarks/rod_teams.py [--quick] [--seeds FIRST LAST] [--methods WORD ...] [--robots N ...]
                                   [--results FILE]

Each seed is a task of ``examples/rod.py``. Shown are the measures of the paper and those of physics:

local      tasks in which Ipopt reported success for every local problem of every round (tables I and III of the paper;
           for the central planner: for its one problem)
strict     tasks whose combined plan is strict by its physical score
practical  tasks whose combined plan is practical
replayed   tasks whose rod ends within 2 cm and 2 degrees of its goal where the plan is played back open loop: driving
           forces alone, and whatever contact makes of them. It says how robust plans are, for contact may have other
           solutions than the planned one
rounds     median; of the tasks that became strict where there are any
iterations of Ipopt, mean per local solve
CPU        seconds of all solves, median
parallel   CPU seconds with a processor for each agent: the slowest robot of each round, and the hub; median
cost       ratio to the central planner in the same task, median and worst, over tasks in which both are practical

Shares have 95 % intervals by bootstrap over tasks (10 000 resamples). Results are added to ``--results``, one line
of JSON each; what is there already is not computed again, so a run that was broken off goes on. With ``--robots`` the
table is one of scaling: a row for each size of team.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from open_loop import play_back
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.distributed.rounds import Order
from pyrobocop_pyomo.execution.engine import AgentFailure
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import rod

METHODS = ("central", "hub", "paper")


def central(team: rcp.Team, steps: int) -> dict[str, Any]:
    """One model of the whole team, by the barrier strategy."""
    merged = team.central()
    started = time.process_time()
    result = rcp.solve(
        merged.model,
        strategies=rcp.Strategy("barrier", polish=False),
        backend="vectorised",
        progress=False,
        time_limit=240,
    )
    seconds = time.process_time() - started
    plans = team.plans_of(merged)
    score = team.physics(plans)
    return {
        "strict": score.strict,
        "practical": score.practical,
        "replayed": is_replayed(team, plans),
        "local_success": result.quality is rcp.Quality.OPTIMAL,
        "cost": result.objective,
        "cpu": seconds,
        "parallel": seconds,
        "iterations": sum(step.iterations for step in result.steps),
    }


def is_replayed(team: rcp.Team, plans: Mapping[str, Mapping[str, np.ndarray]]) -> bool:
    """Whether driving forces alone bring the rod to its goal."""
    if not plans:
        return False
    poses, unsolved = play_back(team.physics, plans)
    x, y, theta = np.array(team.physics.goal) - poses[-1]
    turn = (theta + np.pi) % (2 * np.pi) - np.pi
    return unsolved is None and float(np.hypot(x, y)) < 0.02 and abs(float(np.degrees(turn))) < 2.0


class Paper(rcp.teams.Sova):
    """Each round solves the problem with delta = 2 mu, from the primal point of the round before, as in the paper."""

    def order(self, *arguments: Any, **further: Any) -> Order:
        """With this delta in place of the barrier problem of mu."""
        order = super().order(*arguments, **further)
        return replace(order, mu=None, delta=2.0 * order.mu, tolerance=1e-6)


# 12 rounds, constant penalties and delta = 1e-3, whatever the outcome.
PAPER = Paper(
    rcp.teams.BarrierPath(5e-4, turn=5e-4, floor=5e-4),
    None,
    rounds=12,
    until="rounds",
    iterations=5000,
    closing=None,
)


def parallel_seconds(result: rcp.teams.TeamResult, hub: str) -> float:
    """Of the slowest robot in each round, and of the hub that follows; and of the closing steps."""
    total = sum(closed.cpu_seconds for closed in result.closings)
    for record in result.rounds:
        seconds = {name: used for name, (_, _, used) in record.reports.items()}
        total += seconds.pop(hub, 0.0) + max(seconds.values(), default=0.0)
    return total


def together(
    method: str | Paper, engine: Callable[[], Any] = rcp.teams.SerialEngine
) -> Callable[[rcp.Team, int], dict]:
    """A team that plans in rounds."""

    def plan(team: rcp.Team, steps: int) -> dict[str, Any]:
        first: dict[str, int] = {}

        def note(record: rcp.teams.Round) -> None:
            for word in ("practical", "strict"):
                if record.score is not None and getattr(record.score, word):
                    first.setdefault(word, record.number + 1)

        result = team.solve(method, engine=engine(), on_round=note, progress=False)
        if result.score is not None and result.score.strict:
            first.setdefault("strict", len(result.rounds))
        return {
            "strict": result.score is not None and result.score.strict,
            "practical": result.score is not None and result.score.practical,
            "replayed": is_replayed(team, result.plans),
            "local_success": all(
                IpoptStatus[status].solved for record in result.rounds for status, _, _ in record.reports.values()
            ),
            "rounds": len(result.rounds),
            "first": first,
            "cost": result.objective,
            "cpu": result.cpu_seconds,
            "closing": sum(closed.cpu_seconds for closed in result.closings),
            "parallel": parallel_seconds(result, team.hub.name),
            "iterations": result.iterations,
            "disagreement": result.rounds[-1].disagreement.tolist(),
        }

    return plan


class SimulatedNetwork(rcp.teams.SerialEngine):
    """The serial engine behind a network that loses some reports and delivers others late, the same ones in each run.

    A lost report is a failure of its agent in that round. A late agent is at work for some rounds: there is no report
    of it until then, and it gets its next order only afterwards.

    Parameters
    ----------
    lost : float
        Share of reports that are lost, below 1.
    late : mapping of agent to int
        Rounds that an agent is late.
    seed : int
        Of the random numbers that choose the lost reports.
    reliable : collection of str
        Agents whose reports are never lost, such as the hub where it lives with the coordinator.
    """

    name = "simulated network"

    def __init__(
        self, *, lost: float = 0.0, late: Mapping[str, int] | None = None, seed: int = 0, reliable: Collection[str] = ()
    ) -> None:
        super().__init__()
        self._late = dict(late or {})
        self._lost, self._reliable = lost, frozenset(reliable)
        self._random = np.random.default_rng(seed)
        self._at_work: dict[str, tuple[int, Any]] = {}  # rounds that are left, and the report

    def solve(self, orders: Mapping[str, Any]) -> dict[str, Any]:
        """One round, in which some reports are lost, and others not there yet."""
        idle = {name: order for name, order in orders.items() if name not in self._at_work}
        for name, report in super().solve(idle).items():
            self._at_work[name] = self._late.get(name, 0), report
        return {name: self._delivered(name) for name in orders}

    def _delivered(self, name: str) -> Any:
        left, report = self._at_work.pop(name)
        if left:
            self._at_work[name] = left - 1, report
            return AgentFailure(name, "it is still at work")
        if name not in self._reliable and self._random.random() < self._lost:
            return AgentFailure(name, "its report was lost")
        return report


def unreliable() -> SimulatedNetwork:
    """One robot answers three rounds late, and a tenth of the robots' reports are lost."""
    return SimulatedNetwork(lost=0.1, late={"a": 3}, reliable=("rod",))


PLANNERS = {
    "central": central,
    "hub": together("hub"),
    "network": together("hub", unreliable),
    "paper": together(PAPER),
}


def run(
    seeds: Iterable[int], methods: Iterable[str], sizes: Iterable[int], steps: int, path: Path | None
) -> list[dict]:
    """Results of all cases, those of the file included."""
    results = [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []
    known = {(r["seed"], r["method"], r.get("robots", 4)) for r in results}
    cases = [(s, m, n) for n in sizes for s in seeds for m in methods if (s, m, n) not in known]
    for number, (seed, method, robots) in enumerate(cases):
        show_progress(f"{number + 1} of {len(cases)}: seed {seed}, {robots} robots, {method}")
        try:
            result = PLANNERS[method](rod.team(rod.task(seed, robots, steps)), steps)
        except rcp.errors.PyRobocopError as error:
            result = {"error": str(error), "strict": False, "practical": False, "local_success": False}
        results.append({"seed": seed, "method": method, "robots": robots, **result})
        if path:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(results[-1], default=float) + "\n")
    wanted = {(s, m, n) for n in sizes for s in seeds for m in methods}
    return [r for r in results if (r["seed"], r["method"], r.get("robots", 4)) in wanted]


def share(flags: list[bool]) -> str:
    """A share in percent with its interval by bootstrap."""
    values = np.asarray(flags, dtype=float)
    means = np.random.default_rng(0).choice(values, (10_000, values.size)).mean(axis=1)
    low, high = np.percentile(100 * means, [2.5, 97.5])
    return f"{100 * values.mean():.0f} % [{low:.0f}, {high:.0f}]"


def median(results: list[dict], what: str) -> str:
    """Median of a number over the results that have it."""
    values = [r[what] for r in results if what in r]
    return f"{statistics.median(values):.3g}" if values else "-"


def cost_ratios(results: list[dict], of_central: dict[Any, dict]) -> list[float]:
    """Costs over those of the central planner in the same task."""
    pairs = [(r, of_central.get((r["seed"], r.get("robots", 4)))) for r in results if r["practical"]]
    return [r["cost"] / c["cost"] for r, c in pairs if c is not None and c["practical"]]


def tabulate(results: list[dict], methods: Iterable[str], sizes: Iterable[int]) -> None:
    """Print a row for each method and size."""
    of_central = {(r["seed"], r.get("robots", 4)): r for r in results if r["method"] == "central"}
    titles = ("local", "strict", "practical", "replayed")
    table = Table(
        [
            ("robots", ">6d"), ("method", "<8s"), ("tasks", ">5d"), *((title, "<15s") for title in titles),
            ("rounds", ">6s"), ("iterations", ">10s"), ("CPU", ">6s"), ("parallel", ">8s"), ("cost", ">5s"),
            ("worst", ">5s"),
        ]
    )  # fmt: skip
    table.header()
    for robots in sizes:
        for method in methods:
            rows = [r for r in results if r["method"] == method and r.get("robots", 4) == robots]
            if not rows:
                continue
            ratios = cost_ratios(rows, of_central)
            shares = [share([bool(r.get(word)) for r in rows]) for word in ("local_success", *titles[1:])]
            becoming = [{"rounds": r["first"]["strict"]} for r in rows if r.get("first", {}).get("strict")] or rows
            table.add(
                robots, method, len(rows), *shares, median(becoming, "rounds"), median(rows, "iterations"),
                median(rows, "cpu"), median(rows, "parallel"),
                f"{statistics.median(ratios):.2f}" if ratios else "-", f"{max(ratios):.2f}" if ratios else "-",
            )  # fmt: skip


def main() -> None:
    """Read the arguments, plan, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one task with two robots on a coarse mesh")
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 9), metavar=("FIRST", "LAST"))
    parser.add_argument("--methods", nargs="+", choices=list(PLANNERS), default=list(METHODS))
    parser.add_argument("--robots", nargs="+", type=int, default=[4])
    parser.add_argument("--results", type=Path)
    given = parser.parse_args()
    seeds, steps, sizes = list(range(given.seeds[0], given.seeds[1] + 1)), rod.STEPS, given.robots
    if given.quick:
        seeds, steps, sizes = [0], 8, [2]
    tabulate(run(seeds, given.methods, sizes, steps, given.results), given.methods, sizes)


if __name__ == "__main__":
    main()
