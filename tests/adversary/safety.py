"""An adversary for safety: motions beside obstacles are spoilt between the points of the mesh, and simulated densely.

The law. Where ``result.safe is True``, the motion of the equations as stated, under the controls of the plan, keeps the
clearance at all times: to the tolerance of the proof, a hundredth of the clearance, which is documented. What is
refused, or not called safe, is never wrong; but of the motions that are not spoilt at most one in ten may be.

A ball is drawn towards a wall, or past two discs, and rides on the clearance: whatever leads away from the plan in
between collides. Each motion is stated twice: in Pyomo, as a user writes it, and as a function of numbers, which the
judge integrates from break to break with small steps. The judge takes the values of the controls from the model, and
their polynomials from their nodes; of the package it uses nothing.
"""

from __future__ import annotations

import enum
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyomo.environ as pyo
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import PyRobocopError

from .outcome import Trial

RADIUS, CLEARANCE = 0.05, 0.05
# What a proof may miss of the clearance, and what rounding and the judge's integration may.
TOLERANCE = 0.01 * CLEARANCE + 1e-6
STEPS = 40  # of the judge, at least, in each element
# Seconds of one solve; what takes longer is not called safe.
LIMIT = 5.0
LONGEST_ELEMENT = 0.2

Numbers = Callable[[float, np.ndarray], float]


class Verdict(enum.Enum):
    """What became of a motion."""

    REFUSED = "refused"
    NOT_SAFE = "not safe"
    TRUE = "safe, true"
    FAULT = "fault"


@dataclass
class Motion:
    """A model, and the truth about it.

    Attributes
    ----------
    model : ConcreteModel
    phases : list of PhaseBlock
        One after the other.
    drift : callable
        ``drift(t, y, y_before)``: what moves the ball to the side beside its control, at a time of the whole motion.
    breaks : list of float
        Times at which it jumps, or is hardly seen.
    delay : float
        How much earlier ``y_before`` is.
    later : callable
        Done to the model after the solve.
    """

    model: pyo.ConcreteModel
    phases: list[Any]
    drift: Callable[[float, float, float], float]
    breaks: list[float] = field(default_factory=list)
    delay: float = 0.0
    later: Callable[[], None] = lambda: None


# ---------------------------------------------------------------------------------------- models


def _phase(m: Any, name: str, random: np.random.Generator, duration: float, start: Any = 0.0) -> Any:
    schemes = [("radau", 1), ("radau", 2), ("radau", 3), ("gauss", 2), ("implicit_euler", None)]
    scheme, stages = schemes[random.integers(len(schemes))]
    elements = int(random.integers(5, 11))
    b = rcp.PhaseBlock(duration=duration, elements=elements, scheme=scheme, stages=stages, start=start)
    m.add_component(name, b)
    b.x, b.y = rcp.State(initial_guess=0.0), rcp.State(initial_guess=0.0)
    b.u = rcp.Control(bounds=(-4, 4), initial_guess=0.0)
    return b


def _obstacles(random: np.random.Generator) -> dict[str, Any]:
    if random.random() < 0.5:
        return {"wall": rcp.Polytope.box(6.0, 0.2, center=(0.5, 0.4))}
    return {
        "one": rcp.Polytope.ball(0.15, (random.uniform(0.3, 0.45), 0.35)),
        "two": rcp.Polytope.ball(0.1, (random.uniform(0.6, 0.9), 0.32)),
    }


def _finish(m: Any, b: Any, obstacles: dict[str, Any], other: Any = None) -> None:
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        body=rcp.Polytope.ball(RADIUS, (0.0, 0.0)),
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
        obstacles=obstacles,
        clearance=CLEARANCE,
    )
    phases = [b] if other is None else [other, b]
    drawn = sum(p.integral(lambda p, t: 10.0 * (p.y[t] - 0.3) ** 2 + 0.01 * p.u[t] ** 2) for p in phases)
    m.cost = pyo.Objective(expr=drawn)
    m.obstacles_of_the_judge = obstacles


