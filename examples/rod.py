"""Discs push a rod to a goal pose, four of them or sixteen, through contacts that nobody has scheduled.

The rod slides on the ground with friction. Each robot is driven by a force of its own, starts anywhere around the rod,
and may touch it where it likes, with Coulomb friction. The solver finds who pushes where and when. Run as a script,
this file plans for all robots in one model; each plan gets a physical score.

Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful Multi-Robot
Collaboration, 2024, arXiv:2410.23283, sec. V-A. Masses, friction, limits and the sampling of tasks are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from math import cos, pi, sin
from pathlib import Path
from string import ascii_lowercase

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

planar = rcp.mechanics.planar

DURATION, STEPS = 2.94, 42
FRICTION, APART = 0.5, 0.25
GROUND = planar.GroundFriction(coefficient=0.2, lever=0.25)
ROD = planar.RigidBody(planar.Capsule(radius=0.05, half_length=0.45), mass=2.0, inertia=2.0 / 12, resistance=GROUND)
DISC = planar.DiscRobot(planar.Disc(0.10), mass=1.0, force_limit=10.0, speed_limit=3.0)
WEAK_DISC = planar.DiscRobot(planar.Disc(0.10), mass=1.0, force_limit=6.0, speed_limit=3.0)
NAMES = (*ascii_lowercase, *(f"a{letter}" for letter in ascii_lowercase))

Point = tuple[float, float]
Pose = tuple[float, float, float]


@dataclass(frozen=True)
class Task:
    """Which rod and which robots, start and goal pose of the rod, and where each robot starts."""

    rod: planar.RigidBody
    disc: planar.DiscRobot
    start: Pose
    goal: Pose
    robots: Mapping[str, Point]
    steps: int = STEPS

    @property
    def grid(self) -> dict:
        """Of every phase of every model of the team."""
        return {"duration": DURATION, "elements": self.steps, "scheme": "implicit_euler"}

    @property
    def score(self) -> planar.Score:
        """What combined plans are worth physically."""
        return planar.Score(self.rod, self.disc, friction=FRICTION, step=DURATION / self.steps, goal=self.goal)


def task(seed: int = 0, robots: int = 4, steps: int = STEPS) -> Task:
    """A random task: the goal up to a metre away and turned; up to 9 robots around a rod, more along both its sides."""
    random = np.random.default_rng(seed)
    angle = random.uniform(-pi, pi)
    distance, direction = random.uniform(0.3, 1.0), random.uniform(-pi, pi)
    turn = random.uniform(-pi / 3, pi / 3)
    goal = (distance * cos(direction), distance * sin(direction), angle + turn)
    start = (0.0, 0.0, angle)
    if robots <= 9:
        places = places_around(random, start, robots)
        return Task(ROD, DISC, start, goal, dict(zip(NAMES, places, strict=False)), steps)
    along = np.linspace(-1.3, 1.3, robots // 2) * ((robots // 2 - 1) / 7)  # as far from each other as eight on a side
    places = [(x, side * (0.15 + random.uniform(0.1, 0.4))) for side in (-1, 1) for x in along]
    placed = [(x * cos(angle) - y * sin(angle), x * sin(angle) + y * cos(angle)) for x, y in places]
    return Task(long_rod(robots / 16), WEAK_DISC, start, goal, dict(zip(NAMES, placed, strict=False)), steps)


def long_rod(times: float) -> planar.RigidBody:
    """A rod for sixteen robots, or so many times as long."""
    mass, ground = 8.0 * times, planar.GroundFriction(coefficient=0.2, lever=0.75 * times)
    shape = planar.Capsule(radius=0.05, half_length=1.45 * times)
    return planar.RigidBody(shape, mass, mass * (3.0 * times) ** 2 / 12, ground)


def places_around(random: np.random.Generator, pose: Pose, robots: int) -> list[Point]:
    """Random places near a rod, apart from each other."""
    places: list[Point] = []
    while len(places) < robots:
        x, y = random.uniform(-1.1, 1.1, 2).tolist()
        gap = ROD.shape.gap_to_disc(DISC.shape.radius, x, y, pose).gap
        if 0.10 < gap < 0.6 and all(np.hypot(x - u, y - v) > 0.35 for u, v in places):
            places.append((x, y))
    return places


# ------------------------------------------------------------------ a team: one model for the rod, one for each robot


def rod(task: Task) -> pyo.ConcreteModel:
    """The rod: its motion under the wrenches of all robots, from start to goal."""
    m = pyo.ConcreteModel(name="rod")
    m.push = rcp.PhaseBlock(list(task.robots), rule=task.rod.state_wrench, **task.grid)
    m.body = rcp.PhaseBlock(**task.grid)
    task.rod.state_motion(m.body, m.push.values(), start=task.start, goal=task.goal)
    return m


def robot(task: Task, name: str) -> pyo.ConcreteModel:
    """One robot: its own motion and contact, a kinematic copy of the rod, and its wrench on the rod."""
    m = pyo.ConcreteModel(name=name)
    m.push = rcp.PhaseBlock([name], rule=task.rod.state_wrench, **task.grid)
    m.body = rcp.PhaseBlock(**task.grid)
    m.me = rcp.PhaseBlock(**task.grid)
    task.rod.state_copy(m.body, start=task.start, goal=task.goal)
    task.disc.state_motion(m.me, m.push[name], start=task.robots[name])
    planar.Contact(task.rod.shape, task.disc.shape, FRICTION).state(m.me, m.body, m.push[name])
    m.cost = pyo.Objective(expr=m.me.integral(effort))
    return m


def team(task: Task) -> rcp.Team:
    """Everybody with a model of its own; they have to agree on the motion of the rod and each wrench on it."""
    return rcp.Team(
        hub=rcp.Agent("rod", rod, task),
        robots=[rcp.Agent(name, robot, task, name) for name in task.robots],
        shared=[
            rcp.Shared("body.qx", "body.qy", "body.qth", penalty=20),
            rcp.Shared("body.ux", "body.uy", "body.uth", penalty=2),
            rcp.Shared("push[{robot}]", penalty=(0.5, 0.5, 2.5)),
        ],
        keep_apart=rcp.KeepApart(("me.x", "me.y"), APART),
        physics=task.score,
    )


def effort(b, t: float):
    """What a robot pays for its driving force, per second."""
    return b.tau_x[t] ** 2 + b.tau_y[t] ** 2


# ------------------------------------------------------------------ all in one model, for comparison


def build(seed: int = 0, robots: int = 4, steps: int = STEPS) -> pyo.ConcreteModel:
    """The rod and all robots, which know everything of each other; wrenches are expressions."""
    now = task(seed, robots, steps)
    m = pyo.ConcreteModel(name=f"rod and {robots} robots")
    m.push = rcp.PhaseBlock(list(now.robots), **now.grid)
    m.me = rcp.PhaseBlock(list(now.robots), **now.grid)
    m.body = rcp.PhaseBlock(**now.grid)
    for push in m.push.values():
        now.rod.state_wrench(push, as_expressions=True)
    now.rod.state_motion(m.body, m.push.values(), start=now.start, goal=now.goal)
    for name, start in now.robots.items():
        now.disc.state_motion(m.me[name], m.push[name], start=start)
        planar.Contact(now.rod.shape, now.disc.shape, FRICTION).state(m.me[name], m.body, m.push[name])
    m.apart = pyo.Constraint(list(combinations(now.robots, 2)), list(m.body.points), rule=far_enough)
    m.cost = pyo.Objective(expr=sum(me.integral(effort) for me in m.me.values()))
    m.score = now.score
    return m


def far_enough(m: pyo.ConcreteModel, first: str, second: str, t: float):
    """Two robots keep 25 cm between their centres."""
    a, b = m.me[first], m.me[second]
    return (a.x[t] - b.x[t]) ** 2 + (a.y[t] - b.y[t]) ** 2 >= APART**2


def plans_of(m: pyo.ConcreteModel) -> dict[str, dict[str, np.ndarray]]:
    """The plans of a team, or the values of one model for all as if they came from one."""
    if hasattr(m, "plans"):
        return m.plans

    def values(where: str, phase) -> dict[str, np.ndarray]:
        variables = phase.component_objects(pyo.Var)
        return {f"{where}.{v.local_name}": np.array([entry.value for entry in v.values()]) for v in variables}

    return {"rod": values("body", m.body)} | {name: values("me", me) for name, me in m.me.items()}


def search(together: bool = True, **case) -> tuple[pyo.ConcreteModel, rcp.SolveResult | rcp.teams.TeamResult]:
    """Plan as a team; or build and solve one model for all."""
    options = {key: case.pop(key) for key in ("backend", "tee")}
    if together:
        now = task(**case)
        result = team(now).solve()
        m = pyo.ConcreteModel(name=f"rod and {len(now.robots)} robots as a team")
        m.score, m.plans = now.score, result.plans
        return m, result
    m = build(**case)
    # Without polish: a score that is strict asks for no more. Derivatives of contact kinematics are far cheaper where
    # each formula is compiled once.
    options["backend"] = options["backend"] or "vectorised"
    result = rcp.solve(m, strategies=rcp.Strategy("barrier", polish=False), **options)
    print(m.score(plans_of(m)))
    return m, result


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The plan of one model for all."""
    draw_plans(figure, m.score, plans_of(m), title=m.name)


