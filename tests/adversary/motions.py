"""Motions beside obstacles, most of them spoilt, each stated in Pyomo and as a function of numbers."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
from harness.ties import TIES, tie
from pyomo.dae import ContinuousSet, DerivativeVar

import pyrobocop_pyomo as rcp

RADIUS, CLEARANCE = 0.05, 0.05
# Seconds of one solve; what takes longer is not called safe. Ten times what the slowest of the unspoilt takes alone:
# how busy a machine is must not decide a verdict.
LIMIT = 60.0
LONGEST_ELEMENT = 0.2


def solved_with_defaults(model: Any) -> Any:
    """As a user solves it."""
    return rcp.solve(model, progress=False, time_limit=LIMIT)


@dataclass
class Motion:
    """A model, and the truth about it.

    Attributes
    ----------
    model : ConcreteModel
    phases : list of PhaseBlock
        One after the other; obstacles are beside the last.
    drift : callable
        ``drift(t, y, y_before)``: what moves the ball to the side beside its control, at a time of the whole motion.
    breaks : list of float
        Times at which it jumps, or is hardly seen.
    delay : float
        How much earlier ``y_before`` is.
    later : callable
        Done to the model after the solve.
    solve : callable
        Gives what has an attribute ``safe``.
    pieces : callable, optional
        Where there are no phases: start, end, and the values of the control by time, one piece after the other.
    shift : callable
        Where obstacles are, at times of the whole motion, from where they are stated.
    """

    model: pyo.ConcreteModel
    phases: list[Any]
    drift: Callable[[float, float, float], float]
    breaks: list[float] = field(default_factory=list)
    delay: float = 0.0
    later: Callable[[], None] = lambda: None
    solve: Callable[[Any], Any] = solved_with_defaults
    pieces: Callable[[], list[tuple[float, float, dict[float, float]]]] | None = None
    shift: Callable[[np.ndarray], np.ndarray] = lambda times: np.zeros((len(times), 2))


# ---------------------------------------------------------------------------------------- models


def _phase(random: np.random.Generator, m: Any, name: str = "move", **options: Any) -> Any:
    schemes = [("radau", 1), ("radau", 2), ("radau", 3), ("gauss", 2), ("implicit_euler", None)]
    scheme, stages = schemes[random.integers(len(schemes))]
    elements = int(random.integers(5, 11))
    return _ball(m, name, elements=elements, scheme=scheme, stages=stages, **options)


def _ball(m: Any, name: str = "move", *, first: bool = True, history: float | None = None, **mesh: Any) -> Any:
    """A phase without equations; the first one of a model starts at the origin."""
    b = rcp.PhaseBlock(**{"duration": 1.0, **mesh})
    m.add_component(name, b)
    b.x, b.y = rcp.State(initial_guess=0.0), rcp.State(initial_guess=0.0, history=history)
    b.u = rcp.Control(bounds=(-4, 4), initial_guess=0.0)
    if first:
        b.x[0.0].fix(0.0)
        b.y[0.0].fix(0.0)
    return b


def _obstacles(random: np.random.Generator) -> dict[str, Any]:
    if random.random() < 0.5:
        return {"wall": rcp.Polytope.box(6.0, 0.2, center=(0.5, 0.4))}
    return {
        "one": rcp.Polytope.ball(0.15, (random.uniform(0.3, 0.45), 0.35)),
        "two": rcp.Polytope.ball(0.1, (random.uniform(0.6, 0.9), 0.32)),
    }


def _finish(m: Any, b: Any, obstacles: dict[str, Any], other: Any = None) -> None:
    _avoid(b, b.time, obstacles)
    phases = [b] if other is None else [other, b]
    drawn = sum(p.integral(lambda p, t: 10.0 * (p.y[t] - 0.3) ** 2 + 0.01 * p.u[t] ** 2) for p in phases)
    m.cost = pyo.Objective(expr=drawn)
    m.obstacles_of_the_judge = obstacles


def _avoid(b: Any, points: Any, obstacles: dict[str, Any]) -> None:
    body, pose = rcp.Polytope.ball(RADIUS, (0.0, 0.0)), lambda b, t: rcp.planar_pose(b.x[t], b.y[t])
    b.avoid = rcp.ObstacleAvoidanceBlock(points, body=body, pose=pose, obstacles=obstacles, clearance=CLEARANCE)


def _by_rate(b: Any, rate: Callable[[Any, Any], Any]) -> None:
    b.ode(lambda b, t: {b.x: 1.0, b.y: rate(b, t)})


def _single(
    random: np.random.Generator,
    drift: Callable[[Any, Any, Any], Any],
    numbers: Callable[[float, float, float], float],
    prepare: Callable[[Any, Any], None] = lambda m, b: None,
    *,
    breaks: list[float] | None = None,
    delay: float = 0.0,
    state: Callable[[Any, Callable[[Any, Any], Any]], None] = _by_rate,
) -> Motion:
    """One phase of one second: ahead at speed one, to the side by control and drift."""
    m = pyo.ConcreteModel(name="motion")
    b = _phase(random, m)
    prepare(m, b)
    state(b, lambda b, t: b.u[t] + drift(m, b, t))
    _finish(m, b, _obstacles(random))
    return Motion(m, [b], numbers, breaks or [], delay)


def _by_formula(random: np.random.Generator, formula: Callable[[Any, Any], Any], **options: Any) -> Motion:
    """The same where one function of time and place is both: Pyomo's functions are those of numbers, too."""
    return _single(random, lambda m, b, t: formula(t, b.y[t]), lambda t, y, before: formula(t, y), **options)