def _single(
    random: np.random.Generator,
    drift: Callable[[Any, Any, Any], Any],
    numbers: Callable[[float, float, float], float],
    prepare: Callable[[Any, Any], None] = lambda m, b: None,
    *,
    breaks: list[float] | None = None,
    delay: float = 0.0,
    **state: Any,
) -> Motion:
    """One phase of one second: ahead at speed one, to the side by control and drift."""
    m = pyo.ConcreteModel(name="motion")
    b = _phase(m, "move", random, 1.0)
    b.x[0.0].fix(0.0)
    b.y[0.0].fix(0.0)
    prepare(m, b)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + drift(m, b, t)})
    _finish(m, b, _obstacles(random))
    return Motion(m, [b], numbers, breaks or [], delay)


# ---------------------------------------------------------------------------------------- spoilers


def nothing(random: np.random.Generator) -> Motion:
    """A smooth drift by time and state."""
    a, w, k = random.uniform(-1.5, 1.5), random.uniform(0.5, 6.0), random.uniform(0.0, 2.0)
    return _single(
        random,
        lambda m, b, t: a * pyo.sin(w * t) - k * b.y[t],
        lambda t, y, before: a * np.sin(w * t) - k * y,
    )


def nothing_with_history(random: np.random.Generator) -> Motion:
    """A delay that says what was before."""
    a, tau, before_start = random.uniform(-2, 2), random.uniform(0.1, 0.4), random.uniform(-0.3, 0.3)
    m = pyo.ConcreteModel(name="motion")
    b = rcp.PhaseBlock(duration=1.0, elements=int(random.integers(5, 11)))
    m.move = b
    b.x, b.y = rcp.State(initial=0), rcp.State(initial=0, history=before_start)
    b.u = rcp.Control(bounds=(-4, 4), initial_guess=0.0)
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
    elements = _phase(pyo.ConcreteModel(), "probe", random, 1.0).grid.mesh.elements
    random.bit_generator.state = state
    times = random.choice([1, 2, 3, 8, 16, 17, 32, 48])
    w, phase = 2 * np.pi * elements * float(times), random.uniform(0, 2 * np.pi)
    a = random.uniform(0.2, 0.5) * w * CLEARANCE
    return _single(
        random,
        lambda m, b, t: a * pyo.cos(w * t + phase),
        lambda t, y, before: a * np.cos(w * t + phase),
        breaks=np.linspace(0.0, 1.0, 8 * elements * int(times) + 1).tolist(),
    )


def _pulse(random: np.random.Generator) -> tuple[float, float, float]:
    """Start, width and height of a pulse that leads farther than the clearance."""
    start, width = random.uniform(0.1, 0.8), 10.0 ** random.uniform(-3.5, -1.0)
    return start, width, float(random.uniform(0.5, 3.0)) * 2 * CLEARANCE / width


def short_pulse(random: np.random.Generator) -> Motion:
    """A smooth pulse between the points."""
    start, width, height = _pulse(random)
    return _single(
        random,
        lambda m, b, t: height * pyo.exp(-(((t - start) / width) ** 2)),
        lambda t, y, before: height * np.exp(-(((t - start) / width) ** 2)),
        breaks=[start + k * width for k in range(-4, 5)],
    )


def shorter_step(random: np.random.Generator) -> Motion:
    """A pulse by an ``if`` on t as a number, which may be too short to be seen; that is documented."""
    return _step(random, 0.0)


def step_in_time(random: np.random.Generator) -> Motion:
    """The same, as long as the parts of an element at which such rules are looked at."""
    return _step(random, LONGEST_ELEMENT / 15)


def _step(random: np.random.Generator, shortest: float) -> Motion:
    start, width, height = _pulse(random)
    height, width = height * width / max(width, shortest), max(width, shortest)

    def numbers(t: float, y: float = 0.0, before: float = 0.0) -> float:
        return height if start < t < start + width else 0.0

    return _single(random, lambda m, b, t: numbers(t), numbers, breaks=[start, start + width])


