"""Four robots keep a rod on its way in closed loop: a team that plans again at each step, in a simulation of contact.

    python benchmarks/team_execution.py [--quick] [--seeds FIRST LAST] [--ticks N] [--results FILE]

Each seed is a task of ``examples/rod.py``. At each tick the first forces of the plan act for a step in a simulation of
contact that knows nothing of the plan, the rod is pushed by chance, and the team plans anew from where everybody is
(`rcp.teams.TeamHorizon`). The simulated world is as the team believes (``as planned``), has 20 % more friction between
robots and rod and a rod that is 20 % heavier (``other world``), or one robot stops after a third of the ticks and keeps
its place: nobody knows (``robot stops``), or the others plan on without it (``robot left``). Shown are

arrived     runs whose rod ends within 2 cm and 5 degrees of its goal
near        within 5 cm and 10 degrees
distance    median distance from the goal at the end, millimetres
angle       median angle from the goal, degrees
failures    solves without a usable point, in all
CPU         seconds per tick and robot, median: all local solves and the hub

"open loop" plays the team's first plan back without looking, in the same worlds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from open_loop import ContactStep
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
import rod

WORLDS = ("as planned", "other world", "robot stops", "robot left")
LOOPS = ("closed", "open")
PUSHED = 0.02  # standard deviation of the change of the rod's velocity in a tick, m/s and rad/s
NEAR = ((0.02, 5.0), (0.05, 10.0))
OF_ROD = ("body.qx", "body.qy", "body.qth", "body.ux", "body.uy", "body.uth")
OF_ROBOT = ("me.x", "me.y", "me.vx", "me.vy")


class World:
    """Where everybody is, by a simulation of contact."""

    def __init__(self, task: rod.Task, kind: str, seed: int) -> None:
        score = task.score
        if kind == "other world":
            heavier = replace(score.body, mass=1.2 * score.body.mass, inertia=1.2 * score.body.inertia)
            score = replace(score, body=heavier, friction=1.2 * score.friction)
        self.step, self.names, self.random = ContactStep.of_score(score), list(task.robots), np.random.default_rng(seed)
        self.stops = self.names[seed % len(self.names)] if kind in ("robot stops", "robot left") else None
        self.pose, self.twist = np.array(task.start), np.zeros(3)
        self.places = np.array(list(task.robots.values()))
        self.speeds = np.zeros_like(self.places)
        self._guess = np.zeros(3 + 6 * len(self.names))

    def move(self, driving: dict[str, np.ndarray], stopped: bool) -> None:
        """One step under driving forces, N, and a push by chance."""
        forces = np.array([driving.get(name, np.zeros(2)) for name in self.names])
        if stopped and self.stops is not None:
            forces[self.names.index(self.stops)] = 0.0
            self.speeds[self.names.index(self.stops)] = 0.0
        self._guess, _ = self.step.solve(self.pose, self.twist, self.places, self.speeds, forces, self._guess)
        self.twist, own = self._guess[:3].copy(), self._guess[3:].reshape(len(self.names), 6)
        self.speeds = own[:, :2].copy()
        self.pose = self.pose + self.step.step * self.twist
        self.places = self.places + self.step.step * self.speeds
        self.twist += PUSHED * self.random.normal(size=3)

    def measured(self) -> dict[str, dict[str, float]]:
        """As `TeamHorizon.step` wants it."""
        found = {"rod": dict(zip(OF_ROD, [*self.pose.tolist(), *self.twist.tolist()], strict=True))}
        for name, place, speed in zip(self.names, self.places.tolist(), self.speeds.tolist(), strict=True):
            found[name] = dict(zip(OF_ROBOT, [*place, *speed], strict=True))
        return found


def forces_of(found: dict[str, dict[str, np.ndarray]], tick: int) -> dict[str, np.ndarray]:
    """Driving force of each robot over a step."""
    return {name: np.array([plan["me.tau_x"][tick], plan["me.tau_y"][tick]]) for name, plan in found.items()}


def run(task: rod.Task, kind: str, loop: str, seed: int, ticks: int) -> dict[str, Any]:
    """One run; where the rod is at its end."""
    world, seconds, failures = World(task, kind, seed), [], 0
    if loop == "open":
        plans = rod.team(task).solve(progress=False).plans
        robots = {name: plans[name] for name in task.robots}
        for tick in range(task.steps):
            world.move(forces_of(robots, tick), 3 * tick >= task.steps)
    else:
        with rcp.teams.TeamHorizon(rod.team(task), rounds=3) as horizon:
            horizon.plan()
            for tick in range(ticks):
                stopped = 3 * tick >= ticks
                if kind == "robot left" and stopped and world.stops in horizon.team.names:
                    horizon.change_team(horizon.team.without(world.stops))
                world.move(forces_of(horizon.read("me.tau_x", "me.tau_y"), 0), stopped)
                measured = {name: at for name, at in world.measured().items() if name in ("rod", *horizon.team.names)}
                started = time.process_time()
                failures += len(horizon.step(measured).failures)
                seconds.append((time.process_time() - started) / len(task.robots))
    away = np.array(task.goal) - world.pose
    return {
        "distance": float(np.hypot(*away[:2])),
        "angle": abs(float(np.degrees(away[2]))),
        "failures": failures,
        "cpu": statistics.median(seconds) if seconds else 0.0,
    }


def results_of(seeds: list[int], ticks: int, steps: int, robots: int, path: Path | None) -> Iterator[dict[str, Any]]:
    """Of all runs, those of the file included."""
    known = [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []
    done = {(r["seed"], r["world"], r["loop"]): r for r in known}
    for seed in seeds:
        for loop in LOOPS:
            for kind in WORLDS:
                key = (seed, kind, loop)
                if key not in done:
                    show_progress(f"seed {seed}, {loop} loop, {kind}")
                    found = run(rod.task(seed, robots, steps), kind, loop, seed, ticks)
                    done[key] = {"seed": seed, "world": kind, "loop": loop, **found}
                    if path:
                        with path.open("a", encoding="utf-8") as file:
                            file.write(json.dumps(done[key]) + "\n")
                yield done[key]


def main() -> None:
    """Read the arguments, run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one task with two robots on a coarse mesh")
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 19), metavar=("FIRST", "LAST"))
    parser.add_argument("--ticks", type=int, default=60)
    parser.add_argument("--results", type=Path)
    given = parser.parse_args()
    seeds, ticks, steps, robots = list(range(given.seeds[0], given.seeds[1] + 1)), given.ticks, rod.STEPS, 4
    if given.quick:
        seeds, ticks, steps, robots = [0], 2, 8, 2
    results = list(results_of(seeds, ticks, steps, robots, given.results))
    table = Table(
        [
            ("loop", "<6s"), ("world", "<11s"), ("runs", ">4d"), ("arrived", ">7d"), ("near", ">4d"),
            ("distance", ">8.1f"), ("angle", ">5.1f"), ("failures", ">8d"), ("CPU", ">6.3f"),
        ]
    )  # fmt: skip
    table.header()
    for loop in LOOPS:
        for kind in WORLDS:
            rows = [r for r in results if r["loop"] == loop and r["world"] == kind]
            counts = [sum(r["distance"] < far and r["angle"] < turned for r in rows) for far, turned in NEAR]
            distance, angle, cpu = (statistics.median(r[label] for r in rows) for label in ("distance", "angle", "cpu"))
            failures = sum(r["failures"] for r in rows)
            table.add(loop, kind, len(rows), *counts, 1e3 * distance, angle, failures, cpu)


if __name__ == "__main__":
    main()
