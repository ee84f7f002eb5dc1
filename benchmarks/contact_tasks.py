"""Six tasks of contact-implicit planning, stated on phases: every case starts from all zeros.

Tasks and constants are those of Li, Han, Kang, Ma & Yang, On the surprising robustness of sequential convex
optimization for contact-implicit motion planning, RSS 2025, arXiv:2502.01055; the equations are ours, on implicit Euler
steps. Starts and goals beyond the published ones are drawn by the number of the case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import hypot, pi

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp


@dataclass(frozen=True)
class Task:
    """A family of cases.

    Attributes
    ----------
    name : str
    build : callable
        ``build(case)`` makes the model of a case, with one phase ``b``.
    error : callable
        ``error(model)`` is the distance of the end from the goal.
    """

    name: str
    build: Callable[[int], pyo.ConcreteModel]
    error: Callable[[pyo.ConcreteModel], float]


def phase_of(m: pyo.ConcreteModel, points: int, step: float) -> rcp.PhaseBlock:
    """A phase with so many points, the start included."""
    m.b = rcp.PhaseBlock(duration=step * (points - 1), elements=points - 1, scheme="implicit_euler")
    return m.b


def states(b, start: Mapping[str, float], **bounds: tuple[float | None, float | None]) -> None:
    """States that start somewhere; zeros are their initial guess."""
    for name, first in start.items():
        b.declare(name, rcp.State(initial=first, bounds=bounds.get(name, (None, None)), initial_guess=0.0))


def at_end(m: pyo.ConcreteModel, name: str):
    """A state at the end of the phase."""
    return m.b.component(name)[m.b.final_time]


def squared_distance(m: pyo.ConcreteModel, goal: Mapping[str, float]):
    """Of the end from a goal."""
    return sum((at_end(m, name) - last) ** 2 for name, last in goal.items())


def distance(goal: Sequence[str]) -> Callable[[pyo.ConcreteModel], float]:
    """Reads the distance of these states from the goal that the model has been given."""
    return lambda m: float(np.sqrt(sum((pyo.value(at_end(m, name)) - m.goal[name]) ** 2 for name in goal)))


# ------------------------------------------------------------------ one point of contact pushes a box, or a T


def quasi_static(b, forces: Sequence[str], fx, fy, drag: float, lever: float) -> None:
    """The body moves against friction on the table as the force at its contact point wants it; one face at a time."""

    @b.ode
    def motion(b, t):
        c, s, along, across = pyo.cos(b.q[t]), pyo.sin(b.q[t]), fx(b, t), fy(b, t)
        moment = b.cx[t] * across - b.cy[t] * along
        return {
            "x": (c * along - s * across) / drag,
            "y": (s * along + c * across) / drag,
            "q": moment / (drag * lever),
        }

    @b.complementarity
    def one_face_at_a_time(b, t):
        pairs = combinations([b.component(name)[t] for name in forces], 2)
        return [rcp.complements(first >= 0, second >= 0) for first, second in pairs]


BOX_FORCES = ("up", "right", "down", "left")


def box_on_table(b, start: Mapping[str, float]) -> None:
    """A box (x, y, q) on a table, which one point of contact (cx, cy) pushes at one of its faces."""
    a, b_, friction = 0.5, 0.25, 0.5
    states(b, start)
    b.cx, b.cy = rcp.Control(bounds=(-a, a)), rcp.Control(bounds=(-b_, b_))
    for name in BOX_FORCES:
        b.declare(name, rcp.Control(bounds=(0, None)))
    quasi_static(
        b,
        BOX_FORCES,
        lambda b, t: b.right[t] - b.left[t],
        lambda b, t: b.up[t] - b.down[t],
        friction * 9.8,
        0.4 * hypot(a, b_),
    )

    @b.complementarity
    def touches(b, t):
        gaps = {"up": b.cy[t] + b_, "right": b.cx[t] + a, "down": b_ - b.cy[t], "left": a - b.cx[t]}
        return {name: rcp.complements(b.component(name)[t] >= 0, gap >= 0) for name, gap in gaps.items()}


def push_box(case: int) -> pyo.ConcreteModel:
    """A box on a table; eighteen goals three metres away are the published ones."""
    angle = 2 * pi * case / 18 if case < 18 else np.random.default_rng(case).uniform(0, 2 * pi)
    m = pyo.ConcreteModel(name=f"push box {case}")
    b = phase_of(m, 100, 0.02)
    box_on_table(b, {"x": 0.0, "y": 0.0, "q": 0.0})
    m.goal = {"x": 3 * np.cos(angle), "y": 3 * np.sin(angle), "q": angle}
    effort = sum(b.component(name)[t] ** 2 for name in BOX_FORCES for t in b.points)
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + 0.001 * effort)
    return m


def push_t(case: int) -> pyo.ConcreteModel:
    """A T on a table: absolute values of seven differences tell which of its eight faces is touched."""
    random = np.random.default_rng(1000 + case)
    unit, centre, friction = 0.05, 2.6429, 0.4
    m = pyo.ConcreteModel(name=f"push T {case}")
    b = phase_of(m, 50, 0.05)
    x, y = random.uniform(-0.3, 0.3, 2)
    states(b, {"x": x, "y": y, "q": random.uniform(-pi, pi)})
    b.cx = rcp.Control(bounds=(-2 * unit, 2 * unit))
    b.cy = rcp.Control(bounds=(-centre * unit, (4 - centre) * unit))
    forces = [f"f{i}" for i in range(1, 9)]
    for name in forces:
        b.declare(name, rcp.Control(bounds=(0, None)))
    for i in range(1, 8):
        b.declare(f"above{i}", rcp.Control(bounds=(0, None)))
        b.declare(f"below{i}", rcp.Control(bounds=(0, None)))

    def along(b, t):
        return b.f6[t] + b.f8[t] - b.f2[t] - b.f4[t]

    def across(b, t):
        return b.f3[t] + b.f5[t] + b.f7[t] - b.f1[t]

    quasi_static(b, forces, along, across, friction * 9.8, 0.4 * 2.8 * unit)

    @b.constraint
    def differences(b, t):
        cx, cy = b.cx[t], b.cy[t]
        given = (
            cx - 2 * unit, cy - (4 - centre) * unit, cy - (3 - centre) * unit, cx - unit / 2, cy + centre * unit,
            cx + unit / 2, cx + 2 * unit,
        )  # fmt: skip
        parts = [(b.component(f"above{i}")[t], b.component(f"below{i}")[t]) for i in range(1, 8)]
        return [up - down == value for (up, down), value in zip(parts, given, strict=True)]

    @b.complementarity
    def parts_of_differences(b, t):
        return [
            rcp.complements(b.component(f"above{i}")[t] >= 0, b.component(f"below{i}")[t] >= 0) for i in range(1, 8)
        ]

    @b.complementarity
    def touches(b, t):
        size = {i: b.component(f"above{i}")[t] + b.component(f"below{i}")[t] for i in range(1, 8)}
        gaps = [
            (4 - centre) * unit - b.cy[t],
            size[1] + size[2] + size[3] - unit,
            size[1] + size[3] + size[4] - 1.5 * unit,
            size[3] + size[4] + size[5] - 3 * unit,
            size[4] + size[5] + size[6] - unit,
            size[3] + size[5] + size[6] - 3 * unit,
            size[3] + size[6] + size[7] - 1.5 * unit,
            size[2] + size[3] + size[7] - unit,
        ]
        return [rcp.complements(b.component(f)[t] >= 0, gap >= 0) for f, gap in zip(forces, gaps, strict=True)]

    def away(t):
        return b.x[t] ** 2 + b.y[t] ** 2 + (pyo.cos(b.q[t]) - 1) ** 2 + pyo.sin(b.q[t]) ** 2

    effort = sum(b.component(name)[t] ** 2 for name in forces for t in b.points)
    on_the_way = sum(away(t) for t in b.points)
    m.cost = pyo.Objective(expr=99 * away(b.final_time) + on_the_way + 0.01 * effort)
    return m


def error_of_t(m: pyo.ConcreteModel) -> float:
    """Distance in metres, and the turn in radians, from the origin."""
    x, y, q = (pyo.value(at_end(m, name)) for name in ("x", "y", "q"))
    return hypot(x, y, np.angle(np.exp(1j * q)))


# ------------------------------------------------------------------ friction that sticks and slips


def transport(case: int) -> pyo.ConcreteModel:
    """A cart carries its cargo by friction, and may let it slip."""
    random = np.random.default_rng(2000 + case)
    m = pyo.ConcreteModel(name=f"transport {case}")
    b = phase_of(m, 200, 0.02)
    start, speed = (3.0, -4.0) if case == 0 else (random.uniform(2.5, 3.5), random.uniform(-5, -3))
    offset = 0.5 if case == 0 else random.uniform(-0.8, 0.8)
    states(b, {"x1": start + offset, "x2": start, "v1": speed, "v2": speed})
    b.u, b.f = rcp.Control(), rcp.Control()
    b.ahead, b.behind = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))
    b.ode(lambda b, t: {"x1": b.v1[t], "x2": b.v2[t], "v1": b.f[t], "v2": (b.u[t] - b.f[t]) / 2.0})
    b.constraint(lambda b, t: b.ahead[t] - b.behind[t] == b.v1[t] - b.v2[t], name="slip")
    b.constraint(lambda b, t: (-1, b.x1[t] - b.x2[t], 1), name="on_the_cart")
    limit = 0.2 * 9.81

    @b.complementarity
    def friction(b, t):
        return [
            rcp.complements(b.ahead[t] >= 0, b.behind[t] >= 0),
            rcp.complements(b.behind[t] >= 0, limit - b.f[t] >= 0),
            rcp.complements(b.ahead[t] >= 0, limit + b.f[t] >= 0),
        ]

    m.goal = {"x1": -0.5, "x2": 0.0, "v1": -2.0, "v2": -2.0}
    places, speeds = ({name: m.goal[name] for name in names} for names in (("x1", "x2"), ("v1", "v2")))
    effort = sum(b.f[t] ** 2 + b.u[t] ** 2 for t in b.points)
    m.cost = pyo.Objective(expr=1e5 * squared_distance(m, places) + 10 * squared_distance(m, speeds) + 1e-4 * effort)
    return m


def waiter(case: int) -> pyo.ConcreteModel:
    """A plate is drawn over the edge of a table by a pusher on its top, without tilting."""
    random = np.random.default_rng(3000 + case)
    weight, half = 2 * 9.81, 7.0
    m = pyo.ConcreteModel(name=f"waiter {case}")
    b = phase_of(m, 100, 0.05)
    first = -6.0 if case == 0 else random.uniform(-6.5, -5.0)
    states(b, {"x1": first, "x2": 0.1, "v1": 0.0, "v2": 0.0}, x2=(0.1, None))
    b.u, b.press = rcp.Control(), rcp.Control(bounds=(0, None))
    b.f, b.table = rcp.Control(), rcp.Control()
    for name in ("forward", "backward", "slip_forward", "slip_backward"):
        b.declare(name, rcp.Control(bounds=(0, None)))
    b.ode(lambda b, t: {"x1": b.v1[t], "x2": b.v2[t], "v1": (b.f[t] - b.table[t]) / 2.0, "v2": b.u[t] - b.f[t]})

    @b.constraint
    def rows(b, t):
        held = weight - b.press[t]
        return {
            "slip on the plate": b.slip_forward[t] - b.slip_backward[t] == b.v2[t] - b.v1[t],
            "slip on the table": b.forward[t] - b.backward[t] == b.v1[t],
            "on the plate": b.x2[t] - b.x1[t] <= half,
            "no tilting": b.press[t] * (b.x2[t] - b.x1[t] + half) <= weight * half,
            "table presses": held >= 0,
        }

    @b.complementarity
    def friction(b, t):
        on_table = 0.1 * (weight - b.press[t])
        return [
            rcp.complements(b.forward[t] >= 0, b.backward[t] >= 0),
            rcp.complements(b.slip_forward[t] >= 0, b.slip_backward[t] >= 0),
            rcp.complements(b.forward[t] >= 0, on_table - b.table[t] >= 0),
            rcp.complements(b.backward[t] >= 0, on_table + b.table[t] >= 0),
            rcp.complements(b.slip_forward[t] >= 0, b.press[t] - b.f[t] >= 0),
            rcp.complements(b.slip_backward[t] >= 0, b.press[t] + b.f[t] >= 0),
        ]

    m.goal = {"x1": 0.1, "x2": 0.1, "v1": 2.0, "v2": 2.0}
    effort = sum(b.press[t] ** 2 + b.u[t] ** 2 for t in b.points)
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + 1e-4 * effort)
    return m


# ------------------------------------------------------------------ walls that give, and a leg that leaves the ground


def between_walls(b, start: Mapping[str, float], strength: float | None = None) -> None:
    """A pole (angle q from upright, rate w) on a cart (x, v); its tip may touch a soft wall on either side.

    The cart is driven by a force of any size, or of at most `strength`.
    """
    mass, pole, length, gravity, stiffness = 1.0, 0.1, 0.8, 9.8, 200.0
    states(b, start)
    b.u = rcp.Control(bounds=(None if strength is None else -strength, strength))
    b.right, b.left = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))

    @b.ode
    def motion(b, t):
        # (M + m) v' + m l cos q w' = u + m l w^2 sin q + F and l w' + cos q v' = g sin q + F cos q / m, F at the tip.
        c, s = pyo.cos(b.q[t]), pyo.sin(b.q[t])
        force = b.left[t] - b.right[t]
        along = b.u[t] + pole * length * b.w[t] ** 2 * s + force
        across = gravity * s + force * c / pole
        rate = (along - pole * c * across) / (mass + pole - pole * c**2)
        return {"x": b.v[t], "q": b.w[t], "v": rate, "w": (across - c * rate) / length}

    @b.complementarity
    def walls(b, t):
        tip = b.x[t] + length * pyo.sin(b.q[t])
        return [
            rcp.complements(b.right[t] >= 0, 1 - tip + b.right[t] / stiffness >= 0),
            rcp.complements(b.left[t] >= 0, 1 + tip + b.left[t] / stiffness >= 0),
        ]


def cart_pole(case: int) -> pyo.ConcreteModel:
    """A pole is righted between two soft walls."""
    random = np.random.default_rng(4000 + case)
    m = pyo.ConcreteModel(name=f"cart-pole {case}")
    b = phase_of(m, 100, 0.02)
    first = random.uniform([-0.3, -0.3, -0.5, -0.5], [0.3, 0.3, 0.5, 0.5])
    between_walls(b, dict(zip(("x", "q", "v", "w"), first.tolist(), strict=True)))
    m.goal = {"x": 0.0, "q": 0.0, "v": 0.0, "w": 0.0}
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + 0.001 * sum(b.u[t] ** 2 for t in b.points))
    return m


def hopper(case: int) -> pyo.ConcreteModel:
    """A body over a leg without mass, whose foot stands still where the leg is compressed.

    That the foot does not rise then is said already: it is on the ground.
    """
    random = np.random.default_rng(5000 + case)
    height, goal = (1.5, 2.0) if case == 0 else (random.uniform(1.3, 1.7), random.uniform(1.5, 2.5))
    m = pyo.ConcreteModel(name=f"hopper {case}")
    b = phase_of(m, 200, 0.02)
    fall = {"px": 0.0, "py": height, "vx": 0.0, "vy": 0.0, "q": 0.0, "qx": 0.0, "qy": height - 1.0}
    states(b, fall, qy=(0, None))
    b.compressed = rcp.Control(bounds=(0, 0.8))
    b.push, b.turn, b.spin = rcp.Control(bounds=(0, None)), rcp.Control(), rcp.Control()
    b.wx, b.wy, b.softened = rcp.Control(), rcp.Control(), rcp.Control(bounds=(0, None))
    b.ode(
        lambda b, t: {
            "px": b.vx[t],
            "py": b.vy[t],
            "vx": -b.push[t] * pyo.sin(b.q[t]),
            "vy": b.push[t] * pyo.cos(b.q[t]) - 9.81,
            "q": b.spin[t],
            "qx": b.wx[t],
            "qy": b.wy[t],
        }
    )

    @b.constraint
    def leg(b, t):
        length = 1 - b.compressed[t]
        return {
            "up": length * pyo.cos(b.q[t]) == b.py[t] - b.qy[t],
            "along": length * pyo.sin(b.q[t]) == b.qx[t] - b.px[t],
            "clearance": b.softened[t] >= 0.1 - b.qy[t] - b.compressed[t],
        }

    @b.complementarity
    def modes(b, t):
        return [
            rcp.complements(b.compressed[t] >= 0, b.qy[t] >= 0),
            rcp.complements(b.push[t] >= 0, b.qy[t] >= 0),
        ]

    @b.complementarity
    def switches(b, t):
        switched = [(b.compressed[t], b.wx[t]), (b.qy[t], b.spin[t] - b.turn[t]), (b.compressed[t], b.turn[t])]
        return [rcp.either_zero(first >= 0, second) for first, second in switched]

    times = np.array(list(b.time))
    b.initialize({"py": np.maximum(height - 4.905 * times**2, 1.0), "vy": np.where(times < 0.3, -9.81 * times, 0.0)})
    m.goal = {"px": goal, "qx": goal, "py": 1.0, "vx": 0.0, "vy": 0.0}
    cost = sum(0.001 * b.turn[t] ** 2 + 1e-5 * b.push[t] ** 2 + 100 * b.softened[t] ** 2 for t in b.points)
    m.cost = pyo.Objective(expr=100 * squared_distance(m, m.goal) + cost)
    return m


TASKS = (
    Task("push box", push_box, distance(("x", "y", "q"))),
    Task("transport", transport, distance(("x1", "x2", "v1", "v2"))),
    Task("waiter", waiter, distance(("x1", "x2", "v1", "v2"))),
    Task("cart-pole", cart_pole, distance(("x", "q", "v", "w"))),
    Task("hopper", hopper, distance(("px", "qx", "py", "vx", "vy"))),
    Task("push T", push_t, error_of_t),
)
