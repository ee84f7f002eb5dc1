"""Three roller nodes on a closed tube walk by rolling over: the shape changes, the length of the tube does not.

A triangle in the vertical plane whose corners are motors that roll along one tube: an edge grows as far as the others
shrink. Edge forces act along the edges; every node may touch the ground, with Coulomb friction. The solver finds which
nodes push when, and how often the truss rolls over. Then `track` replays the shapes of the plan with a model of the
motors in place of the hardware: two of constant speed, measured lengths, commands twice a second.

Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful Multi-Robot
Collaboration, 2024, arXiv:2410.23283, sec. V-D. Masses, limits, friction and the model of the motors are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure

import pyrobocop_pyomo as rcp

NODES = ("a", "b", "c")
EDGES = tuple(combinations(NODES, 2))
MASS, TUBE, LENGTHS, FORCE = 1.6, 3.4, (0.6, 1.6), 60.0  # kg, m, m, N
FRICTION, GRAVITY = 0.7, 9.81
SIDE = TUBE / 3
HEIGHT = SIDE * np.sqrt(3) / 2
START = {"a": (0.0, 0.0), "b": (SIDE, 0.0), "c": (SIDE / 2, HEIGHT)}
DURATION, DISTANCE = 6.0, 1.0


@dataclass(frozen=True)
class Walk:
    """How far the truss goes, and in how many steps."""

    steps: int = 60
    distance: float = DISTANCE

    @property
    def grid(self) -> dict:
        """Of every phase of every model."""
        return {"duration": DURATION, "elements": self.steps, "scheme": "implicit_euler"}

    @property
    def last(self) -> dict[str, tuple[float, float]]:
        """Where the guess ends: rolled over to the right."""
        return {
            "a": (SIDE / 2 + self.distance, HEIGHT),
            "b": (SIDE, 0.0),
            "c": (SIDE + self.distance, 0.0),
        }


def build(steps: int = 60, distance: float = DISTANCE) -> pyo.ConcreteModel:
    """The truss and the ground under all nodes in one model."""
    m = truss(Walk(steps, distance))
    m.me = rcp.PhaseBlock(NODES, **Walk(steps).grid)
    for node in NODES:
        state_contact(m.me[node], m.truss, m.ground[node], node)
    return m


# ------------------------------------------------------------------ the truss, and a node on the ground


def truss(walk: Walk) -> pyo.ConcreteModel:
    """From standing on a and b to rest, with the centre of mass moved to the right, under any forces of the ground."""
    m = pyo.ConcreteModel(name="truss robot")
    m.ground = rcp.PhaseBlock(NODES, rule=state_ground, **walk.grid)
    m.truss = b = rcp.PhaseBlock(**walk.grid)
    state_places(b, walk)
    for node in NODES:
        for axis in "xz":
            b.declare(f"v{axis}_{node}", rcp.State(initial=0, final=0, bounds=(-3, 3)))
    for i, j in EDGES:
        b.declare(f"length_{i}{j}", rcp.Algebraic(bounds=LENGTHS, initial_guess=SIDE))
        b.declare(f"force_{i}{j}", rcp.Control(bounds=(-FORCE, FORCE), initial_guess=5.0))

    @b.ode
    def motion(b, t):
        rates = {}
        for node in NODES:
            force = {axis: sum(push(b, t, node, edge, axis) for edge in EDGES if node in edge) for axis in "xz"}
            ground = m.ground[node]
            for axis in "xz":
                rates[f"{axis}_{node}"] = getattr(b, f"v{axis}_{node}")[t]
            rates[f"vx_{node}"] = (force["x"] + ground.forward[t] - ground.backward[t]) / MASS
            rates[f"vz_{node}"] = (force["z"] + ground.press[t]) / MASS - GRAVITY
        return rates

    @b.residual
    def lengths(b, t):
        return {f"{i}{j}": getattr(b, f"length_{i}{j}")[t] ** 2 == squared_distance(b, t, i, j) for i, j in EDGES}

    @b.constraint
    def tube(b, t):
        return sum(getattr(b, f"length_{i}{j}")[t] for i, j in EDGES) == TUBE

    end = b.final_time
    middle = sum(getattr(b, f"x_{node}")[end] for node in NODES) / 3
    m.arrives = pyo.Constraint(expr=middle == SIDE / 2 + walk.distance)
    m.effort = pyo.Objective(
        expr=b.integral(lambda b, t: sum(getattr(b, f"force_{i}{j}")[t] ** 2 for i, j in EDGES) / 100)
    )
    return m


def state_places(b, walk: Walk) -> None:
    """Where the nodes are."""
    for node in NODES:
        for axis, first, final in zip("xz", START[node], walk.last[node], strict=True):
            guess = np.linspace(first, final, walk.steps + 1)
            lowest = None if axis == "x" else 0.0
            b.declare(f"{axis}_{node}", rcp.State(initial=first, initial_guess=guess, bounds=(lowest, None)))


def state_ground(ground, node: str) -> None:
    """What the ground does to a node: it presses, and pulls forward or backward, newtons."""
    ground.press = rcp.Control(bounds=(0, 200), initial_guess=5.0)
    for part in ("forward", "backward"):
        ground.declare(part, rcp.Control(bounds=(0, 200), initial_guess=0.1))


def state_contact(me, b, ground, node: str) -> None:
    """A node presses on the ground where it touches it; where it slides, friction pulls against it."""
    me.slide = rcp.Control(bounds=(0, 200), initial_guess=0.1)
    z, vx = b.component(f"z_{node}"), b.component(f"vx_{node}")

    @me.complementarity
    def contact(me, t):
        forward, backward = ground.forward[t], ground.backward[t]
        return {
            "touches": rcp.complements(ground.press[t] >= 0, z[t] >= 0),
            "forward": rcp.complements(forward >= 0, me.slide[t] + vx[t] >= 0),
            "backward": rcp.complements(backward >= 0, me.slide[t] - vx[t] >= 0),
            "sticks": rcp.complements(me.slide[t] >= 0, FRICTION * ground.press[t] - forward - backward >= 0),
        }


def push(b, t, node, edge, axis):
    """Component of the force of an edge on one of its nodes."""
    other = edge[1] if edge[0] == node else edge[0]
    along = getattr(b, f"{axis}_{node}")[t] - getattr(b, f"{axis}_{other}")[t]
    name = "".join(edge)
    return getattr(b, f"force_{name}")[t] * along / getattr(b, f"length_{name}")[t]


def squared_distance(b, t, i, j):
    """Between two nodes."""
    return sum((getattr(b, f"{axis}_{i}")[t] - getattr(b, f"{axis}_{j}")[t]) ** 2 for axis in "xz")


# ------------------------------------------------------------------ a team: the truss, and the ground under each node


def foot(walk: Walk, node: str) -> pyo.ConcreteModel:
    """One node: its contact with the ground, and a kinematic copy of all nodes."""
    m = pyo.ConcreteModel(name=node)
    m.ground = rcp.PhaseBlock([node], rule=state_ground, **walk.grid)
    m.truss = b = rcp.PhaseBlock(**walk.grid)
    state_places(b, walk)
    for name in NODES:
        for axis, first, final in zip("xz", START[name], walk.last[name], strict=True):
            b.declare(f"v{axis}_{name}", rcp.Control(initial_guess=(final - first) / DURATION))
    b.ode(lambda b, t: {f"{q}_{n}": b.component(f"v{q}_{n}")[t] for n in NODES for q in "xz"})
    m.me = rcp.PhaseBlock(**walk.grid)
    state_contact(m.me, b, m.ground[node], node)
    return m


def team(walk: Walk) -> rcp.Team:
    """The truss and its nodes have to agree on where the nodes go, and on what the ground does."""
    return rcp.Team(
        hub=rcp.Agent("robot", truss, walk),
        robots=[rcp.Agent(node, foot, walk, node) for node in NODES],
        shared=[
            rcp.Shared(*(f"truss.{axis}_{node}" for node in NODES for axis in "xz"), penalty=20),
            rcp.Shared(*(f"truss.v{axis}_{node}" for node in NODES for axis in "xz"), penalty=2),
            rcp.Shared("ground[{robot}]", penalty=0.5),
        ],
        physics=WalkPhysics(walk),
    )


def search(together: bool = False, **case) -> tuple[pyo.ConcreteModel, rcp.SolveResult | rcp.teams.TeamResult]:
    """Build and solve, or plan as a team, and say how well the motors follow the plan.

    The slow way down from delta = 1 finds better plans than the quick one here; a polish of 720 pairs would take long.
    """
    options = {key: case.pop(key) for key in ("backend", "tee")}
    if together:
        m = pyo.ConcreteModel(name="truss robot as a team")
        result = team(Walk(**case)).solve()
        m.plans = result.plans["robot"]
        print(result.score)
    else:
        m = build(**case)
        result = rcp.solve(m, strategies=rcp.Strategy("continuation", polish=False), **options)
    print(track(m), end="\n\n")
    return m, result


# ------------------------------------------------------------------ what a plan is worth, from its numbers alone

READ = (
    *(f"truss.{q}{axis}_{node}" for q in ("", "v") for node in NODES for axis in "xz"),
    *(f"truss.{what}_{i}{j}" for what in ("length", "force") for i, j in EDGES),
    *(f"ground[{node!r}].{what}" for what in ("press", "forward", "backward") for node in NODES),
)


def values_of(m: pyo.ConcreteModel) -> dict[str, np.ndarray]:
    """The plan that stands on a model."""
    return {name: np.array([entry.value for entry in m.find_component(name).values()]) for name in READ}


@dataclass(frozen=True)
class Plan:
    """Numbers of a plan over time.

    Attributes
    ----------
    places, velocities : arrays, shape (K + 1, 3, 2)
        Of the nodes, metres and metres per second.
    lengths, pushes, presses, drags : arrays, shape (K, 3)
        Of the edges, metres and newtons; of the ground on the nodes, upward and to the right, newtons.
    """

    places: np.ndarray
    velocities: np.ndarray
    lengths: np.ndarray
    pushes: np.ndarray
    presses: np.ndarray
    drags: np.ndarray

    @classmethod
    def of(cls, values: Mapping[str, np.ndarray]) -> Plan:
        """Read it from values by name."""

        def of_nodes(q: str) -> np.ndarray:
            return np.array([[values[f"truss.{q}{axis}_{node}"] for axis in "xz"] for node in NODES]).transpose(2, 0, 1)

        lengths, pushes = (np.array([values[f"truss.{q}_{i}{j}"] for i, j in EDGES]).T for q in ("length", "force"))
        press, forward, backward = (
            np.array([values[f"ground[{node!r}].{q}"] for node in NODES]).T for q in ("press", "forward", "backward")
        )
        return cls(of_nodes(""), of_nodes("v"), lengths, pushes, press, forward - backward)


@dataclass(frozen=True)
class WalkScore:
    """What a plan of the truss is worth: the largest of each kind of residual over time.

    Attributes
    ----------
    force : float
        Mass times acceleration less all forces on a node, newtons.
    gap_product, friction_product : float
        Pressure times height, newton metres; friction that is missing where a node slides, watts.
    excess : float
        Friction beyond its cone, newtons.
    length, tube : float
        Of an edge, and of the tube, metres.
    height : float
        Of a node under the ground, metres.
    distance : float
        From where the centre of mass has to be, metres.
    """

    force: float
    gap_product: float
    friction_product: float
    excess: float
    length: float
    tube: float
    height: float
    distance: float

    @property
    def strict(self) -> bool:
        """Whether forces are within 0.05 N, products within 0.02, lengths within 0.1 mm, the rest within 2 mm."""
        products = max(self.gap_product, self.friction_product)
        lengths = max(self.length, self.tube)
        return max(self.force, self.excess) < 0.05 and products < 0.02 and lengths < 1e-4 and self._arrives(0.002)

    @property
    def practical(self) -> bool:
        """Whether forces are within 1 N, products within 0.02, all lengths and places within 2 cm."""
        products = max(self.gap_product, self.friction_product)
        lengths = max(self.length, self.tube)
        return max(self.force, self.excess) < 1.0 and products < 0.02 and lengths < 0.02 and self._arrives(0.02)

    def _arrives(self, within: float) -> bool:
        return max(self.height, self.distance) < within

    def __str__(self) -> str:
        word = "strict" if self.strict else "practical" if self.practical else "not physically valid"
        return f"walk: {word}\n" + "\n".join(f"  {name:18}{number:10.2e}" for name, number in vars(self).items())


@dataclass(frozen=True)
class WalkPhysics:
    """Scores plans of the truss by its equations of motion and Coulomb's law."""

    walk: Walk
    robot_components: tuple[str, ...] = ("me.slide",)
    hub_components: tuple[str, ...] = READ

    def __call__(self, plans: Mapping[str, Mapping[str, np.ndarray]]) -> WalkScore:
        """Recompute the residuals."""
        plan, step = Plan.of(plans["robot"]), DURATION / self.walk.steps
        places, velocities = plan.places[1:], plan.velocities[1:]
        missing = MASS * np.diff(plan.velocities, axis=0) / step
        missing[..., 0] -= plan.drags
        missing[..., 1] -= plan.presses - MASS * GRAVITY
        lengths = np.empty_like(plan.lengths)
        for e, (i, j) in enumerate(combinations(range(3), 2)):
            along = places[:, i] - places[:, j]
            lengths[:, e] = np.linalg.norm(along, axis=1)
            force = plan.pushes[:, e, None] * along / lengths[:, e, None]
            missing[:, i] -= force
            missing[:, j] += force
        moved = np.abs(np.diff(plan.places, axis=0) - step * velocities).max()
        sliding = velocities[..., 0]
        return WalkScore(
            force=float(np.abs(missing).max()),
            gap_product=float((plan.presses * np.abs(places[..., 1])).max()),
            friction_product=float((FRICTION * plan.presses * np.abs(sliding) + plan.drags * sliding).max()),
            excess=float(max(0.0, (np.abs(plan.drags) - FRICTION * plan.presses).max())),
            length=float(max(np.abs(lengths - plan.lengths).max(), moved)),
            tube=float(np.abs(lengths.sum(axis=1) - TUBE).max()),
            height=float(max(0.0, -places[..., 1].min())),
            distance=float(abs(places[-1, :, 0].mean() - SIDE / 2 - self.walk.distance)),
        )


