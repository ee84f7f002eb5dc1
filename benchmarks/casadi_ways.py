"""Programs that an expert writes by hand in CasADi for contact, a quadrotor and a parking car.

All take implicit Euler: one element as a function, mapped over the mesh, with CasADi's own derivatives, from the same
initial guess as the phase. The contact problem is ``examples/cart_pole_soft_walls.py``: each product of a pair is
bounded by delta, which goes from 1 to 1e-9 in powers of ten, each solve warm-started from the one before. The quadrotor
is ``examples/quadrotor.py``. Parking is a car that backs into a slot; weights of the facets of car and neighbours keep
them apart at the nodes, by the dual of their distance (Zhang, Liniger & Borrelli, arXiv:1711.03449). Its phase is
here, with the same weights and rows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import Any, NamedTuple

import casadi
import numpy as np
import pyomo.environ as pyo
from smooth_problems import QUADROTOR as FLIGHT

import pyrobocop_pyomo as rcp

sys.path.append(str(Path(__file__).parent.parent / "examples"))  # examples are scripts, not a package
from cart_pole_soft_walls import LENGTH, NOMINAL, WALL, linear_accelerations  # isort: skip

Bounds = tuple[float, float]
Row = tuple[float, Any, float]

# A start that is nearly a solution: values and multipliers stay near what they are. By default Ipopt relaxes bounds by
# 1e-8, which is more than the last delta.
WARM = {
    "bound_relax_factor": 0.0,
    "warm_start_init_point": "yes",
    "mu_init": 1e-5,
    "warm_start_bound_push": 1e-7,
    "warm_start_slack_bound_push": 1e-7,
    "warm_start_mult_bound_push": 1e-7,
}


class Ended(NamedTuple):
    """What a way tells of its answer; iterations are of all solves together, elements where it chose them itself."""

    objective: float
    iterations: int
    elements: int | None = None


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A problem as its program by hand needs it.

    Attributes
    ----------
    duration : float
        Seconds.
    initial : tuple of float
    final : tuple of float or None
        States at the end; None where they are free.
    state_bounds, control_bounds : tuple of (lower, upper)
        Forces of contact and weights of facets are controls here: all have one value per element.
    rates : callable
        ``rates(x, u, f)`` gives the derivatives of the states, with sine and cosine of the namespace ``f``.
    cost : callable
        ``cost(x, u)`` per second.
    rows : callable
        ``rows(x, u, delta, f)`` gives all other constraints as (lower, body, upper).
    state_guess : callable
        States at a part of the duration, from 0 to 1.
    control_guess : tuple of float
        The same in all elements.
    deltas : tuple of float
        One solve for each.
    """

    duration: float
    initial: tuple[float, ...]
    final: tuple[float, ...] | None
    state_bounds: tuple[Bounds, ...]
    control_bounds: tuple[Bounds, ...]
    rates: Callable[[Any, Any, Any], Sequence[Any]]
    cost: Callable[[Any, Any], Any]
    rows: Callable[[Any, Any, Any, Any], Sequence[Row]] = lambda x, u, delta, f: ()
    state_guess: Callable[[float], Sequence[float]]
    control_guess: tuple[float, ...]
    deltas: tuple[float, ...] = (0.0,)