# ---------------------------------------------------------------------------------------- spoilers


def nothing(random: np.random.Generator) -> Motion:
    """A smooth drift by time and state."""
    a, w, k = random.uniform(-1.5, 1.5), random.uniform(0.5, 6.0), random.uniform(0.0, 2.0)
    return _by_formula(random, lambda t, y: a * pyo.sin(w * t) - k * y)


def nothing_with_history(random: np.random.Generator) -> Motion:
    """A delay that says what was before."""
    a, tau, before_start = random.uniform(-2, 2), random.uniform(0.1, 0.4), random.uniform(-0.3, 0.3)
    m = pyo.ConcreteModel(name="motion")
    b = _ball(m, elements=int(random.integers(5, 11)), history=before_start)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * b.y.delayed(t, tau)})
    _finish(m, b, _obstacles(random))
    m.history_of_the_judge = before_start
    return Motion(m, [b], lambda t, y, before: a * before, np.arange(tau, 1.0, tau).tolist(), tau)


def nothing_in_two_phases(random: np.random.Generator) -> Motion:
    """Two phases that a link joins."""
    return _joined(random, "link")


def aliased(random: np.random.Generator) -> Motion:
    """A frequency that the mesh, or sixteen parts of an element, sees as a constant."""
    state = random.bit_generator.state
    elements = _phase(random, pyo.ConcreteModel()).grid.mesh.elements
    random.bit_generator.state = state
    times = random.choice([1, 2, 3, 8, 16, 17, 32, 48])
    w, phase = 2 * np.pi * elements * float(times), random.uniform(0, 2 * np.pi)
    a = random.uniform(0.2, 0.5) * w * CLEARANCE
    breaks = np.linspace(0.0, 1.0, 8 * elements * int(times) + 1).tolist()
    return _by_formula(random, lambda t, y: a * pyo.cos(w * t + phase), breaks=breaks)


def _pulse(random: np.random.Generator) -> tuple[float, float, float]:
    """Start, width and height of a pulse that leads farther than the clearance."""
    start, width = random.uniform(0.1, 0.8), 10.0 ** random.uniform(-3.5, -1.0)
    return start, width, float(random.uniform(0.5, 3.0)) * 2 * CLEARANCE / width


def short_pulse(random: np.random.Generator) -> Motion:
    """A smooth pulse between the points."""
    start, width, height = _pulse(random)
    breaks = [start + k * width for k in range(-4, 5)]
    return _by_formula(random, lambda t, y: height * pyo.exp(-(((t - start) / width) ** 2)), breaks=breaks)


def shorter_step(random: np.random.Generator) -> Motion:
    """A pulse by an ``if`` on t as a number, which may be too short to be seen; that is documented."""
    return _step(random, 0.0)


def step_in_time(random: np.random.Generator) -> Motion:
    """The same, as long as the parts of an element at which such rules are looked at."""
    return _step(random, LONGEST_ELEMENT / 15)


def frozen_value(random: np.random.Generator) -> Motion:
    """The same, by the value that t has."""
    return _step(random, LONGEST_ELEMENT / 15, pyo.value)


