"""Statements whose answers are known from mathematics: by formulas, and by SciPy's dense integration.

The law. Where a report is clean, the answer is no farther from that of mathematics than `FACTOR` times the mesh error
that its first lines name, or than `UNSAID` where they name less or none. Where they say "not known", it claims nothing.
What is stated is what rules said while the model was built, whatever became of their data afterwards.
"""

import re
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyomo.environ as pyo
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator, CubicSpline

import pyrobocop_pyomo as rcp

FACTOR = 10.0
UNSAID = 1e-3  # of the size; what is larger is a coarse mesh
SECONDS = 10.0
CLAIMED = re.compile(r"mesh error (of the motion )?(?:below )?([\d.e+-]+) %")
# What takes all errors out of what is claimed.
OPEN = re.compile(r"mesh error not known|COARSE MESH|between (the )?points")

Random = np.random.Generator


def solved_with_defaults(model: Any) -> tuple[Any, Any]:
    """As a user solves it; the result, and the model with the answer."""
    return rcp.solve(model, progress=False, time_limit=SECONDS), model


@dataclass
class Statement:
    """A model, and the truth about it.

    Attributes
    ----------
    model : ConcreteModel
    off : callable
        Of the model with the answer: how far its objective is from the truth, and how far its motion, as parts.
    minimises : bool
        Whether there is an objective beside the motion; else the error that a report names has to be the motion's.
    solve : callable
    """

    model: pyo.ConcreteModel
    off: Callable[[Any], tuple[float, float]]
    minimises: bool = True
    solve: Callable[[Any], tuple[Any, Any]] = solved_with_defaults


def claimed_errors(result: Any, minimises: bool = True) -> tuple[float, float]:
    """The mesh errors that a report names, of the objective and of the motion: infinite where it leaves that open."""
    text = str(result)
    if OPEN.search(text):
        return np.inf, np.inf
    if (found := CLAIMED.search(text)) is None:
        return 0.0, 0.0
    named = float(found[2]) / 100
    motion = result.discretisation.motion_error if minimises else None
    return np.inf if found[1] else named, max(named, motion or 0.0)


def complaint(result: Any, model: Any, statement: Statement, *, claimed: bool = True) -> str | None:
    """What is wrong with an answer by the law, or were it claimed to be right; None where nothing is."""
    claims = claimed_errors(result, statement.minimises) if claimed else (0.0, 0.0)
    for what, off, claim in zip(("objective", "motion"), statement.off(model), claims, strict=True):
        if not off <= max(UNSAID, FACTOR * claim):
            return f"{what} off by {100 * off:.3g} %"
    return None


def _objective_is(right: float) -> Callable[[Any], tuple[float, float]]:
    def off(m: Any) -> tuple[float, float]:
        (objective,) = m.component_data_objects(pyo.Objective, active=True)
        return abs(pyo.value(objective) - right) / abs(right), 0.0

    return off


def _phase(random: Random, fewest: int, most: int, **options: Any) -> tuple[Any, Any]:
    schemes = [("radau", 2), ("radau", 3), ("gauss", 2)]
    scheme, stages = schemes[random.integers(len(schemes))]
    m = pyo.ConcreteModel(name="statement")
    elements = int(random.integers(fewest, most + 1))
    m.p = rcp.PhaseBlock(**{"duration": 1.0, "elements": elements, "scheme": scheme, "stages": stages} | options)
    return m, m.p


def _effort(m: Any, b: Any, *controls: str) -> None:
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: sum(getattr(b, name)[t] ** 2 for name in controls)))


# ---------------------------------------------------------------------------------------- rules after building


def rule_whose_data_change(random: Random) -> Statement:
    """Axes from rest to rest, each with a limit of its speed that the rule finds in a variable of Python's."""
    m, b = _phase(random, 3, 6)
    limits = random.uniform(1.1, 1.45, size=random.integers(1, 4))
    way = random.choice(["loop", "value", "another model", "list"])
    here = {"limit": 0.0, "model": m}
    m.limit = pyo.Param(initialize=0.0, mutable=True)
    for i in range(len(limits)):
        for name, ends in (("x", {"final": 1}), ("v", {"final": 0}), ("u", None)):
            setattr(b, f"{name}{i}", rcp.Control() if ends is None else rcp.State(initial=0, **ends))
    axes = {n: [b.component(f"{n}{i}") for i in range(len(limits))] for n in "xvu"}
    rates = list(zip(axes["x"] + axes["v"], axes["v"] + axes["u"], strict=True))
    b.ode(lambda b, t: {x: rate[t] for x, rate in rates})
    for i, limit in enumerate(limits):
        here["limit"] = m.limit = limit
        ways = {
            "loop": lambda b, t: b.component(f"v{i}")[t] <= limit,  # noqa: B023
            "value": lambda b, t, i=i: b.component(f"v{i}")[t] <= pyo.value(m.limit),
            "another model": lambda b, t, i=i: b.component(f"v{i}")[t] <= pyo.value(here["model"].limit),
            "list": lambda b, t, i=i: b.component(f"v{i}")[t] <= here["limit"],
        }
        b.constraint(ways[str(way)], name=f"limit{i}")
    _effort(m, b, *(f"u{i}" for i in range(len(limits))))
    here["limit"] = m.limit = random.uniform(1.5, 3.0)
    here["model"] = m.clone()
    return Statement(m, _objective_is(sum(16 * v**2 / (9 * (1 - 1 / v)) for v in limits)))


