"""Assemble a belt drive: a gripper lays an elastic belt over one pulley, then draws it over a second one.

The belt is a spring and a damper between two points. It pulls only while it is stretched (one pair), and the first
pulley holds the point that hangs below only while they touch (another pair). In the ``first`` task the gripper pulls
the upper point until the lower one lies on the first pulley; in the ``second`` the belt runs from that pulley's rim to
the gripper, which moves on to the second pulley and turns its hand. ``chain`` is both in one plan: the second task
begins where the first ends, so the first already prepares the second. Between the two tasks the lower point has to lie
on the first pulley; without this condition, a plan that leaves the point beside the pulley is cheaper. The initial
guess of the chain consists of straight lines.

Four scenarios put the second pulley at other places; the fourth has a longer belt. The second task keeps, as published,
at least half of the tension that its target has: the pair lets the belt slacken to that, never below. There the lower
point only rests; its six states are left out.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069; the task is that of Jin, Romeres, Raghunathan, Jha & Tomizuka, Trajectory
optimization for manipulation of deformable objects: assembly of belt drive units, ICRA 2021,
doi:10.1109/ICRA48506.2021.9561556
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist, pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

STIFFNESS, DAMPING, MASS, GRAVITY = 63.34, 4.613, 0.042, 10.0
AXES = ("x", "y", "z")
HANGING = (0.55, 0.0, 0.34)  # where the belt's lower point starts
LOWEST = (0.55, 0.23, 0.34)  # where the belt's lower point lies on the first pulley
RIM = (0.55, 0.23, 0.37)  # where it leaves that pulley
TURNED = (0.0, -pi / 2, 3 * pi / 8)  # angles of the hand at the end


@dataclass(frozen=True)
class Scenario:
    """Where the second pulley is and where the gripper brings the belt, metres."""

    goal: tuple[float, float, float]
    pulley: tuple[float, float, float]
    length: float = 0.1418  # of the belt without tension
    above: float = 0.0  # how much higher than in the first three scenarios the gripper starts

    @property
    def start(self) -> tuple[float, float, float]:
        """Of the gripper."""
        return (0.55, 0.0, 0.4825 + self.above)

    @property
    def lifted(self) -> tuple[float, float, float]:
        """The gripper's place between both tasks."""
        return (0.55, 0.23, 0.5325 + self.above)

    @property
    def tension(self) -> float:
        """At the end of the second task, newtons."""
        return STIFFNESS * (dist(self.goal, RIM) - (self.length - 0.03))


SCENARIOS = {
    1: Scenario((0.39, 0.23, 0.35), (0.42, 0.23, 0.37)),
    2: Scenario((0.41807, 0.23, 0.4719), (0.45807, 0.23, 0.4619)),
    3: Scenario((0.45, 0.23, 0.255), (0.45484, 0.23, 0.305)),
    4: Scenario((0.285, 0.23, 0.35), (0.32, 0.23, 0.37), length=0.2418, above=0.1),
}


def build(
    task: str = "chain",
    scenario: int = 1,
    elements: tuple[int, int] = (200, 50),
    durations: tuple[float, float] = (6.0, 1.0),
) -> pyo.ConcreteModel:
    """Either task or both, by implicit Euler; elements and seconds are those of the first and the second task."""
    m = pyo.ConcreteModel(name="belt drive")
    of = SCENARIOS[scenario]
    cost = 0
    if task in ("first", "chain"):
        m.first = b = rcp.PhaseBlock(duration=durations[0], elements=elements[0], scheme="implicit_euler")
        cost += state_first(b, of, hung=task == "chain")
    if task in ("second", "chain"):
        m.second = b = rcp.PhaseBlock(duration=durations[1], elements=elements[1], scheme="implicit_euler")
        cost += state_second(b, of, start=of.lifted if task == "second" else None)
    if task == "chain":
        gripper = [f"upper_{kind}{axis}" for kind in ("", "v") for axis in AXES]
        m.go_on = rcp.Link(m.first, m.second, states=gripper)
        m.first.initialize(**lines("upper_", of.start, of.lifted, durations[0]))
        m.first.initialize(**lines("lower_", HANGING, LOWEST, durations[0]))
        m.second.initialize(**lines("upper_", of.lifted, of.goal, durations[1]))
    m.cost = pyo.Objective(expr=cost)
    return m