def _step(random: np.random.Generator, shortest: float, read: Callable[[Any], Any] = lambda t: t) -> Motion:
    start, width, height = _pulse(random)
    height, width = height * width / max(width, shortest), max(width, shortest)

    def numbers(t: float, y: float = 0.0, before: float = 0.0) -> float:
        return height if start < t < start + width else 0.0

    return _single(random, lambda m, b, t: numbers(read(t)), numbers, breaks=[start, start + width])


def frozen_text(random: np.random.Generator) -> Motion:
    """A tenth of a second, by the digits of t."""
    digit, height = int(random.integers(1, 9)), float(random.uniform(0.5, 3.0)) * 20 * CLEARANCE

    by_digits = lambda t, y: height if str(t).startswith(f"0.{digit}") else 0.0  # noqa: E731
    return _by_formula(random, by_digits, breaks=[digit / 10, (digit + 1) / 10])


def data_by_time(random: np.random.Generator) -> Motion:
    """Numbers at the points, which know nothing of what is between them."""
    kind = random.choice(["dictionary", "default", "param", "fixed"])
    a, w = random.uniform(1.0, 3.0), random.uniform(10.0, 60.0)

    def numbers(t: float, y: float = 0.0, before: float = 0.0) -> float:
        return float(a * np.sin(w * t))

    def prepare(m: Any, b: Any) -> None:
        given = {t: numbers(t) for t in b.points}
        m.given = pyo.Param(list(given), initialize=given, mutable=True) if kind == "param" else given
        if kind == "fixed":
            del m.given
            m.given = pyo.Var(list(given), initialize=given)
            m.given.fix()

    def drift(m: Any, b: Any, t: Any) -> Any:
        return m.given.get(t, 0.0) if kind == "default" else m.given[t]

    return _single(random, drift, numbers, prepare)


def no_history(random: np.random.Generator) -> Motion:
    """A delay that is shorter than the first point is late, without a word on what was before."""
    a, tau = random.uniform(5.0, 15.0), 0.02
    return _single(
        random,
        lambda m, b, t: a * (0.1 - b.y.delayed(t, tau)),
        lambda t, y, before: a * (0.1 - before),
        breaks=np.arange(tau, 1.0, tau).tolist(),
        delay=tau,
    )


def _joined(random: np.random.Generator, kind: str) -> Motion:
    m = pyo.ConcreteModel(name="joined")
    one = _phase(random, m, "one", duration=0.5)
    two = _phase(random, m, "two", duration=0.5, start=one, first=False)
    a, w = random.uniform(-2, 2), random.uniform(1.0, 12.0)
    for b in (one, two):
        b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * pyo.sin(w * b.time_at(t))})
    if kind == "forgotten":
        m.link = rcp.Link(one, two, states=["x"])
    elif kind == "omitted":
        m.link = rcp.Link(one, two, omit=["y"])
    else:
        tie(m, kind)
    _finish(m, two, _obstacles(random), one)
    return Motion(m, [one, two], lambda t, y, before: a * np.sin(w * t))


def tied_otherwise(random: np.random.Generator) -> Motion:
    """Phases that are joined by anything but one link."""
    return _joined(random, str(random.choice([*TIES, "band"])))


def stale(random: np.random.Generator) -> Motion:
    """A parameter, or a control, gets another value after the solve."""
    a, change = random.uniform(-0.5, 0.5), random.uniform(0.2, 1.5)
    now = [a]

    def prepare(m: Any, b: Any) -> None:
        m.wind = pyo.Param(initialize=a, mutable=True)

    motion = _single(random, lambda m, b, t: m.wind, lambda t, y, before: now[0], prepare)
    of_control = random.random() < 0.5

    def later() -> None:
        if of_control:
            for variable in motion.phases[0].u.values():
                variable.set_value(variable.value + change)
        else:
            motion.model.wind, now[0] = a + change, a + change

    motion.later = later
    return motion


def beside_another(random: np.random.Generator) -> Motion:
    """Equations that read the states of another phase, whose mesh is coarse."""
    m = pyo.ConcreteModel(name="beside")
    b = _phase(random, m)
    grid = b.grid
    m.lead = c = rcp.PhaseBlock(
        duration=1.0, elements=grid.mesh.elements, scheme=grid.scheme.name.partition("(")[0], stages=grid.scheme.stages
    )
    k = random.uniform(2.0, 10.0)
    c.z = rcp.State(initial=1.0)
    c.ode(lambda c, t: {c.z: -k * c.z[t]})
    a = random.uniform(1.0, 4.0)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * m.lead.z[t]})
    _finish(m, b, _obstacles(random))
    return Motion(m, [b], lambda t, y, before: a * np.exp(-k * t))


