"""Agents of a few NumPy operations, for the laws of engines: as little as an agent can be, and its faults on demand."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.execution.engine import Engine
from pyrobocop_pyomo.execution.engines import SerialEngine


def noise(seed: int, size: int) -> np.ndarray:
    """Data of an agent."""
    return np.random.default_rng(seed).normal(size=size)


def missing_data(*data: Any) -> np.ndarray:
    """A builder that fails."""
    raise LookupError("there is no such file")


def contradiction(*data: Any) -> np.ndarray:
    """A builder that fails with an error of this package."""
    raise ModelError("the rod is longer than the field.")


@dataclass(frozen=True)
class TinyOrder:
    push: np.ndarray
    fault: str = ""


@dataclass(frozen=True)
class TinyReport:
    values: np.ndarray
    solves: int


@dataclass(frozen=True)
class TinySpec:
    name: str
    builder: Callable[..., np.ndarray] = noise
    data: tuple[Any, ...] = (0, 5)

    def build(self) -> TinyProblem:
        return TinyProblem(self.name, self.builder(*self.data))


class TinyProblem:
    """Its next report depends on all orders before: forgotten, doubled or swapped ones change it."""

    def __init__(self, name: str, data: np.ndarray) -> None:
        self.name, self.data = name, data
        self.x, self.solves = np.zeros_like(data), 0

    def facts(self) -> dict[str, Any]:
        return {"name": self.name, "size": len(self.data)}

    def solve(self, order: TinyOrder) -> TinyReport:
        self.solves += 1
        if order.fault == "raise":
            self.x = -self.x  # half a solve: this has to be done again as well
            raise ArithmeticError("log(-1)")
        if order.fault == "sleep":
            time.sleep(60)
        if order.fault == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if order.fault == "exit":
            raise SystemExit(5)
        self.x = np.sin(3 * self.x + self.data) * 1.7 + order.push
        return TinyReport(self.x, self.solves)  # not a copy: an engine must not let it be changed

    def state(self) -> dict[str, np.ndarray]:
        return {"x": self.x, "solves": np.array(self.solves)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        if state["x"].shape != self.x.shape:
            raise ModelError(f"'{self.name}': {state['x'].shape} values for {self.x.shape}.")
        self.x, self.solves = state["x"].copy(), int(state["solves"])

    def shift(self, steps: int) -> float:
        self.x = np.roll(self.x, steps)
        return float(self.x[0])


def stop_in_round(number: int, process: int) -> Callable[[int], None]:
    """For `play`: a process stops before a round, and does not end."""
    return lambda now: os.kill(process, signal.SIGSTOP) if now == number else None


NAMES = ("hub", "a", "b", "c")
SPECS = tuple(TinySpec(name, data=(seed, 5)) for seed, name in enumerate(NAMES))


def play(engine: Engine, rounds: int, before: Callable[[int], None] = lambda number: None, first: int = 0) -> list[Any]:
    """Rounds of an engine that has started, in which each order depends on all reports of the round before."""
    history: list[Any] = []
    mean = np.zeros(5) if first == 0 else np.mean([r["x"] for r in engine.states().values()], axis=0)
    for number in range(first, rounds):
        before(number)
        reports = engine.solve({name: TinyOrder(mean / (1 + i)) for i, name in enumerate(NAMES)})
        mean = np.mean([report.values for report in reports.values()], axis=0)
        history.append({name: (report.values.tolist(), report.solves) for name, report in reports.items()})
    return history


def undisturbed(rounds: int) -> tuple[list[Any], SerialEngine]:
    """Rounds in this process."""
    engine = SerialEngine()
    engine.start(SPECS)
    return play(engine, rounds), engine


def worker_ids(name: str = "orker") -> list[int]:
    """Of the processes that engines have started, and that have this in their names."""
    return [child.pid for child in multiprocessing.active_children() if name in child.name and child.pid is not None]


def play_and_kill(engine: Engine, process_id: int) -> None:
    """Eight rounds, before whose fourth a process is killed."""
    expected, _ = undisturbed(8)
    seconds: list[float] = []

    def kill(number: int) -> None:
        if number == 3:
            os.kill(process_id, signal.SIGKILL)
        seconds.append(time.perf_counter())

    assert play(engine, 8, kill) == expected
    assert seconds[4] - seconds[3] < 10  # the round in which the worker was missing
