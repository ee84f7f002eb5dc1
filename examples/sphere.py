"""Quadrotors catch a falling ball, three of them or twelve, and put it down on a pedestal in a wanted orientation.

The ball is released at rest two metres up. The quadrotors are points with a size and a thrust, all of whose directions
are free within limits; they carry their own weight, and push with friction: they stop the ball, carry it aside, turn it
and hold it at rest. Run as a script, this file plans for all of them in one model; the plan gets a physical score.

Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful Multi-Robot
Collaboration, 2024, arXiv:2410.23283, sec. V-B. Sizes, masses, limits and the sampling of tasks are ours.
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
from rod import plans_of

import pyrobocop_pyomo as rcp

spatial = rcp.mechanics.spatial

DURATION, STEPS = 2.94, 42
FRICTION, APART = 0.7, 0.26
# Initial guess: until when the ball falls (seconds), what it keeps of its speed then, and when the quadrotors reach it.
FALL, KEPT, MEETING = 0.35, 0.4, 0.4
BALL = spatial.RigidBody(spatial.Sphere(0.20), mass=0.6, inertia=0.4 * 0.6 * 0.20**2)
LARGE_BALL = spatial.RigidBody(spatial.Sphere(0.60), mass=6.0, inertia=0.4 * 6.0 * 0.60**2)
QUADROTOR = spatial.SphereRobot(
    spatial.Sphere(0.12), mass=0.8, force_limit=((-10.0, 10.0), (-10.0, 10.0), (0.0, 20.0)), speed_limit=4.0
)
ABOVE_GROUND = ((None, None), (None, None), (QUADROTOR.shape.radius, None))

Place = tuple[float, float, float]
Pose = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Task:
    """Which ball, its start and goal pose, and where each quadrotor starts."""

    ball: spatial.RigidBody
    start: Pose
    goal: Pose
    robots: Mapping[str, Place]
    steps: int = STEPS

    @property
    def grid(self) -> dict:
        """Of every phase of every model of the team."""
        return {"duration": DURATION, "elements": self.steps, "scheme": "implicit_euler"}

    @property
    def score(self) -> spatial.Score:
        """What combined plans are worth physically."""
        step = DURATION / self.steps
        return spatial.Score(self.ball, QUADROTOR, friction=FRICTION, step=step, goal=self.goal)


def task(seed: int, robots: int = 3, steps: int = STEPS) -> Task:
    """A random task: the pedestal 40 cm aside, a turn of 20 to 60 degrees, quadrotors in a ring around the fall."""
    random = np.random.default_rng(seed)
    axis = random.normal(size=3)
    turn = np.radians(random.uniform(20.0, 60.0)) * axis / np.linalg.norm(axis)
    aside = random.uniform(-pi, pi)
    ball = BALL if robots <= 4 else LARGE_BALL
    start, goal = (0.0, 0.0, 2.0, 0.0, 0.0, 0.0), (0.4 * cos(aside), 0.4 * sin(aside), 0.8, *turn.tolist())
    first = random.uniform(-pi, pi)
    places = {}
    for i, name in zip(range(robots), ascii_lowercase, strict=False):
        angle = first + 2 * pi * (i + random.uniform(-0.15, 0.15)) / robots
        out = ball.shape.radius + QUADROTOR.shape.radius + random.uniform(0.15, 0.5)
        places[name] = (out * cos(angle), out * sin(angle), random.uniform(1.3, 1.8))
    return Task(ball, start, goal, places, steps)


# ------------------------------------------------------------------ a team: one model for the ball, one for each robot


def sphere(task: Task) -> pyo.ConcreteModel:
    """The ball: its motion under gravity and the wrenches of all quadrotors, from release to rest."""
    m = pyo.ConcreteModel(name="sphere")
    m.push = rcp.PhaseBlock(list(task.robots), rule=task.ball.state_wrench, **task.grid)
    m.body = rcp.PhaseBlock(**task.grid)
    state_ball(task, m.body, m.push.values())
    return m


def quadrotor(task: Task, name: str) -> pyo.ConcreteModel:
    """One quadrotor: its own motion and contact, a kinematic copy of the ball, and its wrench on the ball."""
    m = pyo.ConcreteModel(name=name)
    m.push = rcp.PhaseBlock([name], rule=task.ball.state_wrench, **task.grid)
    m.body = rcp.PhaseBlock(**task.grid)
    m.me = rcp.PhaseBlock(**task.grid)
    task.ball.state_copy(m.body, start=task.start, goal=task.goal)
    m.body.initialize(guessed_fall(task, m.body))
    state_quadrotor(task, name, m.me, m.body, m.push[name])
    m.cost = pyo.Objective(expr=m.me.integral(effort))
    return m


def team(task: Task) -> rcp.Team:
    """The ball in the middle, and an agent for each quadrotor. Its rotation is the ball's own affair: it is round."""
    return rcp.Team(
        hub=rcp.Agent("sphere", sphere, task),
        robots=[rcp.Agent(name, quadrotor, task, name) for name in task.robots],
        shared=[
            rcp.Shared("body.qx", "body.qy", "body.qz", penalty=20.0),
            rcp.Shared("body.ux", "body.uy", "body.uz", penalty=2.0),
            rcp.Shared("body.wx", "body.wy", "body.wz", penalty=1.0),
            rcp.Shared("push[{robot}]", penalty=(5.0, 5.0, 5.0, 50.0, 50.0, 50.0)),
        ],
        keep_apart=rcp.KeepApart(("me.x", "me.y", "me.z"), APART),
        physics=task.score,
    )