def by_hand(elements: int, problem: Stated, options: dict[str, object] | None = None) -> Ended:
    """State the program and solve it, once for each delta; raises where Ipopt does."""
    n, k, step = len(problem.initial), len(problem.control_bounds), problem.duration / elements
    before, after, control, relaxed = (casadi.SX.sym(f"v{size}", size) for size in (n, n, k, 1))
    states, controls = casadi.vertsplit(after), casadi.vertsplit(control)
    slopes = casadi.vertsplit((after - before) / step)
    rates = problem.rates(states, controls, casadi)
    euler = [(0.0, slope - rate, 0.0) for slope, rate in zip(slopes, rates, strict=True)]
    lower, bodies, upper = zip(*euler, *problem.rows(states, controls, relaxed, casadi), strict=True)
    outputs = [casadi.vertcat(*bodies), step * problem.cost(states, controls)]
    element = casadi.Function("element", [before, after, control, relaxed], outputs)

    x, u, delta = casadi.MX.sym("x", n, elements + 1), casadi.MX.sym("u", k, elements), casadi.MX.sym("delta")
    rows, costs = element.map(elements)(x[:, :-1], x[:, 1:], u, casadi.repmat(delta, 1, elements))
    program = {"x": casadi.veccat(x, u), "p": delta, "f": casadi.sum2(costs), "g": casadi.vec(rows)}
    limits = {"lbg": np.tile(lower, elements), "ubg": np.tile(upper, elements)}
    for side, name in enumerate(("lbx", "ubx")):
        of_states, of_controls = (
            np.tile(np.array(bounds)[:, side], (count, 1))
            for bounds, count in ((problem.state_bounds, elements + 1), (problem.control_bounds, elements))
        )
        of_states[0] = problem.initial
        of_states[-1] = of_states[-1] if problem.final is None else problem.final
        limits[name] = np.concatenate([of_states.ravel(), of_controls.ravel()])
    guesses = [problem.state_guess(i / elements) for i in range(elements + 1)]
    start = {"x0": np.concatenate([np.ravel(guesses), np.tile(problem.control_guess, elements)])}

    told, iterations = {"print_level": 0, "sb": "yes", "max_iter": 3000, **(options or {})}, 0
    solver = casadi.nlpsol("cold", "ipopt", program, {"print_time": False, "ipopt": told})
    for count, number in enumerate(problem.deltas):
        if count == 1:
            solver = casadi.nlpsol("warm", "ipopt", program, {"print_time": False, "ipopt": {**told, **WARM}})
        found = solver(p=number, **start, **limits)
        if not solver.stats()["success"]:
            raise RuntimeError(f"CasADi by hand: {solver.stats()['return_status']}")
        iterations += int(solver.stats()["iter_count"])
        start = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
    return Ended(float(found["f"]), iterations)


QUADROTOR = Stated(
    duration=FLIGHT.duration,
    initial=(0.0,) * 12,
    final=FLIGHT.final,
    state_bounds=FLIGHT.state_bounds,
    control_bounds=FLIGHT.control_bounds,
    rates=FLIGHT.rates,
    cost=FLIGHT.cost,
    state_guess=lambda part: (0.0,) * 12,
    control_guess=(0.0,) * 4,
)


# ---------------------------------------------------------------- contact


def wall_rows(x: Any, u: Any, delta: Any, f: Any) -> list[Row]:
    """A wall has a force only where it is pressed in, by the force over its stiffness."""
    tip = x[0] - LENGTH * x[1]
    gaps = WALL - tip + u[1] / NOMINAL["right_stiffness"], WALL + tip + u[2] / NOMINAL["left_stiffness"]
    products = [force * gap for force, gap in zip(u[1:], gaps, strict=True)]
    return [*((0.0, gap, inf) for gap in gaps), *((-inf, product - delta, 0.0) for product in products)]


KICKED = (0.0, 0.0, 0.0, 2.0)
CONTACT = Stated(
    duration=2.0,
    initial=KICKED,
    final=None,
    state_bounds=((-inf, inf),) * 4,
    control_bounds=((-1.0, 1.0), (0.0, inf), (0.0, inf)),
    rates=lambda x, u, f: (x[2], x[3], *linear_accelerations(x[1], x[3], u[0], u[2] - u[1], NOMINAL["pole_mass"])),
    cost=lambda x, u: 10 * x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2 + u[0] ** 2,
    rows=wall_rows,
    state_guess=lambda part: KICKED,
    control_guess=(0.0,) * 3,
    deltas=tuple(10.0**-power for power in range(10)),
)


# ---------------------------------------------------------------- parking