def frozen_value(random: np.random.Generator) -> Motion:
    """The same, by the value that t has."""
    start, width, height = _pulse(random)
    shortest = LONGEST_ELEMENT / 15
    height, width = height * width / max(width, shortest), max(width, shortest)

    def numbers(t: float, y: float = 0.0, before: float = 0.0) -> float:
        return height if start < t < start + width else 0.0

    return _single(random, lambda m, b, t: numbers(pyo.value(t)), numbers, breaks=[start, start + width])


def frozen_text(random: np.random.Generator) -> Motion:
    """A tenth of a second, by the digits of t."""
    digit, height = int(random.integers(1, 9)), float(random.uniform(0.5, 3.0)) * 20 * CLEARANCE

    def numbers(t: Any, y: float = 0.0, before: float = 0.0) -> float:
        return height if str(t).startswith(f"0.{digit}") else 0.0

    return _single(random, lambda m, b, t: numbers(t), numbers, breaks=[digit / 10, (digit + 1) / 10])


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
    one = _phase(m, "one", random, 0.5)
    two = _phase(m, "two", random, 0.5, start=one)
    one.x[0.0].fix(0.0)
    one.y[0.0].fix(0.0)
    a, w = random.uniform(-2, 2), random.uniform(1.0, 12.0)
    for b in (one, two):
        b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * pyo.sin(w * b.time_at(t))})
    ends, starts = ({n: b.component(n)[t] for n in "xy"} for b, t in ((one, one.final_time), (two, two.initial_time)))
    if kind == "link":
        m.link = rcp.Link(one, two)
    elif kind == "links":
        order = ["x", "y"] if random.random() < 0.5 else ["y", "x"]
        for name in order:
            m.add_component(f"link_{name}", rcp.Link(one, two, states=[name]))
    elif kind == "constraints":
        for name in "xy":
            m.add_component(f"tie_{name}", pyo.Constraint(expr=starts[name] == ends[name]))
    elif kind == "of the phase":
        for name in "xy":
            two.add_component(f"tie_{name}", pyo.Constraint(expr=ends[name] - starts[name] == 0))
    elif kind == "in between":
        m.between = pyo.Var(["x", "y"], initialize=0.0)
        for name in "xy":
            m.add_component(f"before_{name}", pyo.Constraint(expr=m.between[name] == ends[name]))
            m.add_component(f"after_{name}", pyo.Constraint(expr=m.between[name] == starts[name]))
    else:
        band = 1e-5
        for name in "xy":
            tie = pyo.inequality(-band, starts[name] - ends[name], band)
            m.add_component(f"tie_{name}", pyo.Constraint(expr=tie))
    _finish(m, two, _obstacles(random), one)
    return Motion(m, [one, two], lambda t, y, before: a * np.sin(w * t))


def tied_otherwise(random: np.random.Generator) -> Motion:
    """Phases that are joined by anything but one link."""
    return _joined(random, str(random.choice(["links", "constraints", "of the phase", "in between", "band"])))


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
    b = _phase(m, "move", random, 1.0)
    grid = b.grid
    m.lead = c = rcp.PhaseBlock(
        duration=1.0, elements=grid.mesh.elements, scheme=grid.scheme.name.partition("(")[0], stages=grid.scheme.stages
    )
    k = random.uniform(2.0, 10.0)
    c.z = rcp.State(initial=1.0)
    c.ode(lambda c, t: {c.z: -k * c.z[t]})
    b.x[0.0].fix(0.0)
    b.y[0.0].fix(0.0)
    a = random.uniform(1.0, 4.0)
    b.ode(lambda b, t: {b.x: 1.0, b.y: b.u[t] + a * m.lead.z[t]})
    _finish(m, b, _obstacles(random))
    return Motion(m, [b], lambda t, y, before: a * np.exp(-k * t))


UNSPOILT = {f.__name__: f for f in (nothing, nothing_with_history, nothing_in_two_phases)}
SPOILERS: dict[str, Callable[[np.random.Generator], Motion]] = UNSPOILT | {
    f.__name__: f
    for f in (
        aliased,
        short_pulse,
        step_in_time,
        frozen_value,
        frozen_text,
        data_by_time,
        no_history,
        tied_otherwise,
        stale,
        beside_another,
        shorter_step,
    )
}
# Spoilers that a page of the documentation names as limits.
DOCUMENTED = {"shorter_step"}