def state_ball(task: Task, body, pushes) -> None:
    """Motion of the ball under wrenches, above the ground; it starts from falling a while, then being put down."""
    task.ball.state_motion(body, pushes, start=task.start, goal=task.goal)
    body.qz.setlb(task.ball.shape.radius)
    body.initialize(guessed_fall(task, body))


def guessed_fall(task: Task, body) -> dict[str, np.ndarray]:
    """Height and vertical speed of the ball: free at first, then caught, and a cubic to the goal. An initial guess."""
    time = np.array(list(body.time))
    left = time[-1] - FALL
    s = np.clip((time - FALL) / left, 0.0, 1.0)
    caught, speed = task.start[2] - 9.81 * FALL**2 / 2, -KEPT * 9.81 * FALL
    down = caught + (task.goal[2] - caught) * (3 - 2 * s) * s**2 + speed * left * s * (1 - s) ** 2
    height = np.where(time < FALL, task.start[2] - 9.81 * time**2 / 2, down)
    speeds = np.diff(height) / np.diff(time)
    return {"qz": height, "uz": speeds if len(body.uz) == len(speeds) else np.concatenate([[0.0], speeds])}


def state_quadrotor(task: Task, name: str, me, body, push) -> None:
    """Motion of a quadrotor and its contact with the ball; it starts from flying to the ball and then with it."""
    QUADROTOR.state_motion(me, push, start=task.robots[name], within=ABOVE_GROUND)
    flight = guessed_flight(task, name, me, body)
    force = flight.pop("c")
    me.initialize(flight)
    spatial.Contact(task.ball.shape, QUADROTOR.shape, FRICTION).state(me, body, push)
    me.initialize(c=force)


def guessed_flight(task: Task, name: str, me, body) -> dict[str, np.ndarray]:
    """Straight to the lower side of the ball, then with it, sharing its weight: an initial guess, and no more."""
    time = np.array(list(me.time))
    ball = np.column_stack([list(body.component(name).extract_values().values()) for name in ("qx", "qy", "qz")])
    x, y, _ = task.robots[name] / np.hypot(*task.robots[name][:2])
    # Of many, every second one flies beside the ball, so that all have room.
    steepness = 1.0 if len(task.robots) <= 4 or list(task.robots).index(name) % 2 else 0.3
    normal = np.array([x, y, -steepness]) / np.hypot(1.0, steepness)
    with_ball = ball + (task.ball.shape.radius + QUADROTOR.shape.radius) * normal
    arrived = np.clip(time / MEETING, 0.0, 1.0)[:, None]
    place = (1.0 - arrived) * np.array(task.robots[name]) + arrived * with_ball
    speed = np.vstack([np.zeros(3), np.diff(place, axis=0) / np.diff(time)[:, None]])
    share = task.ball.mass * task.ball.gravity / (-normal[2] * len(task.robots))
    force = np.where(time[1:] > MEETING, share, 0.01)
    thrust = QUADROTOR.hovering_force - force[:, None] * normal
    of_axes = {"": place, "v": speed, "tau_": thrust}
    return {"c": force} | {f"{of}{x}": values[:, i] for of, values in of_axes.items() for i, x in enumerate("xyz")}