def draw_plans(figure, score: planar.Score, plans: Mapping[str, Mapping[str, np.ndarray]], title: str) -> None:
    """The rod and its robots over time, and with what normal and tangential forces each of them pushes."""
    time, bodies = score.paths(plans)
    above, below = figure.subfigures(2, 1, height_ratios=(2.0, 1))
    snapshots = 7 if len(bodies) < 10 else 4
    rcp.scenes.draw_scene(time, bodies, snapshots=snapshots, title=title, figure=above)
    normal, tangential = below.subplots(1, 2, sharex=True)
    for name, plan in plans.items():
        if "me.c" in plan and plan["me.c"].max() > 0.1:
            normal.step(time[1:], plan["me.c"], where="pre", label=name)
            tangential.step(time[1:], plan["me.alpha_plus"] - plan["me.alpha_minus"], where="pre")
    normal.set_ylabel("normal force [N]")
    tangential.set_ylabel("tangential force [N]")
    for axis in (normal, tangential):
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.25)
    normal.legend(ncols=3, fontsize="x-small")


def animate(m: pyo.ConcreteModel, path: Path) -> Path:
    """A film of the plan."""
    return m.score.animate(plans_of(m), path, title=m.name)


if __name__ == "__main__":
    from run_example import run_example

    # With sixteen robots all of this takes long: {"robots": 16} would be a case as well.
    cases = {"team": {"robots": 4}, "one-planner": {"robots": 4, "together": False}}
    coarse = {"steps": 21}
    run_example(build, draw, cases=cases, default="team", coarse=coarse, size=(7, 9), search=search, animate=animate)
