"""A receding horizon through contact: plans with exact pairs, in a loop with a simulation that disturbs them.

    python benchmarks/contact_receding_horizon.py [--quick] [--loops WORD ...] [--steps N] [--relaxed]

Each step measures the state, plans over 30 elements with `RecedingHorizon`, and hands the first controls to
`phase.simulate`, which finds the forces of contact on a step five times as fine. Every state is disturbed by chance in
each step, and every 50 steps there is a kick or another goal. Nobody's word is taken for a plan: its rows and pairs are
recomputed from the statement of the model (``tests/mpcc_catalogue/point_check.py``). Shown are

strict   steps whose plan meets rows and pairs to 1e-6
lost     steps without a new plan
end      median distance from the goal in the last step before it changes or a kick comes
touched  share of the steps in whose simulation there is contact
cost     median of the plan's cost over that of `rcp.solve` for the same state from zero, in every 25th step
ms       CPU milliseconds of a step: the median, the mean, the 95th percentile and the largest but for the first

``--relaxed`` shows, for comparison, plans of the relaxed model: delta 1e-6 and no exact pairs.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from contact_tasks import BOX_FORCES, between_walls, box_on_table
from manipulation_tasks import GRIPPER_START, gripper
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mpcc_catalogue.point_check import PointCheck

ELEMENTS, FINER, PERIOD = 30, 5, 50
DELTA, MU = 1e-3, 1e-5


@dataclass(frozen=True)
class Loop:
    """A task that is planned again and again.

    Attributes
    ----------
    name : str
    physics : callable
        ``physics(phase, start)`` states it.
    start : mapping of state to float
    step : float
        Seconds of an element, and between two plans.
    given : sequence of str
        Controls that the simulation is handed.
    forces : sequence of str
        Of contact.
    found : sequence of str
        What the simulation finds.
    weights : mapping of state to float
        Of the squared distance from the goal.
    effort : mapping of control to float
    noise : mapping of state to float
        Standard deviations of what each step adds.
    kick : mapping of state to float
        Largest sudden change every 50 steps.
    goal : callable
        ``goal(random)`` is another one every 50 steps.
    """

    name: str
    physics: Callable
    start: Mapping[str, float]
    step: float
    given: Sequence[str]
    forces: Sequence[str]
    found: Sequence[str]
    weights: Mapping[str, float]
    effort: Mapping[str, float]
    noise: Mapping[str, float]
    goal: Callable[[np.random.Generator], Mapping[str, float]]
    kick: Mapping[str, float] = field(default_factory=dict)

    def phase(self, m: pyo.ConcreteModel, elements: int, step: float) -> rcp.PhaseBlock:
        """The physics on a phase ``b``."""
        m.b = rcp.PhaseBlock(duration=elements * step, elements=elements, scheme="implicit_euler")
        self.physics(m.b, self.start)
        return m.b

    def planned(self) -> pyo.ConcreteModel:
        """What is planned in each step; the goal is a mutable Param."""
        m = pyo.ConcreteModel(name=self.name)
        b = self.phase(m, ELEMENTS, self.step)
        m.goal = pyo.Param(list(self.weights), initialize=0.0, mutable=True)

        def away(b, t):
            return sum(weight * (b.component(name)[t] - m.goal[name]) ** 2 for name, weight in self.weights.items())

        def effort(b, t):
            return sum(weight * b.component(name)[t] ** 2 for name, weight in self.effort.items())

        running = b.integral(lambda b, t: away(b, t) + effort(b, t))
        m.cost = pyo.Objective(expr=running + 2 * away(b, b.final_time))
        return m

    def distance(self, state: Mapping[str, float], goal: Mapping[str, float]) -> float:
        """From the goal, in the states that are positions."""
        return float(np.sqrt(sum((state[name] - number) ** 2 for name, number in goal.items())))


def fingers() -> list[str]:
    """Unknown forces and slips of the gripper's two contacts."""
    return [f"f{finger}_{part}" for finger in "12" for part in ("forward", "backward", "slip")]