def data_by_time(random: Random) -> Statement:
    """A wind is known at the points alone."""
    m, b = _phase(random, 3, 8)
    a, c, w = random.uniform(0.3, 1.0), random.uniform(-1.5, 0.3), random.uniform(2.0, 12.0)
    way = random.choice(["default", "list", "param"])
    b.x, b.u = rcp.State(initial=0, final=1), rcp.Control()
    given = {t: float(c + a * np.sin(w * t)) for t in b.points}
    times = list(given)
    m.given = pyo.Param(times, initialize=given)
    ways = {
        "default": lambda t: given.get(t, 0.0),
        "list": lambda t: given[times[min(bisect_left(times, t), len(times) - 1)]],
        "param": lambda t: m.given[t] if t in m.given else 0.0,  # noqa: SIM401
    }
    b.ode(lambda b, t: {b.x: b.u[t] + ways[str(way)](t)})
    _effort(m, b, "u")
    return Statement(m, _objective_is((1.0 - c - a * (1 - np.cos(w)) / w) ** 2))


def value_before(random: Random) -> Statement:
    """A state is read where the element starts, as a controller that samples does, or at the point before."""
    n, a, k = int(random.integers(3, 9)), random.uniform(0.2, 2.0), random.uniform(2.0, 6.0)
    fast = random.uniform(20.0, 80.0)
    m, b = _phase(random, n, n, scheme="radau", stages=3)
    b.x, b.z = rcp.State(initial=1), rcp.State(initial=1)
    samples = list(b.grid.mesh.boundaries)
    ways = [
        lambda b, t: max(s for s in b.grid.mesh.boundaries if s < t),
        lambda b, t: samples[max(bisect_left(samples, t) - 1, 0)],
        lambda b, t: samples[int(n * t * (1 - 1e-9))],
    ]
    before = ways[random.integers(len(ways))]
    b.ode(lambda b, t: {b.x: a * b.x[t] - k * b.x[before(b, t)], b.z: -fast * b.z[t] ** 2})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.z[t] ** 2))
    state, cost, h = 1.0, 1 / (1 + fast), 1 / n
    for _ in range(n):
        grown, held = state * (1 - k / a), state * k / a  # x = grown exp(a t) + held
        e = np.expm1(a * h) / a
        cost += grown**2 * np.expm1(2 * a * h) / (2 * a) + 2 * grown * held * e + held**2 * h
        state = grown * np.exp(a * h) + held
    return Statement(m, _objective_is(float(cost)))


# ---------------------------------------------------------------------------------------- between the points


def waypoint_between_points(random: Random) -> Statement:
    """A place at a time that is no boundary of an element, as a row or as a cost: broken lines, or a clamped spline."""
    m, b = _phase(random, 2, 8)
    time, place, weight = random.uniform(0.1, 0.9), random.uniform(-0.5, 1.5), 10.0 ** random.uniform(1, 4)
    with_speed = random.random() < 0.5
    b.x, b.u = rcp.State(initial=0, final=1), rcp.Control()
    if with_speed:
        b.v = rcp.State(initial=0, final=0)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]} if with_speed else {b.x: b.u[t]})
    effort = b.integral(lambda b, t: b.u[t] ** 2)

    def bent(through: float) -> float:
        if not with_speed:
            return through**2 / time + (1 - through) ** 2 / (1 - time)
        second = CubicSpline([0, time, 1], [0, through, 1], bc_type=((1, 0.0), (1, 0.0)))([0, time, 1], 2)
        first, last = second[:-1], second[1:]
        return float(np.sum(np.array([time, 1 - time]) / 3 * (first**2 + first * last + last**2)))

    if random.random() < 0.5:
        m.pass_by = pyo.Constraint(expr=b.x.at(time) == place)
        m.cost = pyo.Objective(expr=effort)
        return Statement(m, _objective_is(bent(place)))
    m.cost = pyo.Objective(expr=effort + weight * (b.x.at(time) - place) ** 2)
    tried = np.array([0.0, 0.5, 1.0])
    of = np.polynomial.Polynomial.fit(tried, [bent(x) + weight * (x - place) ** 2 for x in tried], 2)
    return Statement(m, _objective_is(float(of(of.deriv().roots()[0]))))