# ---------------------------------------------------------------------------------------- pairs and equations


def nothing_with_pairs(random: np.random.Generator) -> Motion:
    """A smooth drift, and a soft wall that the ball may lean on, or that it never reaches."""
    a, w, k = random.uniform(-1.5, 1.5), random.uniform(0.5, 6.0), random.uniform(0.0, 2.0)
    wall, soft = random.choice([random.uniform(0.05, 0.18), 3.0]), 10.0 ** random.uniform(-2.5, -0.5)

    def state(b: Any, rate: Callable[[Any, Any], Any]) -> None:
        b.push = rcp.Algebraic(bounds=(0, None), initial_guess=0.0)
        _by_rate(b, lambda b, t: rate(b, t) - b.push[t])
        b.complementarity(lambda b, t: rcp.complements(b.push[t] >= 0, soft * b.push[t] + wall - b.y[t] >= 0))

    return _single(
        random,
        lambda m, b, t: a * pyo.sin(w * t) - k * b.y[t],
        lambda t, y, before: a * np.sin(w * t) - k * y - max(0.0, y - wall) / soft,
        state=state,
    )


def _in_a_field(random: np.random.Generator, state: Callable[[Any, Callable[[Any, Any], Any]], None]) -> Motion:
    a, w, c = random.uniform(-3, 3), random.uniform(1.0, 12.0), random.uniform(0.5, 5.0)
    phase = random.uniform(0, 2 * np.pi)
    return _by_formula(random, lambda t, y: a * pyo.sin(w * t + phase) + c * pyo.sin(3 * y), state=state)


def algebraic_between(random: np.random.Generator) -> Motion:
    """Between control and motion stands an `Algebraic`, beside a pair that is never active or beside none."""
    with_pair = random.random() < 0.7

    def state(b: Any, rate: Callable[[Any, Any], Any]) -> None:
        b.w = rcp.Algebraic(initial_guess=0.0)
        b.residual(lambda b, t: b.w[t] == rate(b, t))
        if with_pair:
            b.push = rcp.Algebraic(bounds=(0, None), initial_guess=0.0)
            b.complementarity(lambda b, t: rcp.complements(b.push[t] >= 0, 3 - b.y[t] >= 0))
        _by_rate(b, lambda b, t: b.w[t] - b.push[t] if with_pair else b.w[t])

    return _in_a_field(random, state)


def constraint_for_equation(random: np.random.Generator) -> Motion:
    """The speed to the side is declared as a `Control`, and a constraint states what it is."""
    way = random.integers(3)

    def state(b: Any, rate: Callable[[Any, Any], Any]) -> None:
        b.w = rcp.Control(initial_guess=0.0)
        b.v = rcp.Control(initial_guess=1.0)
        ways = (
            lambda b, t: b.w[t] == rate(b, t),
            lambda b, t: (0.0, b.w[t] - rate(b, t), 0.0),
            lambda b, t: b.v[t] * rate(b, t) - b.w[t] == 0.0,  # no slip to the side
        )
        b.constraint(lambda b, t: [b.v[t] == 1.0, ways[way](b, t)], name="equation")
        b.ode(lambda b, t: {b.x: b.v[t], b.y: b.w[t]})

    return _in_a_field(random, state)


# ---------------------------------------------------------------------------------------- rules after building


def rules_whose_data_change(random: np.random.Generator) -> Motion:
    """A rule finds a number in a variable of Python's, or by ``pyo.value``, that is another one before the solve."""
    way, w = random.choice(["loop", "value", "another model", "list"]), random.uniform(1.0, 12.0)
    wind, other = random.uniform(-1.5, 1.5, size=2)
    here: dict[str, Any] = {}
    then = wind

    def prepare(m: Any, b: Any) -> None:
        m.wind = pyo.Param(initialize=wind, mutable=True)
        here.update(model=m, winds=[wind])

    ways = {
        "loop": lambda m: then,
        "value": lambda m: pyo.value(m.wind),
        "another model": lambda m: pyo.value(here["model"].wind),
        "list": lambda m: here["winds"][-1],
    }
    motion = _single(
        random,
        lambda m, b, t: float(ways[str(way)](m)) * (1 + pyo.sin(w * t)),
        lambda t, y, before: float(wind * (1 + np.sin(w * t))),
        prepare,
    )
    motion.model.wind, then = other, other
    here["winds"].append(other)
    return motion