# ---------------------------------------------------------------------------------------- the judge


def smallest_distance(motion: Motion) -> float:
    """Of the ball from the obstacles, in the motion of the equations under the controls on the model."""
    m = motion.model
    state, least = np.zeros(2), np.inf
    past = [(0.0, lambda t: getattr(m, "history_of_the_judge", 0.0))]
    for b in motion.phases:
        grid = b.grid
        for i, stages in enumerate(grid.stage_times):
            low, high = grid.mesh.boundaries[i], grid.mesh.boundaries[i + 1]
            control = _interpolated(np.array(stages), np.array([b.u[t].value for t in stages]))
            breaks = [t for t in motion.breaks if low < t < high]
            for first, last in zip([low, *breaks], [*breaks, high], strict=True):

                def rates(
                    t: float, s: np.ndarray, of: Any = control, ends: tuple[float, float] = (first, last)
                ) -> list[float]:
                    inside = min(max(t, np.nextafter(*ends)), np.nextafter(*ends[::-1]))
                    before = _past(past, t - motion.delay) if motion.delay else 0.0
                    return [1.0, of(t) + motion.drift(inside, s[1], before)]

                found = solve_ivp(
                    rates, (first, last), state, max_step=(high - low) / STEPS, rtol=1e-9, atol=1e-11, dense_output=True
                )
                assert found.success
                state = found.y[:, -1]
                past.append((last, found.sol))
                dense = found.sol(np.linspace(first, last, 4 * len(found.t)))
                if b is motion.phases[-1]:
                    least = min(least, _distance(m.obstacles_of_the_judge, dense.T))
    return least


def _interpolated(times: np.ndarray, values: np.ndarray) -> Callable[[float], float]:
    if len(times) == 1:
        return lambda t: float(values[0])
    of = Polynomial.fit(times, values, len(times) - 1) if len(times) < 4 else BarycentricInterpolator(times, values)
    return lambda t: float(of(t))


def _past(pieces: list[tuple[float, Any]], time: float) -> float:
    if time <= 0.0 or len(pieces) == 1:
        return float(pieces[0][1](time))
    for end, of in pieces[1:]:
        if time <= end + 1e-12:
            return float(of(time)[1])
    return float(pieces[-1][1](time)[1])


def _distance(obstacles: dict[str, Any], places: np.ndarray) -> float:
    """Of a ball from balls and boxes along the axes."""
    least = np.inf
    for shape in obstacles.values():
        if len(shape.vertices) == 1:
            found = np.hypot(*(places - shape.vertices[0]).T) - shape.radius
        else:
            low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
            outside = np.maximum(np.maximum(low - places, places - high), 0.0)
            inside = np.minimum(np.maximum(low - places, places - high).max(axis=1), 0.0)
            found = np.hypot(*outside.T) + inside
        least = min(least, float(found.min()) - RADIUS)
    return least


# ---------------------------------------------------------------------------------------- a trial


def tried(seed: int, only: str | None = None) -> Trial:
    """Build, solve, change what changes afterwards, and judge; the spoilers take turns."""
    name = only or list(SPOILERS)[seed % len(SPOILERS)]
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)
    try:
        verdict, told = _judged(name, np.random.default_rng(seed))
    finally:
        logging.disable(level)
    return Trial(seed, name, verdict, " ".join(told.split())[:300])


def _judged(name: str, random: np.random.Generator) -> tuple[Verdict, str]:
    try:
        motion = SPOILERS[name](random)
        result = rcp.solve(motion.model, progress=False, time_limit=LIMIT)
    except PyRobocopError as error:
        return Verdict.REFUSED, str(error)
    motion.later()
    if result.safe is not True:
        return Verdict.NOT_SAFE, "\n".join(str(result.safety).splitlines()[:2])
    distance = smallest_distance(motion)
    if distance >= CLEARANCE - TOLERANCE:
        return Verdict.TRUE, f"{distance:.6f}"
    return Verdict.FAULT, f"called safe, comes as close as {distance:.6f} of {CLEARANCE:g}: {result.safety.equations}"