# ------------------------------------------------------------------ a model of the motors in place of the hardware


@dataclass(frozen=True)
class Tracking:
    """What became of the shapes of a plan.

    Attributes
    ----------
    time : array, shape (K,)
        Of the commands, seconds.
    commanded, reached : arrays, shape (K, 3)
        Lengths of the edges, metres.
    nodes : array, shape (K, 3, 2)
        Where the nodes are, if the truss rolls over when it does so in the plan.
    """

    time: np.ndarray
    commanded: np.ndarray
    reached: np.ndarray
    nodes: np.ndarray

    @property
    def error(self) -> float:
        """Root of the mean squared difference of lengths, metres."""
        return float(np.sqrt(((self.reached - self.commanded) ** 2).mean()))

    @property
    def progress(self) -> float:
        """How far the centre of mass has come, metres."""
        return float(self.nodes[-1, :, 0].mean() - self.nodes[0, :, 0].mean())

    def __str__(self) -> str:
        return (
            f"tracked in {self.time[-1]:.0f} s: edges within {100 * self.error:.1f} cm (root mean square), centre of "
            f"mass moved by {self.progress:.2f} m"
        )


PERIOD, SPEED, LOADED, NEAR = 0.5, 0.08, 0.8, 0.1  # s between commands, m/s, factor under load, "reached" within 10 %
NOISE, DRIFT = 0.01, 0.0005  # of measured lengths: metres, relative per second
IDLE = SPEED * PERIOD / 2  # a motor that is nearer than half a period's way stands still