def effort(b, t: float):
    """What a quadrotor pays for its thrust, per second."""
    return b.tau_x[t] ** 2 + b.tau_y[t] ** 2 + b.tau_z[t] ** 2


# ------------------------------------------------------------------ all in one model, for comparison


def build(seed: int = 0, robots: int = 3, steps: int = STEPS) -> pyo.ConcreteModel:
    """The ball and all quadrotors, which know everything of each other."""
    now = task(seed, robots, steps)
    m = pyo.ConcreteModel(name=f"sphere and {robots} quadrotors")
    m.push = rcp.PhaseBlock(list(now.robots), rule=now.ball.state_wrench, **now.grid)
    m.me = rcp.PhaseBlock(list(now.robots), **now.grid)
    m.body = rcp.PhaseBlock(**now.grid)
    state_ball(now, m.body, m.push.values())
    for name in now.robots:
        state_quadrotor(now, name, m.me[name], m.body, m.push[name])
    m.apart = pyo.Constraint(list(combinations(now.robots, 2)), list(m.body.points), rule=far_enough)
    m.cost = pyo.Objective(expr=sum(me.integral(effort) for me in m.me.values()))
    m.score = now.score
    return m


def far_enough(m: pyo.ConcreteModel, first: str, second: str, t: float):
    """Two quadrotors keep 26 cm between their centres."""
    a, b = m.me[first], m.me[second]
    return (a.x[t] - b.x[t]) ** 2 + (a.y[t] - b.y[t]) ** 2 + (a.z[t] - b.z[t]) ** 2 >= APART**2


def search(**case) -> tuple[pyo.ConcreteModel, rcp.SolveResult]:
    """Build and solve, without polish: a score that is strict asks for no more."""
    options = {key: case.pop(key) for key in ("backend", "tee")}
    m = build(**case)
    options["backend"] = options["backend"] or "vectorised"
    result = rcp.solve(m, strategies=rcp.Strategy("barrier", polish=False), **options)
    print(m.score(plans_of(m)))
    return m, result


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The ball and its quadrotors when it is released, caught and put down; its height, and how hard each pushes."""
    plans = plans_of(m)
    time, bodies = m.score.paths(plans)
    above, below = figure.subfigures(2, 1, height_ratios=(2.0, 1))
    rcp.scenes.draw_scene(time, bodies, snapshots=3, title=m.name, figure=above)
    height, force = below.subplots(1, 2)
    height.plot(time, bodies[0].translation[:, 2], color="black")
    height.set_ylabel("height of the ball [m]")
    for name in m.me:
        force.step(time[1:], plans[name]["me.c"], where="pre", label=name)
    force.set_ylabel("normal force [N]")
    force.legend(ncols=3, fontsize="small")
    for axis in (height, force):
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.25)


def animate(m: pyo.ConcreteModel, path: Path) -> Path:
    """A film of the plan."""
    return m.score.animate(plans_of(m), path, title=m.name)


if __name__ == "__main__":
    from run_example import run_example

    # Twelve quadrotors in one model take long: {"robots": 12} would be a case as well.
    cases = {"three": {"robots": 3}}
    coarse = {"steps": 21}
    run_example(build, draw, cases=cases, default="three", coarse=coarse, size=(7, 9), search=search, animate=animate)