def delay_by_hand(random: np.random.Generator) -> Motion:
    """What was one element earlier, read at the point before."""
    n, a, captured = int(random.integers(5, 16)), random.uniform(-6, 6), random.random() < 0.5
    m = pyo.ConcreteModel(name="motion")
    b = _ball(m, elements=n, scheme="implicit_euler")
    times = list(b.time)
    before = (lambda t: times[max(bisect_left(times, t) - 1, 0)]) if captured else b.time.prev
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * (0.1 - b.y[before(t)])})
    _finish(m, b, _obstacles(random))
    return Motion(m, [b], lambda t, y, before: a * (0.1 - before), np.arange(1, n).__truediv__(n).tolist(), 1 / n)


# ---------------------------------------------------------------------------------------- other places


def jet_in_space(random: np.random.Generator) -> Motion:
    """A jet blows across the way, narrower than what an element goes."""
    at, width, height = random.uniform(0.1, 0.8), 10.0 ** random.uniform(-4.0, -1.5), 0.0
    height = float(random.uniform(0.5, 3.0)) * 2 * CLEARANCE / width
    bell = lambda x: height * np.exp(-(((x - at) / width) ** 2))  # noqa: E731
    slope = lambda x: -2 * (x - at) / width**2 * bell(x)  # noqa: E731
    jet = rcp.Function(lambda X: bell(X[:, 0]), slope, name="jet")
    within = lambda x: pyo.inequality(at, x, at + width)  # noqa: E731
    ways = {
        "formula": lambda m, b, t: height * pyo.exp(-(((b.x[t] - at) / width) ** 2)),
        "function": lambda m, b, t: jet(b.x[t]),
        "expr_if": lambda m, b, t: pyo.Expr_if(IF=within(b.x[t]), THEN=height, ELSE=0.0),
    }
    way = str(random.choice(list(ways)))

    def numbers(t: float, y: float = 0.0, before: float = 0.0) -> float:
        return float(height if at < t < at + width else 0.0) if way == "expr_if" else float(bell(t))

    return _single(random, ways[way], numbers, breaks=[at + k * width for k in range(-4, 5)])


def position_left_free(random: np.random.Generator) -> Motion:
    """A link of two phases that does not say where the ball goes on."""
    return _joined(random, str(random.choice(["forgotten", "omitted"])))


def clock_that_starts_again(random: np.random.Generator) -> Motion:
    """A second phase whose clock starts again, beside an obstacle that moves."""
    m = pyo.ConcreteModel(name="clocks")
    one, two = (_phase(random, m, name, duration=0.5, first=name == "one") for name in ("one", "two"))
    for b in (one, two):
        b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t]})
    m.link = rcp.Link(one, two)
    at, speed = random.uniform(0.6, 0.9), random.choice([-1, 1]) * random.uniform(1.0, 3.0)
    low = random.uniform(0.2, 0.4) - speed * at
    ball = rcp.Polytope.ball(0.1, (0.0, 0.0))
    _finish(m, two, {"mover": rcp.Body(ball, pose=lambda b, t: rcp.planar_pose(at, low + speed * t))}, one)
    m.obstacles_of_the_judge = {"mover": ball}
    where = lambda times: np.column_stack([np.full(len(times), at), low + speed * times])  # noqa: E731
    return Motion(m, [one, two], lambda t, y, before: 0.0, shift=where)