def track(m: pyo.ConcreteModel, seed: int = 0) -> Tracking:
    """Follow the shapes of a plan with two motors of constant speed, as slowly as these need it.

    The first two edges are driven, more slowly where they push; the tube gives the third. Twice a second the lengths
    are measured, with noise and a drift; the next shape is commanded once two edges are near the last one.
    """
    random = np.random.default_rng(seed)
    nodes, shapes, pushes, presses = plan_of(m)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(shapes, axis=0)).max(axis=1))])
    places = np.linspace(0.0, way[-1], int(np.ceil(way[-1] / (0.75 * SPEED * PERIOD))) + 1)
    waypoints = np.stack([np.interp(places, way, lengths) for lengths in shapes.T], axis=1)
    positions = np.searchsorted(way, places - 1e-12).clip(0, len(way) - 1)
    lengths, number, time, rows = shapes[0].copy(), 0, 0.0, []
    while number < len(waypoints):
        rows.append((time, number, lengths.copy()))
        measured = lengths * (1 + DRIFT * time) + random.normal(0.0, NOISE, 3)
        missing = waypoints[number] - measured
        if np.count_nonzero(np.abs(missing) <= NEAR * waypoints[number]) >= 2:
            number += 1
        loaded = (pushes[positions[min(number, len(waypoints) - 1)]] > 0) & (missing > 0)
        rates = np.where(np.abs(missing) > IDLE, np.sign(missing), 0.0) * np.where(loaded, LOADED, 1.0) * SPEED
        lengths[:2] += rates[:2] * PERIOD
        lengths[2] = TUBE - lengths[:2].sum()
        time += PERIOD
    times, numbers, reached = (np.array(column) for column in zip(*rows, strict=True))
    stances = positions[numbers]
    return Tracking(times, waypoints[numbers], reached, rolled(reached, nodes[stances], presses[stances]))