def window_in_time(random: Random) -> Statement:
    """A wind blows, or a control is limited, for a while that no boundary of an element shows."""
    way = random.choice(["wind", "skipped", "bounds"])
    m, b = _phase(random, 3, 10)
    width = 10.0 ** (random.uniform(-2.8, -1.2) if way == "wind" else random.uniform(-1.3, -0.4))
    start, limit = random.uniform(0.05, 0.95 - width), random.uniform(0.1, 0.7)
    within = lambda t: start < t < start + width  # noqa: E731
    b.x = rcp.State(initial=0, final=1)
    b.u = rcp.Control(bounds=(lambda t: (None, limit if within(t) else None)) if way == "bounds" else None)
    if way == "wind":
        b.ode(lambda b, t: {b.x: b.u[t] + (limit / width if within(t) else 0.0)})
    else:
        b.ode(lambda b, t: {b.x: b.u[t]})
    if way == "skipped":
        b.constraint(lambda b, t: b.u[t] <= limit if within(t) else pyo.Constraint.Skip, name="limit")
    _effort(m, b, "u")
    limited = limit**2 * width + (1 - limit * width) ** 2 / (1 - width)
    return Statement(m, _objective_is((1 - limit) ** 2 if way == "wind" else limited))


def bounds_of_a_free_duration(random: Random) -> Statement:
    """The largest speed changes at a time, and how long the way takes is free."""
    later, way = random.uniform(0.5, 3.0), random.uniform(4.0, 8.0)
    m, b = _phase(random, 3, 10, duration=rcp.Duration(bounds=(0.5, 20.0), initial_guess=4.0))
    b.x = rcp.State(initial=0, final=way)
    b.u = rcp.Control(bounds=lambda t: (0, 1 if t < later else 2), initial_guess=1)
    b.ode(lambda b, t: {b.x: b.u[t]})
    m.cost = pyo.Objective(expr=b.duration)
    return Statement(m, _objective_is((way + later) / 2))


def thin_obstacle_in_a_rule(random: Random) -> Statement:
    """A disc that a path constraint forbids, thinner than the points are apart."""
    m, b = _phase(random, 3, 8)
    radius, at = 10.0 ** random.uniform(-2, -1), random.uniform(0.2, 0.8)
    aside = radius * random.uniform(-0.5, 0.5)
    b.x, b.y = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u, b.w = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.w[t]})
    b.constraint(lambda b, t: (b.x[t] - at) ** 2 + (b.y[t] - aside) ** 2 >= radius**2, name="outside")
    _effort(m, b, "u", "w")
    b.initialize_straight_lines()

    def off(m: Any) -> tuple[float, float]:
        grid, closest = m.p.grid, np.inf
        for i, stages in enumerate(grid.stage_times):
            low, high = grid.mesh.boundaries[i], grid.mesh.boundaries[i + 1]
            nodes = sorted({low, *stages})
            of = [BarycentricInterpolator(nodes, [s[t].value for t in nodes]) for s in (m.p.x, m.p.y)]
            x, y = (polynomial(np.linspace(low, high, 400)) for polynomial in of)
            closest = min(closest, float(np.hypot(x - at, y - aside).min()))
        return 0.0, max(0.0, 0.8 - closest / radius)  # a corner may be cut

    return Statement(m, off)


# ---------------------------------------------------------------------------------------- the motion


def _decay(random: Random) -> tuple[float, Callable[[float], float], Callable[[Any], Any]]:
    """How fast, the motion by SciPy, and the right-hand side: fast at first, then slow."""
    k, p = random.uniform(5.0, 40.0), int(random.integers(2, 4))
    motion = solve_ivp(lambda t, x: -k * x**p, (0, 1), [1.0], "Radau", rtol=1e-9, atol=1e-12, dense_output=True).sol
    return k, lambda t: float(motion(t)[0]), lambda x: -k * x**p


def _motion_is(right: Callable[[float], float]) -> Callable[[Any], tuple[float, float]]:
    return lambda m: (0.0, max(abs(m.p.x[t].value - right(t)) for t in m.p.grid.mesh.boundaries))