LOOPS = (
    Loop(
        "push box",
        box_on_table,
        {"x": 0.0, "y": 0.0, "q": 0.0},
        0.05,
        ("cx", "cy", *BOX_FORCES),
        BOX_FORCES,
        (),
        {"x": 10.0, "y": 10.0, "q": 10.0},
        dict.fromkeys(BOX_FORCES, 0.01),
        {"x": 0.01, "y": 0.01, "q": 0.01},
        lambda random: dict(zip("xyq", random.uniform([-0.5, -0.5, -0.8], [0.5, 0.5, 0.8]), strict=True)),
    ),
    Loop(
        "cart, soft walls",
        partial(between_walls, strength=20.0),
        {"x": 0.0, "q": 0.0, "v": 0.0, "w": 0.0},
        0.02,
        ("u",),
        ("right", "left"),
        ("right", "left"),
        {"x": 10.0, "q": 10.0, "v": 0.1, "w": 0.1},
        {"u": 0.001},
        {"v": 0.02, "w": 0.02},
        lambda random: {"x": 0.0, "q": 0.0},
        {"v": 4.0, "w": 2.0},
    ),
    Loop(
        "gripper",
        gripper,
        GRIPPER_START,
        0.05,
        ("u1", "s1", "u2", "s2"),
        ("n1", "n2"),
        ("n1", "n2", "table", *fingers()),
        {"x": 20.0, "z": 20.0, "v": 0.1, "w": 0.1},
        dict.fromkeys(("u1", "s1", "u2", "s2"), 0.01) | dict.fromkeys(("n1", "n2"), 0.0005),
        {"v": 0.01, "w": 0.01},
        lambda random: {"x": random.uniform(-0.1, 0.1), "z": random.uniform(0.05, 0.3)},
    ),
)


@dataclass
class Record:
    """What was seen in the steps of a loop."""

    milliseconds: list[float] = field(default_factory=list)
    strict: int = 0
    lost: int = 0
    touched: int = 0
    ends: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)


def fresh_cost(loop: Loop, planned: pyo.ConcreteModel, state: Mapping[str, float]) -> float:
    """What `rcp.solve` finds for the same state and goal from zero."""
    m = loop.planned()
    m.goal.store_values(planned.goal.extract_values())
    for name, number in state.items():
        m.b.component(name)[m.b.initial_time].set_value(number)
    result = rcp.solve(m, progress=False, time_limit=60)
    return result.objective if result.solved else np.nan


def run(loop: Loop, steps: int, relaxed: bool) -> Record:
    """So many steps."""
    random, record = np.random.default_rng(7), Record()
    m = loop.planned()
    check = PointCheck(m)
    how = {"delta": 1e-6} if relaxed else {"delta": DELTA, "lift": True}
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, **how)
    controller = rcp.studies.RecedingHorizon(m, m.b, exact_pairs=not relaxed)
    plant = loop.phase(pyo.ConcreteModel(name=f"{loop.name}, simulated"), FINER, loop.step / FINER)
    state = dict(loop.start)
    for k in range(steps):
        show_progress(f"{loop.name}: step {k} of {steps}")
        if k % PERIOD == 0:
            goal = loop.goal(random)
            m.goal.store_values({name: float(goal.get(name, 0.0)) for name in loop.weights})
            state |= {name: state[name] + random.uniform(-most, most) for name, most in loop.kick.items()}
        started = time.process_time()
        step = controller.step(state, advance=loop.step if k else 0.0, mu=1e-4 if relaxed else MU)
        controls = {name: float(step.plan(loop.step)[name]) for name in loop.given}
        record.milliseconds.append(1e3 * (time.process_time() - started))
        point = check.point()
        record.strict += step.solved and point.violation <= 1e-6 >= point.natural
        record.lost += not step.solved
        if k % (PERIOD // 2) == 0 and step.solved:
            record.ratios.append(point.objective / fresh_cost(loop, m, state))
        moved = plant.simulate(controls, initial=state, unknown=loop.found, method="scheme")
        record.touched += any(np.max(getattr(moved, name)) > 1e-6 for name in loop.forces)
        state = {name: float(getattr(moved, name)[-1]) for name in state}
        if k % PERIOD == PERIOD - 1 or k == steps - 1:
            record.ends.append(loop.distance(state, goal))
        state |= {name: state[name] + random.normal(0.0, spread) for name, spread in loop.noise.items()}
    show_progress("")
    return record


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="ten steps")
    parser.add_argument("--loops", nargs="+", default=[""], metavar="WORD")
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--relaxed", action="store_true")
    given = parser.parse_args()
    table = Table(
        [
            ("loop", "<16s"), ("steps", ">5d"), ("strict", ">6d"), ("lost", ">4d"), ("end", ">7.4f"),
            ("touched", ">7.0%"), ("cost", ">6.3f"), ("ms", ">6.1f"), ("mean", ">6.1f"), ("95 %", ">6.1f"),
            ("worst", ">6.1f"),
        ]
    )  # fmt: skip
    table.header()
    for loop in LOOPS:
        if not any(word in loop.name for word in given.loops):
            continue
        steps = 10 if given.quick else given.steps
        seen = run(loop, steps, given.relaxed)
        later = seen.milliseconds[1:]
        table.add(
            loop.name, steps, seen.strict, seen.lost, statistics.median(seen.ends), seen.touched / steps,
            statistics.median(seen.ratios), statistics.median(later), statistics.mean(later),
            float(np.quantile(later, 0.95)), max(later),
        )  # fmt: skip


if __name__ == "__main__":
    main()