def plan_of(m: pyo.ConcreteModel) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, shape (K, 3, 2), and lengths, edge forces and ground forces, shape (K, 3), of a plan."""
    plan = Plan.of(m.plans if hasattr(m, "plans") else values_of(m))
    lengths = np.vstack([np.full(3, SIDE), plan.lengths])
    return plan.places, lengths, *(np.vstack([values[:1], values]) for values in (plan.pushes, plan.presses))


def rolled(lengths: np.ndarray, planned: np.ndarray, presses: np.ndarray) -> np.ndarray:
    """Nodes of triangles with these edges that stand and roll as planned, the foot that carries most at rest."""
    placed = np.empty_like(planned)
    before = planned[0]
    for k, (edges, nodes) in enumerate(zip(lengths, planned, strict=True)):
        length = {frozenset(edge): edges[e] for e, edge in enumerate(combinations(range(3), 2))}
        foot = int(np.argmax(presses[k]))
        low, high = sorted(set(range(3)) - {foot}, key=lambda node: nodes[node, 1])
        base, side, opposite = (length[frozenset(pair)] for pair in ((foot, low), (foot, high), (low, high)))
        angle = np.arctan2(nodes[low, 1] - nodes[foot, 1], nodes[low, 0] - nodes[foot, 0])
        corner = np.arccos(np.clip((base**2 + side**2 - opposite**2) / (2 * base * side), -1.0, 1.0))
        to_low, to_high = nodes[low] - nodes[foot], nodes[high] - nodes[foot]
        turn = corner if to_low[0] * to_high[1] - to_low[1] * to_high[0] > 0 else -corner
        placed[k, foot] = before[foot, 0], 0.0
        placed[k, low] = placed[k, foot] + base * np.array([np.cos(angle), np.sin(angle)])
        placed[k, high] = placed[k, foot] + side * np.array([np.cos(angle + turn), np.sin(angle + turn)])
        before = placed[k]
    return placed


# ------------------------------------------------------------------ pictures


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The truss on its way, light to dark, and its edges: planned, and tracked as slowly as the motors need it."""
    nodes, lengths, _, _ = plan_of(m)
    tracking = track(m)
    above, below = figure.subfigures(2, 1, height_ratios=(1.5, 1))
    axis = above.subplots()
    for k in range(0, len(nodes), 4):
        axis.plot(*nodes[k, [0, 1, 2, 0]].T, "o-", color=(0.1, 0.3, 0.6, 0.15 + 0.85 * k / len(nodes)), markersize=4)
    axis.plot(*nodes.mean(axis=1).T, color="tab:red", linewidth=1, label="centre of mass")
    axis.axhline(0.0, color="0.6", linewidth=1)
    axis.set_aspect("equal")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("z [m]")
    axis.legend(fontsize="small")
    above.suptitle(m.name)
    planned, tracked = below.subplots(1, 2, sharey=True)
    for e, (i, j) in enumerate(EDGES):
        planned.plot(np.linspace(0, DURATION, len(lengths)), lengths[:, e], label=f"{i}{j}")
        (line,) = tracked.plot(tracking.time, tracking.commanded[:, e], linewidth=1, linestyle=":")
        tracked.plot(tracking.time, tracking.reached[:, e], color=line.get_color())
    planned.set_title("edges of the plan", fontsize="small")
    tracked.set_title(f"tracked, {100 * tracking.error:.1f} cm apart (dotted: commanded)", fontsize="small")
    planned.set_ylabel("length [m]")
    planned.legend(fontsize="small")
    for axis in (planned, tracked):
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.25)