def state_first(b, scenario: Scenario, hung: bool = False):
    """Pull the upper point so that the lower one comes to lie on the first pulley, or has to; returns the cost."""
    guess = (*LOWEST[:2], scenario.start[2])
    for end, first, likely in (("upper", scenario.start, guess), ("lower", HANGING, LOWEST)):
        for axis, value, start, last in zip(AXES, first, likely, LOWEST, strict=True):
            final = last if hung and end == "lower" else None
            place = rcp.State(initial=value, final=final, bounds=(-0.7, 0.7), initial_guess=start)
            b.declare(f"{end}_{axis}", place)
            b.declare(f"{end}_v{axis}", rcp.State(initial=0, bounds=(-0.12, 0.12)))
    for axis in AXES:
        b.declare(f"pull_{axis}", rcp.Control(bounds=(-20, 20)))
    b.tension = rcp.Algebraic(bounds=(0, None))
    b.support = rcp.Algebraic(bounds=(0, None))
    b.slack = rcp.Algebraic(bounds=(0, None))
    b.gap = rcp.Algebraic(bounds=(1e-8, None))

    @b.ode
    def belt(b, t):
        length = distance(at(b, "upper_", t), at(b, "lower_", t))
        rates = {}
        for axis in AXES:
            upper, lower = getattr(b, f"upper_{axis}"), getattr(b, f"lower_{axis}")
            v_upper, v_lower = getattr(b, f"upper_v{axis}"), getattr(b, f"lower_v{axis}")
            inner = b.tension[t] * (upper[t] - lower[t]) / length + DAMPING * (v_upper[t] - v_lower[t])
            weight, support = (GRAVITY, b.support[t]) if axis == "z" else (0.0, 0.0)
            rates[upper], rates[lower] = v_upper[t], v_lower[t]
            rates[v_upper] = (getattr(b, f"pull_{axis}")[t] - inner) / MASS - weight
            rates[v_lower] = (inner - support) / MASS - weight
        return rates

    @b.residual
    def lengths(b, t):
        length = distance(at(b, "upper_", t), at(b, "lower_", t))
        from_pulley = sum((p - q) ** 2 for p, q in zip(at(b, "lower_", t), LOWEST, strict=True))
        return [
            b.slack[t] == b.tension[t] / STIFFNESS + scenario.length - length,
            b.gap[t] == pyo.sqrt(from_pulley + 1e-16),
        ]

    @b.constraint
    def outside_the_pulley(b, t):
        x, y, z = at(b, "lower_", t)
        return ((x - 0.55) / 20) ** 2 + ((y - 0.21) / 2) ** 2 + ((z - 0.37) / 8) ** 2 >= 1e-4

    @b.complementarity
    def pulls_only_when_stretched(b, t):
        return rcp.complements(b.tension[t] >= 0, b.slack[t] >= 0)

    @b.complementarity
    def holds_only_what_touches(b, t):
        return rcp.complements(b.support[t] >= 0, b.gap[t] >= 1e-8)

    lifted = scenario.lifted
    holding = (0.0, 0.0, STIFFNESS * (dist(lifted, LOWEST) - scenario.length))

    def cost(b, t):
        places = square(b, "upper_", t, lifted) + square(b, "lower_", t, LOWEST)
        speeds = square(b, "upper_v", t) + square(b, "lower_v", t)
        return 1000 * places + 10 * speeds + 1e-5 * square(b, "pull_", t, holding)

    return b.integral(cost)


