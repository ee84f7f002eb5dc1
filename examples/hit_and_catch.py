"""Six robots on a field, each at home in its own part of it, bring a puck to a goal: by passing.

The puck glides with viscous drag. No robot may leave its home, so robots have to hit the puck, let it fly, and catch
it. By one rule of the game a player of the middle drives it forward: a short pass and a long one. One solve finds where
and when. It starts from a kick schedule, the least forces that would bring the puck to the goal if they acted in three
chosen spans of time. If the solve finds no plan, it starts again from another schedule.

Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful Multi-Robot
Collaboration, 2024, arXiv:2410.23283, sec. V. Sizes, masses, limits and the rule about the middle are ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from rod import effort, plans_of

import pyrobocop_pyomo as rcp

planar = rcp.mechanics.planar

DURATION, STEPS = 4.2, 60
FRICTION, APART = 0.3, 0.35
PUCK = planar.RigidBody(planar.Disc(0.10), mass=0.3, inertia=0.0015, resistance=planar.ViscousDrag(0.15, 0.0005))
PLAYER = planar.DiscRobot(planar.Disc(0.15), mass=1.5, force_limit=12.0, speed_limit=4.0)

# The homes are 2 m by 1.3 m, in two rows of three, from left to right: a b c below, d e f above.
HOMES = {
    name: ((2.0 * column - 3.0, 2.0 * column - 1.0), (row - 0.65, row + 0.65))
    for name, column, row in zip("abcdef", (0, 1, 2, 0, 1, 2), (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0), strict=True)
}
NEIGHBOURS = (("a", "b"), ("b", "c"), ("d", "e"), ("e", "f"))
MIDDLE = ("b", "e")
FLIGHT = 5  # steps
ROUNDS = 36  # of a team, with one schedule
LEAST_DRIVE = 0.15  # newton seconds, by the players of the middle
START, GOAL, GOAL_RADIUS = (-2.6, -1.0, 0.0), (2.5, 0.8), 0.35
# Who hits or catches, from when to when, in sixtieths of the game; and where the puck should be in the second of them.
KICKS = (
    ((("a", 8, 14), ("b", 26, 32), ("f", 48, 55)), (-0.2, -0.8)),
    ((("a", 8, 14), ("e", 26, 32), ("f", 48, 55)), (-0.2, 0.5)),
    ((("a", 12, 19), ("b", 30, 36), ("f", 50, 58)), (0.0, -0.6)),
)


@dataclass(frozen=True)
class Game:
    """Where each player starts, how the game is divided into steps, and which schedule the solve starts from."""

    players: Mapping[str, tuple[float, float]]
    steps: int = STEPS
    kicks: int = 0

    @property
    def grid(self) -> dict:
        """Of every phase."""
        return {"duration": DURATION, "elements": self.steps, "scheme": "implicit_euler"}

    @property
    def step(self) -> float:
        """Seconds."""
        return DURATION / self.steps

    @property
    def goal(self) -> tuple:
        """A square within the goal disc; the puck may be turned as it likes."""
        half = 0.7 * GOAL_RADIUS
        return (*((middle - half, middle + half) for middle in GOAL), None)

    @property
    def score(self) -> planar.Score:
        """What combined plans are worth physically."""
        homes = {name: {"me.x": across, "me.y": up} for name, (across, up) in HOMES.items()}
        return planar.Score(PUCK, PLAYER, friction=FRICTION, step=self.step, goal=self.goal, bounds=homes)

    @cached_property
    def schedule(self) -> Schedule:
        """Where the solve starts."""
        return Schedule.least(self.steps, self.step, *KICKS[self.kicks])


def game(seed: int, steps: int = STEPS, kicks: int = 0) -> Game:
    """A random game: each player anywhere in its home, but neither at the very edge nor on the puck."""
    random = np.random.default_rng(seed)
    players = {}
    for name, home in HOMES.items():
        gap = 0.0
        while gap < 0.05:
            x, y = (float(random.uniform(low + 0.3, high - 0.3)) for low, high in home)
            gap = PUCK.shape.gap_to_disc(PLAYER.shape.radius, x, y, START).gap
        players[name] = (x, y)
    return Game(players, steps, kicks)


@dataclass(frozen=True)
class Schedule:
    """Forces on the puck and its path under them: shapes (T, 2), (T + 1, 2), (T + 1, 2); and who exerts them."""

    force: np.ndarray
    place: np.ndarray
    speed: np.ndarray
    kicks: tuple[tuple[str, int, int], ...]

    @classmethod
    def least(
        cls, steps: int, step: float, spans: Sequence[tuple[str, int, int]], meeting: tuple[float, float]
    ) -> Schedule:
        """The least forces within the kicks that lead through the meeting to the goal, and to rest there.

        The motion is linear in the forces: one step of implicit Euler is ``(1 + h d / m) u = u_before + h f / m``.
        """
        kicks = tuple((name, round(first * steps / 60), round(last * steps / 60)) for name, first, last in spans)
        chosen = [k for _, first, last in kicks for k in range(first, last)]
        decay = 1 / (1 + step * PUCK.resistance.linear / PUCK.mass)
        k, j = np.indices((steps, steps))
        speeds = np.where(k >= j, decay ** (k - j + 1.0) * step / PUCK.mass, 0.0)
        places = step * np.cumsum(speeds, axis=0)
        middle = (kicks[1][1] + kicks[1][2]) // 2
        asked = np.array([places[middle], places[-1], speeds[-1]])[:, chosen]
        wanted = np.array([meeting, GOAL, START[:2]]) - np.array(START[:2])
        force = np.zeros((steps, 2))
        force[chosen] = np.linalg.lstsq(asked, wanted, rcond=None)[0]
        still = np.zeros((1, 2))
        return cls(force, np.vstack([still, places @ force]) + START[:2], np.vstack([still, speeds @ force]), kicks)

    def player(self, name: str, start: Sequence[float]) -> np.ndarray:
        """Where a player should be, shape (T + 1, 2): behind the puck while it kicks, on straight lines between."""
        times, places = [0], [np.array(start)]
        for kicker, first, last in self.kicks:
            for k in range(first, last + 1) if kicker == name else ():
                force = self.force[max(k - 1, first)]
                times.append(k)
                places.append(self.place[k] - 0.25 * force / np.linalg.norm(force))
        path = [np.interp(np.arange(len(self.place)), times, side) for side in np.transpose(places)]
        return np.column_stack([np.clip(side, *home) for side, home in zip(path, HOMES[name], strict=True)])


# ------------------------------------------------------------------ a team: one model for the puck, one for each player


def puck(game: Game) -> pyo.ConcreteModel:
    """The puck under the wrenches of all players."""
    m = pyo.ConcreteModel(name="puck")
    m.push = rcp.PhaseBlock(list(game.players), rule=PUCK.state_wrench, **game.grid)
    m.body = rcp.PhaseBlock(**game.grid)
    state_puck(m, game)
    return m


def state_puck(m: pyo.ConcreteModel, game: Game) -> None:
    """Motion of the puck into the goal, and the rule of the game."""
    PUCK.state_motion(m.body, m.push.values(), start=START, goal=game.goal)
    start_from(m.body, game.schedule.place, ("qx", "qy"))
    start_from(m.body, game.schedule.speed, ("ux", "uy"))
    drives = (m.push[name].integral(lambda b, t: b.fx[t]) for name in MIDDLE)
    m.the_middle_drives = pyo.Constraint(expr=sum(drives) >= LEAST_DRIVE)


def player(game: Game, name: str) -> pyo.ConcreteModel:
    """One player: its own motion and contact, a kinematic copy of the puck, and its wrench on the puck."""
    m = pyo.ConcreteModel(name=name)
    m.push = rcp.PhaseBlock([name], rule=PUCK.state_wrench, **game.grid)
    m.body = rcp.PhaseBlock(**game.grid)
    m.me = rcp.PhaseBlock(**game.grid)
    PUCK.state_copy(m.body, start=START, goal=(*GOAL, 0.0))
    start_from(m.body, game.schedule.place, ("qx", "qy"))
    start_from(m.body, game.schedule.speed[1:], ("ux", "uy"))
    state_player(m.me, m.body, m.push[name], game, name)
    m.cost = pyo.Objective(expr=m.me.integral(effort))
    return m


def state_player(me, body, push, game: Game, name: str) -> None:
    """Motion of a player within its home and its contact, started from the schedule."""
    schedule = game.schedule
    PLAYER.state_motion(me, push, start=game.players[name], within=HOMES[name])
    path = schedule.player(name, game.players[name])
    speed = np.vstack([np.zeros(2), np.diff(path, axis=0) / game.step])
    start_from(me, path, ("x", "y"))
    start_from(me, speed, ("vx", "vy"))
    # The lifted kinematics of the contact take their start from these places.
    planar.Contact(PUCK.shape, PLAYER.shape, FRICTION).state(me, body, push)
    force = np.zeros_like(schedule.force)
    for kicker, first, last in schedule.kicks:
        if kicker == name:
            force[first:last] = schedule.force[first:last]
    start_from(me, np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 0.01), ("c",))
    driving = PLAYER.mass * np.diff(speed, axis=0) / game.step + force
    start_from(me, np.clip(driving, -PLAYER.force_limit, PLAYER.force_limit), ("tau_x", "tau_y"))


def start_from(phase, values: np.ndarray, names: Sequence[str]) -> None:
    """Initial guess: one column for each variable; what is fixed stays."""
    for name, column in zip(names, values.T, strict=True):
        for variable, value in zip(phase.component(name).values(), column.tolist(), strict=True):
            if not variable.fixed:
                variable.set_value(value)


def team(game: Game) -> rcp.Team:
    """The puck in the middle, and an agent for each player."""
    return rcp.Team(
        hub=rcp.Agent("puck", puck, game),
        robots=[rcp.Agent(name, player, game, name) for name in game.players],
        shared=[
            rcp.Shared("body.qx", "body.qy", "body.qth", penalty=20),
            rcp.Shared("body.ux", "body.uy", "body.uth", penalty=2),
            rcp.Shared("push[{robot}]", penalty=(5.0, 5.0, 50.0)),
        ],
        keep_apart=rcp.KeepApart(("me.x", "me.y"), APART),
        physics=game.score,
    )


# ------------------------------------------------------------------ all in one model


def build(seed: int = 0, steps: int = STEPS, kicks: int = 0) -> pyo.ConcreteModel:
    """The puck and all players, which know everything of each other; wrenches are expressions."""
    now = game(seed, steps, kicks)
    m = pyo.ConcreteModel(name="hit and catch")
    m.push = rcp.PhaseBlock(list(now.players), **now.grid)
    m.me = rcp.PhaseBlock(list(now.players), **now.grid)
    m.body = rcp.PhaseBlock(**now.grid)
    for push in m.push.values():
        PUCK.state_wrench(push, as_expressions=True)
    state_puck(m, now)
    for name in now.players:
        state_player(m.me[name], m.body, m.push[name], now, name)
    m.apart = pyo.Constraint(NEIGHBOURS, list(m.body.points), rule=far_enough)
    m.cost = pyo.Objective(expr=sum(me.integral(effort) for me in m.me.values()))
    m.score = now.score
    return m


def far_enough(m: pyo.ConcreteModel, first: str, second: str, t: float):
    """Two players whose homes touch keep 35 cm between their centres."""
    a, b = m.me[first], m.me[second]
    return (a.x[t] - b.x[t]) ** 2 + (a.y[t] - b.y[t]) ** 2 >= APART**2


def touches(plans: Mapping[str, Mapping[str, np.ndarray]]) -> tuple[list[str], int]:
    """Who touches the puck, in this order; and the longest flight: steps without a force, faster than 0.3 m/s."""
    forces = {name: plan["me.c"] for name, plan in plans.items() if "me.c" in plan}
    order: list[str] = []
    for k in range(len(next(iter(forces.values())))):
        order += [name for name, force in forces.items() if force[k] > 0.1 and order[-1:] != [name]]
    moving = next(plan for plan in plans.values() if "me.c" not in plan)
    speed = np.hypot(moving["body.ux"], moving["body.uy"])[1:]
    longest = flying = 0
    for free in (np.max(list(forces.values()), axis=0) < 1e-3) & (speed > 0.3):
        flying = flying + 1 if free else 0
        longest = max(longest, flying)
    return order, longest


def search(together: bool = False, **case) -> tuple[pyo.ConcreteModel, rcp.SolveResult | rcp.teams.TeamResult]:
    """Solve from one schedule after the other until the plan is strict and the puck is passed twice."""
    options = {key: case.pop(key) for key in ("backend", "tee")}
    options["backend"] = options["backend"] or "vectorised"
    for kicks in range(len(KICKS)):
        if together:
            now = game(**case, kicks=kicks)
            result = team(now).solve(rcp.teams.Hub(rounds=ROUNDS))
            m = pyo.ConcreteModel(name="hit and catch as a team")
            m.score, m.plans = now.score, result.plans
        else:
            m = build(**case, kicks=kicks)
            # Without polish: a score that is strict asks for no more.
            result = rcp.solve(m, strategies=rcp.Strategy("barrier", polish=False), **options)
        plans = plans_of(m)
        score, (order, flight) = m.score(plans), touches(plans)
        print(f"{score}\ntouched by {', '.join(order)}; longest flight {flight} steps\n")
        if score.strict and len(order) > 2 and flight >= FLIGHT:
            break
    return m, result


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Puck and players on the field, and how hard each of them pushes."""
    plans = plans_of(m)
    time, bodies = m.score.paths(plans)
    above, below = figure.subfigures(2, 1, height_ratios=(2.4, 1))
    rcp.scenes.draw_scene(time, bodies, snapshots=14, title=m.name, view=((-3.1, -2.0), (3.1, 2.0)), figure=above)
    field = above.axes[0]
    for (left, right), (low, high) in HOMES.values():
        field.plot([left, right, right, left, left], [low, low, high, high, low], color="0.6", linewidth=1, zorder=0)
    around = np.linspace(0, 2 * np.pi, 60)
    field.plot(GOAL[0] + GOAL_RADIUS * np.cos(around), GOAL[1] + GOAL_RADIUS * np.sin(around), color="tab:red")
    axis = below.subplots()
    for name in HOMES:
        if plans[name]["me.c"].max() > 0.1:
            axis.step(time[1:], plans[name]["me.c"], where="pre", label=name)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("normal force [N]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize="small")


def animate(m: pyo.ConcreteModel, path: Path) -> Path:
    """A film of the plan."""
    return m.score.animate(plans_of(m), path, title=m.name)


if __name__ == "__main__":
    from run_example import run_example

    coarse = {"steps": 30}
    run_example(
        build,
        draw,
        cases={"game": {}, "team": {"seed": 0, "together": True}},
        default="game",
        coarse=coarse,
        size=(10, 9),
        search=search,
        animate=animate,
    )