def animate(m: pyo.ConcreteModel, path: Path) -> Path:
    """Write the plan as a GIF in real time."""
    nodes, *_ = plan_of(m)
    figure = Figure(figsize=(7, 3.6), dpi=80, layout="constrained")
    axis = figure.subplots()
    axis.set(xlim=(nodes[..., 0].min() - 0.2, nodes[..., 0].max() + 0.2), ylim=(-0.1, nodes[..., 1].max() + 0.2))
    axis.set_aspect("equal")
    axis.axhline(0.0, color="0.6", linewidth=1)
    (truss,) = axis.plot([], [], "o-", color="tab:blue")
    (centre,) = axis.plot([], [], color="tab:red", linewidth=1)

    def show(k: int):
        truss.set_data(*nodes[k, [0, 1, 2, 0]].T)
        centre.set_data(*nodes[: k + 1].mean(axis=1).T)
        return truss, centre

    film = FuncAnimation(figure, show, frames=len(nodes), blit=True)
    film.save(path, writer=PillowWriter(fps=round((len(nodes) - 1) / DURATION)))
    return path


if __name__ == "__main__":
    from run_example import run_example

    run_example(
        build,
        draw,
        cases={"roll": {}, "team": {"together": True}},
        default="roll",
        coarse={"steps": 30},
        size=(9, 7),
        search=search,
        animate=animate,
    )