def points_of_users(random: np.random.Generator) -> Motion:
    """No phase: a user's own rows of Euler at plain points, or finite differences and collocation of pyomo.dae."""
    a, w, k = random.uniform(-1.5, 1.5), random.uniform(0.5, 6.0), random.uniform(0.0, 2.0)
    way = str(random.choice(["explicit", "implicit", "FORWARD", "BACKWARD", "CENTRAL", "collocation"]))
    n, ncp = int(random.integers(6, 25)), int(random.integers(1, 4))
    m = pyo.ConcreteModel(name="points")
    plain = way.islower() and way != "collocation"
    m.t = pyo.Set(initialize=[i / n for i in range(n + 1)], ordered=True) if plain else ContinuousSet(bounds=(0, 1))
    m.x, m.y, m.u = pyo.Var(m.t, initialize=0.0), pyo.Var(m.t, initialize=0.0), pyo.Var(m.t, bounds=(-4, 4))
    rate = lambda t: m.u[t] + a * pyo.sin(w * t) - k * m.y[t]  # noqa: E731
    if plain:
        steps = [(s, t, s if way == "explicit" else t) for s, t in pairwise(m.t)]
        m.along = pyo.Constraint(range(n), rule=lambda m, i: m.x[steps[i][1]] == m.x[steps[i][0]] + 1 / n)
        m.aside = pyo.Constraint(
            range(n), rule=lambda m, i: m.y[steps[i][1]] == m.y[steps[i][0]] + rate(steps[i][2]) / n
        )
    else:
        m.dx, m.dy = DerivativeVar(m.x, wrt=m.t), DerivativeVar(m.y, wrt=m.t)
        m.along = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == 1.0)
        m.aside = pyo.Constraint(m.t, rule=lambda m, t: m.dy[t] == rate(t))
        by = {"ncp": ncp} if way == "collocation" else {"scheme": way}
        kind = "collocation" if way == "collocation" else "finite_difference"
        pyo.TransformationFactory(f"dae.{kind}").apply_to(m, wrt=m.t, nfe=n, **by)
    m.x[0.0].fix(0.0)
    m.y[0.0].fix(0.0)
    for t in m.t:
        m.x[t].set_value(t)
        m.u[t].set_value(0.0)
    obstacles = _obstacles(random)
    _avoid(m, m.t, obstacles)
    m.cost = pyo.Objective(expr=sum(10.0 * (m.y[t] - 0.3) ** 2 + 0.01 * m.u[t] ** 2 for t in m.t))
    m.obstacles_of_the_judge = obstacles

    def pieces() -> list[tuple[float, float, dict[float, float]]]:
        ends = sorted(m.t.get_finite_elements()) if way == "collocation" else list(m.t)
        read = {
            "explicit": lambda low, high: [low],
            "FORWARD": lambda low, high: [low],
            "CENTRAL": lambda low, high: [low, high],
            "collocation": lambda low, high: [t for t in m.t if low < t <= high],
        }.get(way, lambda low, high: [high])
        return [(low, high, {t: m.u[t].value for t in read(low, high)}) for low, high in pairwise(ends)]

    return Motion(m, [], lambda t, y, before: a * np.sin(w * t) - k * y, pieces=pieces)


def guess_verified(random: np.random.Generator) -> Motion:
    """Nothing was solved, or the values were changed; the motion is given to ``verify_motion``, or to its block."""
    a, level, by_hand = random.uniform(-1, 3), random.uniform(-0.1, 0.15), random.random() < 0.4
    motion = _by_formula(random, lambda t, y: a * pyo.cos(3 * t))
    m, b = motion.model, motion.phases[0]

    def verified(_: Any) -> Any:
        for t in b.time:
            b.x[t].set_value(t)
            b.y[t].set_value(level * t)
        if by_hand:
            return b.avoid.verify()
        ball = rcp.Body(rcp.Polytope.ball(RADIUS, (0.0, 0.0)), pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]))
        obstacles = m.obstacles_of_the_judge
        return rcp.verify_motion(b.trajectory(), bodies={"ball": ball}, obstacles=obstacles, clearance=CLEARANCE)

    motion.solve = verified
    return motion


WITHOUT_PAIRS = ("nothing", "nothing_with_history", "nothing_in_two_phases")
WITH_PAIRS = ("nothing_with_pairs",)
UNSPOILT = (*WITHOUT_PAIRS, *WITH_PAIRS)
SPOILERS: dict[str, Callable[[np.random.Generator], Motion]] = {
    f.__name__: f
    for f in (
        nothing, nothing_with_history, nothing_in_two_phases, nothing_with_pairs,
        aliased, short_pulse, step_in_time, frozen_value, frozen_text, data_by_time, no_history, tied_otherwise, stale,
        beside_another, shorter_step,
        algebraic_between, constraint_for_equation, rules_whose_data_change, delay_by_hand, jet_in_space,
        position_left_free, clock_that_starts_again, points_of_users, guess_verified,
    )
}  # fmt: skip
# Spoilers that a page of the documentation names as limits.
DOCUMENTED = {"shorter_step"}