def nothing_to_minimise(random: Random) -> Statement:
    """A motion without an objective, or with one that does not depend on it."""
    m, b = _phase(random, 2, 6)
    _, right, rate = _decay(random)
    b.x = rcp.State(initial=1)
    b.ode(lambda b, t: {b.x: rate(b.x[t])})
    way = random.choice(["none", "constant", "fixed"])
    m.weight = pyo.Var(initialize=2.0)
    m.weight.fix()
    if way != "none":
        m.cost = pyo.Objective(expr=1.0 if way == "constant" else m.weight**2)
    return Statement(m, _motion_is(right), minimises=False)


def quantity_between(random: Random) -> Statement:
    """Between what moves and why stands a quantity that the plan holds, or a pair that is never active."""
    way, refined = random.choice(["algebraic", "control", "pair", "both"]), random.random() < 0.3
    _, right, rate = _decay(random)
    weight = random.uniform(0.0, 1.0)
    m, b = _phase(random, 2, 6)
    b.x = rcp.State(initial=1)
    if way in ("pair", "both"):
        b.push = rcp.Algebraic(bounds=(0, None), initial_guess=0)
        b.complementarity(lambda b, t: rcp.complements(b.push[t] >= 0, b.x[t] + 3 >= 0))
    push = lambda b, t: b.push[t] if way in ("pair", "both") else 0.0  # noqa: E731
    if way == "pair":
        b.ode(lambda b, t: {b.x: rate(b.x[t]) + push(b, t)})
    else:
        b.w = rcp.Control(initial_guess=-1) if way == "control" else rcp.Algebraic(initial_guess=-1)
        b.ode(lambda b, t: {b.x: b.w[t] + push(b, t)})
        (b.constraint if way == "control" else b.residual)(lambda b, t: b.w[t] == rate(b.x[t]))
    m.cost = pyo.Objective(expr=b.x.at_end + weight * b.integral(lambda b, t: b.x[t] ** 2))

    def off(m: Any) -> tuple[float, float]:
        square = solve_ivp(lambda t, s: [right(t) ** 2], (0, 1), [0.0], rtol=1e-9, atol=1e-11, max_step=0.01).y[0, -1]
        return _objective_is(right(1.0) + weight * float(square))(m)[0], _motion_is(right)(m)[1]

    def solve_refined(m: Any) -> tuple[Any, Any]:
        return rcp.solve(m, mesh_tolerance=1e-6, progress=False, time_limit=SECONDS), m

    return Statement(m, off, solve=solve_refined if refined else solved_with_defaults)


def discretised_by_pyomo(random: Random) -> Statement:
    """A model of pyomo.dae on a coarse mesh: the least effort that reaches one."""
    a, n = random.uniform(0.3, 6.0), int(random.integers(2, 13))
    m = pyo.ConcreteModel(name="statement")
    m.t = ContinuousSet(bounds=(0, 1))
    m.x, m.u = pyo.Var(m.t, initialize=0.5), pyo.Var(m.t, initialize=1.0)
    m.dx = DerivativeVar(m.x, wrt=m.t)
    m.flow = pyo.Constraint(m.t, rule=lambda m, t: m.dx[t] == m.u[t] - a * m.x[t])
    m.effort = Integral(m.t, wrt=m.t, rule=lambda m, t: m.u[t] ** 2)
    m.cost = pyo.Objective(expr=m.effort)
    if random.random() < 0.5:
        ways = [("dae", "LAGRANGE-RADAU"), ("dae", "LAGRANGE-LEGENDRE"), ("pyrobocop", "LAGRANGE-RADAU")]
        by, scheme = ways[random.integers(3)]
        name, options = f"{by}.collocation", {"ncp": int(random.integers(1, 4))}
    else:
        name, scheme, options = "dae.finite_difference", str(random.choice(["BACKWARD", "FORWARD", "CENTRAL"])), {}
    pyo.TransformationFactory(name).apply_to(m, wrt=m.t, nfe=n, scheme=scheme, **options)
    m.x[0].fix(0), m.x[1].fix(1)
    return Statement(m, _objective_is(2 * a / (1 - np.exp(-2 * a))))


STATEMENTS: dict[str, Callable[[Random], Statement]] = {
    statement.__name__: statement
    for statement in (
        rule_whose_data_change, data_by_time, value_before, waypoint_between_points, window_in_time,
        bounds_of_a_free_duration, thin_obstacle_in_a_rule, nothing_to_minimise, quantity_between, discretised_by_pyomo,
    )
}  # fmt: skip
