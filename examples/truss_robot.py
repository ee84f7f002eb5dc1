"""Three roller nodes on a closed tube walk by rolling over: the shape changes, the length of the tube does not.

A triangle in the vertical plane whose corners are motors that roll along one tube: an edge grows as far as the others
shrink. Edge forces act along the edges; every node may touch the ground, with Coulomb friction. Which nodes push when,
and how often the truss rolls over, is for the solver to find. Then `track` replays the shapes of the plan with a model
of the motors in place of the hardware: two of constant speed, measured lengths, commands twice a second.

Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful Multi-Robot
Collaboration, 2024, arXiv:2410.23283, sec. V-D. Masses, limits, friction and the model of the motors are ours.
"""

from __future__ import annotations

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


def build(steps: int = 60, distance: float = DISTANCE) -> pyo.ConcreteModel:
    """From standing on a and b to rest, with the centre of mass moved to the right."""
    m = pyo.ConcreteModel(name="truss robot")
    m.truss = b = rcp.PhaseBlock(duration=DURATION, elements=steps, scheme="implicit_euler")
    last = {"a": (SIDE / 2 + distance, HEIGHT), "b": (SIDE, 0.0), "c": (SIDE + distance, 0.0)}
    for node in NODES:
        for axis, first, final in zip("xz", START[node], last[node], strict=True):
            guess = np.linspace(first, final, steps + 1)
            lowest = None if axis == "x" else 0.0
            b.declare(f"{axis}_{node}", rcp.State(initial=first, initial_guess=guess, bounds=(lowest, None)))
            b.declare(f"v{axis}_{node}", rcp.State(initial=0, final=0, bounds=(-3, 3)))
        # What the ground does: it presses, it pulls forward or backward, and the node slides.
        b.declare(f"press_{node}", rcp.Control(bounds=(0, 200), initial_guess=5.0))
        for part in ("forward", "backward", "slide"):
            b.declare(f"{part}_{node}", rcp.Control(bounds=(0, 200), initial_guess=0.1))
    for i, j in EDGES:
        b.declare(f"length_{i}{j}", rcp.Algebraic(bounds=LENGTHS, initial_guess=SIDE))
        b.declare(f"force_{i}{j}", rcp.Control(bounds=(-FORCE, FORCE), initial_guess=5.0))

    @b.ode
    def motion(b, t):
        rates = {}
        for node in NODES:
            force = {axis: sum(push(b, t, node, edge, axis) for edge in EDGES if node in edge) for axis in "xz"}
            read = {name: getattr(b, f"{name}_{node}")[t] for name in ("vx", "vz", "press", "forward", "backward")}
            rates[f"x_{node}"], rates[f"z_{node}"] = read["vx"], read["vz"]
            rates[f"vx_{node}"] = (force["x"] + read["forward"] - read["backward"]) / MASS
            rates[f"vz_{node}"] = (force["z"] + read["press"]) / MASS - GRAVITY
        return rates

    @b.residual
    def lengths(b, t):
        return {f"{i}{j}": getattr(b, f"length_{i}{j}")[t] ** 2 == squared_distance(b, t, i, j) for i, j in EDGES}

    @b.constraint
    def tube(b, t):
        return sum(getattr(b, f"length_{i}{j}")[t] for i, j in EDGES) == TUBE

    @b.complementarity
    def ground(b, t):
        pairs = {}
        for node in NODES:
            names = ("z", "vx", "press", "forward", "backward", "slide")
            z, vx, press, forward, backward, slide = (getattr(b, f"{name}_{node}")[t] for name in names)
            pairs[f"touches {node}"] = rcp.complements(press >= 0, z >= 0)
            pairs[f"forward {node}"] = rcp.complements(forward >= 0, slide + vx >= 0)
            pairs[f"backward {node}"] = rcp.complements(backward >= 0, slide - vx >= 0)
            pairs[f"sticks {node}"] = rcp.complements(slide >= 0, FRICTION * press - forward - backward >= 0)
        return pairs

    end = b.final_time
    m.arrives = pyo.Constraint(expr=sum(getattr(b, f"x_{node}")[end] for node in NODES) / 3 == SIDE / 2 + distance)
    m.effort = pyo.Objective(
        expr=b.integral(lambda b, t: sum(getattr(b, f"force_{i}{j}")[t] ** 2 for i, j in EDGES) / 100)
    )
    return m


def push(b, t, node, edge, axis):
    """Component of the force of an edge on one of its nodes."""
    other = edge[1] if edge[0] == node else edge[0]
    along = getattr(b, f"{axis}_{node}")[t] - getattr(b, f"{axis}_{other}")[t]
    name = "".join(edge)
    return getattr(b, f"force_{name}")[t] * along / getattr(b, f"length_{name}")[t]


def squared_distance(b, t, i, j):
    """Between two nodes."""
    return sum((getattr(b, f"{axis}_{i}")[t] - getattr(b, f"{axis}_{j}")[t]) ** 2 for axis in "xz")


def search(**case) -> tuple[pyo.ConcreteModel, rcp.SolveResult]:
    """Build and solve, and say how well the motors follow the plan.

    The slow way down from delta = 1 finds better plans than the quick one here; a polish of 720 pairs would take long.
    """
    options = {key: case.pop(key) for key in ("backend", "tee")}
    m = build(**case)
    result = rcp.solve(m, strategies="continuation", polish=False, **options)
    print(track(m), end="\n\n")
    return m, result


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
    found = m.truss.trajectory()
    nodes = np.array([[found.states[f"{axis}_{node}"] for axis in "xz"] for node in NODES]).transpose(2, 0, 1)
    of_edges = ("".join(edge) for edge in EDGES)
    names = [
        [f"length_{edge}" for edge in of_edges],
        [f"force_{i}{j}" for i, j in EDGES],
        [f"press_{n}" for n in NODES],
    ]
    series = [np.array([found.signals[name] for name in group]).T for group in names]
    lengths = np.vstack([np.full(3, SIDE), series[0]])
    return nodes, lengths, *(np.vstack([values[:1], values]) for values in series[1:])


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
        cases={"roll": {}},
        default="roll",
        coarse={"steps": 30},
        size=(9, 7),
        search=search,
        animate=animate,
    )