def state_second(b, scenario: Scenario, start=None):
    """Draw the belt over the second pulley and turn the hand; returns the cost."""
    for axis, first, goal in zip(AXES, start or (None,) * 3, scenario.goal, strict=True):
        b.declare(f"upper_{axis}", rcp.State(initial=first, bounds=(-0.7, 0.7), initial_guess=goal))
        b.declare(f"upper_v{axis}", rcp.State(initial=None if start is None else 0, bounds=(-0.27, 0.27)))
    for axis, angle, most in zip(AXES, TURNED, (0.0, 10.0, 200.0), strict=True):
        b.declare(f"angle_{axis}", rcp.State(initial=0, bounds=(-10, 10), initial_guess=angle))
        b.declare(f"angle_v{axis}", rcp.State(initial=0, bounds=(-10, 10)))
        b.declare(f"turn_{axis}", rcp.Control(bounds=(-most, most)))
        b.declare(f"pull_{axis}", rcp.Control(bounds=(-10, 10)))
    least = scenario.tension / 2
    b.tension = rcp.Algebraic(bounds=(least, None))
    b.slack = rcp.Algebraic(bounds=(0, None))

    @b.ode
    def belt(b, t):
        length = distance(at(b, "upper_", t), RIM)
        rates = {}
        for axis, rim in zip(AXES, RIM, strict=True):
            place, speed = getattr(b, f"upper_{axis}"), getattr(b, f"upper_v{axis}")
            angle, angle_rate = getattr(b, f"angle_{axis}"), getattr(b, f"angle_v{axis}")
            inner = b.tension[t] * (place[t] - rim) / length + DAMPING * speed[t]
            rates[place], rates[angle] = speed[t], angle_rate[t]
            rates[speed] = (getattr(b, f"pull_{axis}")[t] - inner) / MASS - (GRAVITY if axis == "z" else 0.0)
            rates[angle_rate] = getattr(b, f"turn_{axis}")[t]
        return rates

    @b.residual
    def length(b, t):
        stretched = distance(at(b, "upper_", t), RIM)
        return b.slack[t] == b.tension[t] / STIFFNESS + (scenario.length - 0.03) - stretched

    @b.constraint
    def outside_the_second_pulley(b, t):
        x, y, z = at(b, "upper_", t)
        centre = scenario.pulley
        return ((x - centre[0] + 1) / 2) ** 2 + (y - centre[1]) ** 2 + ((z - centre[2]) / 2) ** 2 >= 1e-4

    @b.complementarity
    def slackens_only_to_half(b, t):
        return rcp.complements(b.tension[t] >= least, b.slack[t] >= 0)

    def cost(b, t):
        hand = 1e-5 * square(b, "turn_", t) + 100 * square(b, "angle_", t, TURNED) + square(b, "angle_v", t)
        gripper = 1000 * square(b, "upper_", t, scenario.goal) + square(b, "upper_v", t) + 1e-5 * square(b, "pull_", t)
        return gripper + hand + 100 * (b.tension[t] - scenario.tension) ** 2 + 1e4 * (b.upper_y[t] - RIM[1]) ** 2

    return b.integral(cost)


def lines(name: str, start, end, duration: float) -> dict:
    """Straight initial guesses of three components, over the seconds of a phase."""
    return {
        f"{name}{axis}": lambda t, p=p, q=q: p + (q - p) * t / duration
        for axis, p, q in zip(AXES, start, end, strict=True)
    }


def at(b, name: str, t) -> list:
    """Three components at one time."""
    return [getattr(b, f"{name}{axis}")[t] for axis in AXES]


def distance(p, q):
    """Between two points."""
    return pyo.sqrt(sum((a - b) ** 2 for a, b in zip(p, q, strict=True)))


def square(b, name: str, t, goal=(0.0, 0.0, 0.0)):
    """Squared distance from a goal."""
    return sum((value - wanted) ** 2 for value, wanted in zip(at(b, name, t), goal, strict=True))


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The belt from the side over time, and its tension."""
    phases = [phase for phase in (m.component("first"), m.component("second")) if phase is not None]
    rows = figure.subfigures(len(phases), 1, squeeze=False)[:, 0]
    for row, phase in zip(rows, phases, strict=True):
        trajectory = phase.trajectory()
        first = phase.local_name == "first"
        across = "y" if first else "x"  # the first task moves the belt across the pulley, the second along the drive
        seen = [AXES.index(across), 2]
        upper = np.column_stack([getattr(trajectory, f"upper_{AXES[i]}") for i in seen])
        lower = np.broadcast_to([RIM[i] for i in seen], upper.shape)
        if first:
            lower = np.column_stack([getattr(trajectory, f"lower_{AXES[i]}") for i in seen])
        left, right = row.subfigures(1, 2)
        draw_linkage(
            trajectory.time, np.stack([lower, upper], axis=1), title=f"{m.name}: {phase.local_name} task", figure=left
        )
        left.axes[0].set(xlabel=f"{across} [m]", ylabel="z [m]")
        labels = {"tension": "tension [N]", "slack": "slack [m]", "pull_z": "upward pull [N]"}
        trajectory.plot({**labels, **({"support": "support [N]"} if first else {})}, figure=right)


if __name__ == "__main__":
    from run_example import run_example

    tasks = [("first", 1), ("first", 4)]  # the first three scenarios differ in the second task only
    tasks += [(task, scenario) for task in ("second", "chain") for scenario in SCENARIOS]
    cases = {f"{task}-{scenario}": {"task": task, "scenario": scenario} for task, scenario in tasks}
    for scenario in SCENARIOS:
        cases[f"chain-{scenario}"]["elements"] = (40, 50)  # on the fine mesh of the first task this takes minutes
    run_example(build, draw, cases=cases, default="chain-1", coarse={"elements": (8, 6)}, size=(10, 8))