WHEELBASE, CLEARANCE = 2.7, 0.05
# Normals and offsets of the facets of the car, seen from the middle of its rear axle, and of its neighbours, which
# never end on three sides.
CAR = (((1, 0), (0, 1), (-1, 0), (0, -1)), (3.7, 1.0, 1.0, 1.0))
NEIGHBOURS = ((((1, 0), (0, 1)), (-1.3, 5.0)), (((-1, 0), (0, 1)), (-1.3, 5.0)))
# Past the slot and back into it: x, y, heading and speed; it starts and ends at rest.
WAY = ((-6.0, 9.5, 0.0, 1.0), (5.0, 8.5, 0.6, 0.0), (0.0, 1.3, pi / 2, -1.0))


def bicycle(x: Any, u: Any, f: Any) -> tuple[Any, ...]:
    """Rates of the middle of the rear axle, of heading and speed."""
    return x[3] * f.cos(x[2]), x[3] * f.sin(x[2]), x[3] * f.tan(u[1]) / WHEELBASE, u[0]


def effort(x: Any, u: Any) -> Any:
    """Of motor and steering, and a little for speed."""
    return u[0] ** 2 + u[1] ** 2 + 0.1 * x[3] ** 2


def separation_rows(x: Any, u: Any, delta: Any, f: Any) -> list[Row]:
    """For each neighbour a direction along which the car lies ahead of it, by the clearance at least."""
    cos, sin = f.cos(x[2]), f.sin(x[2])
    rows: list[Row] = []
    for place, neighbour in enumerate(NEIGHBOURS):
        weights = u[2 + 6 * place : 8 + 6 * place]
        (a, b, behind), (c, d, ahead) = combined(neighbour, weights[:2]), combined(CAR, weights[2:])
        rows += [
            (0.0, c + cos * a + sin * b, 0.0),
            (0.0, d + cos * b - sin * a, 0.0),
            (CLEARANCE, a * x[0] + b * x[1] - behind - ahead, inf),
            (-inf, a**2 + b**2, 1.0),
        ]
    return rows


def combined(shape: tuple[Any, Any], weights: Sequence[Any]) -> tuple[Any, ...]:
    """Sums of the normals of facets, by axis, and of their offsets."""
    normals, offsets = shape
    columns = (*zip(*normals, strict=True), offsets)
    return tuple(sum(a * w for a, w in zip(column, weights, strict=True) if a) for column in columns)


def on_the_way(part: float) -> tuple[float, ...]:
    """Two straight lines."""
    leg = min(int(2 * part), 1)
    return tuple(first + (2 * part - leg) * (last - first) for first, last in zip(WAY[leg], WAY[leg + 1], strict=True))


PARKING = Stated(
    duration=25.0,
    initial=(*WAY[0][:3], 0.0),
    final=(*WAY[-1][:3], 0.0),
    state_bounds=((-15.0, 15.0), (1.0, 10.0), (-pi, pi), (-1.0, 2.0)),
    control_bounds=((-0.4, 0.4), (-0.6, 0.6), *((0.0, inf),) * 12),
    rates=bicycle,
    cost=effort,
    rows=separation_rows,
    state_guess=on_the_way,
    control_guess=(0.0, 0.0, *(0.1,) * 12),
)


def parking_as_phase(elements: int) -> pyo.ConcreteModel:
    """The same rows, of the states and controls of a phase."""
    m, p = pyo.ConcreteModel(name="parking"), PARKING
    m.drive = b = rcp.PhaseBlock(duration=p.duration, elements=elements, scheme="implicit_euler")
    b.x = rcp.State(
        index=4,
        initial=p.initial,
        final=p.final,
        bounds=tuple(zip(*p.state_bounds, strict=True)),
        initial_guess=lambda t: on_the_way(t / p.duration),
    )
    b.u = rcp.Control(index=14, bounds=tuple(zip(*p.control_bounds, strict=True)), initial_guess=p.control_guess)
    b.ode(lambda b, t: {b.x: bicycle(b.x[t], b.u[t], pyo)})
    b.constraint(lambda b, t: separation_rows(b.x[t], b.u[t], 0.0, pyo), name="apart")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: effort(b.x[t], b.u[t])))
    return m
