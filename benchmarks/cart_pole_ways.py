"""The same cart-pole swing-up stated in three ways: as a phase, with pyomo.dae, and by hand in CasADi.

Each way makes the same nonlinear program: collocation at Radau points, the cost by their quadrature weights, the
same straight line as an initial guess, and one solve from there. ``pyomo.dae`` keeps derivatives as variables; the
others substitute them, unless asked.
"""

from __future__ import annotations

import io
import re
import tempfile
import time
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pyomo.dae as dae
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable

CART, POLE, LENGTH, GRAVITY, HORIZON, STAGES = 1.0, 1.0, 0.75, 9.8, 3.3, 3
STATES = ("position", "theta", "velocity", "omega")
START = (3.0, 0.0, 0.0, 0.0)
GOAL = (0.5, pi, 0.0, 0.0)
BOUNDS = ((-5.0, 5.0), (-2 * pi, 2 * pi), (-10.0, 10.0), (-10.0, 10.0))
FORCE = (-20.0, 20.0)
# The other ways have no other mesh and no other starts either.
ALONE: dict[str, Any] = {"mesh_tolerance": None, "strategies": rcp.Strategy(exploration=0)}


@dataclass(frozen=True)
class Measured:
    """Seconds of one run, and what came out.

    Attributes
    ----------
    build : float
        From nothing to the stated model.
    transcribe : float or None
        To the discrete model; None where the statement is discrete already.
    hand_off : float
        All that is neither of the others: writing, loading, starting, reading back.
    solve : float
        Within Ipopt, derivatives included.
    check : float
        Recomputing the residuals of the answer, which only `rcp.solve` does.
    """

    build: float
    transcribe: float | None
    hand_off: float
    solve: float
    objective: float
    iterations: int
    variables: int
    check: float = 0.0

    @property
    def total(self) -> float:
        """Seconds from nothing to the solution."""
        return self.build + (self.transcribe or 0.0) + self.hand_off + self.solve + self.check

    def or_faster(self, other: Measured) -> Measured:
        """The smallest seconds of two runs, each for itself."""
        return replace(
            self,
            build=min(self.build, other.build),
            transcribe=None if self.transcribe is None else min(self.transcribe, other.transcribe or 0.0),
            hand_off=min(self.hand_off, other.hand_off),
            solve=min(self.solve, other.solve),
            check=min(self.check, other.check),
        )


def rates(theta, velocity, omega, force, sin, cos):
    """Right-hand side, by anybody's sine and cosine."""
    s, c = sin(theta), cos(theta)
    moving = CART + POLE * s**2
    cart = (force + POLE * s * (LENGTH * omega**2 + GRAVITY * c)) / moving
    pole = (-force * c - POLE * LENGTH * omega**2 * c * s - (CART + POLE) * GRAVITY * s) / (LENGTH * moving)
    return velocity, omega, cart, pole


def running_cost(position, theta, velocity, omega, force):
    """Cost per second."""
    return (theta - pi) ** 2 + 0.1 * (velocity**2 + omega**2 + (position - GOAL[0]) ** 2) + 0.01 * force**2


def straight_line(i: int, t: float) -> float:
    """Guess of state i."""
    return START[i] + (GOAL[i] - START[i]) * t / HORIZON


def stated_as_phase(elements: int, keep_derivatives: bool = False) -> pyo.ConcreteModel:
    """The model as this package has it."""
    m = pyo.ConcreteModel(name="cart-pole")
    m.swing = b = rcp.PhaseBlock(duration=HORIZON, elements=elements, stages=STAGES)
    for i, name in enumerate(STATES):
        line = rcp.State(
            initial=START[i], final=GOAL[i], bounds=BOUNDS[i], initial_guess=lambda t, i=i: straight_line(i, t)
        )
        b.declare(name, line)
        if keep_derivatives:
            b.derivative(name)  # asked for before any equation gives it, it becomes a variable
    b.force = rcp.Control(bounds=FORCE)

    @b.ode
    def cart_pole(b, t):
        answer = rates(b.theta[t], b.velocity[t], b.omega[t], b.force[t], pyo.sin, pyo.cos)
        return dict(zip((b.position, b.theta, b.velocity, b.omega), answer, strict=True))

    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: running_cost(b.position[t], b.theta[t], b.velocity[t], b.omega[t], b.force[t]))
    )
    return m


def as_phase(
    elements: int, backend: str, keep_derivatives: bool = False, options: dict[str, object] | None = None
) -> Measured:
    """This package; with derivatives kept as variables it makes the program of pyomo.dae, row by row."""
    started = time.perf_counter()
    m = stated_as_phase(elements, keep_derivatives)
    built = time.perf_counter()
    if backend == "executable":
        log = io.StringIO()
        with redirect_stdout(log):  # Ipopt's log tells how long Ipopt itself took
            result = rcp.solve(m, backend=backend, tee=True, progress=False, **ALONE)
        inside = _seconds_in_ipopt(log.getvalue())
    else:
        result = rcp.solve(m, backend=backend, progress=False, options=options, **ALONE)
        inside = sum(step.seconds for step in result.steps)
    ended = time.perf_counter()
    free = sum(not v.fixed for v in m.component_data_objects(pyo.Var))
    check = result.checking_seconds
    hand_off = ended - built - inside - check
    return Measured(built - started, None, hand_off, inside, result.objective, result.iterations, free, check)


def stated_with_pyomo_dae() -> pyo.ConcreteModel:
    """The model over a ContinuousSet."""
    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(bounds=(0, HORIZON))
    for i, name in enumerate(STATES):
        m.add_component(name, pyo.Var(m.t, bounds=BOUNDS[i]))
        m.add_component(f"d{name}", dae.DerivativeVar(m.component(name), wrt=m.t))
        m.component(name)[0].fix(START[i])
        m.component(name)[HORIZON].fix(GOAL[i])
    m.force = pyo.Var(m.t, bounds=FORCE)

    @m.Constraint(m.t, range(4))
    def dynamics(m, t, i):
        if t == 0:
            return pyo.Constraint.Skip  # collocation needs no derivative there
        answer = rates(m.theta[t], m.velocity[t], m.omega[t], m.force[t], pyo.sin, pyo.cos)
        return m.component(f"d{STATES[i]}")[t] == answer[i]

    return m


def transcribed_by_pyomo_dae(
    m: pyo.ConcreteModel, elements: int, transformation: str = "dae.collocation"
) -> pyo.ConcreteModel:
    """The same model after ``dae.collocation``, or the transformation of this package, with cost and initial guess."""
    pyo.TransformationFactory(transformation).apply_to(m, wrt=m.t, nfe=elements, ncp=STAGES, scheme="LAGRANGE-RADAU")
    weights = rcp.schemes.radau(STAGES).b
    points = [t for t in m.t if t > 0]
    # pyomo.dae's own Integral is the trapezoid rule; the scheme's quadrature makes the problems the same.
    m.cost = pyo.Objective(
        expr=sum(
            HORIZON
            / elements
            * weights[k % STAGES]
            * running_cost(m.position[t], m.theta[t], m.velocity[t], m.omega[t], m.force[t])
            for k, t in enumerate(points)
        )
    )
    for t in m.t:
        for i, name in enumerate(STATES):
            variable = m.component(name)[t]
            if not variable.fixed:
                variable.set_value(straight_line(i, t))
            derivative = m.component(f"d{name}")
            if derivative.ctype is pyo.Var:  # substituted, it is an expression
                derivative[t].set_value((GOAL[i] - START[i]) / HORIZON)
        if not m.force[t].fixed:  # here there is no control at t = 0
            m.force[t].set_value(0.0)
    return m


def by_pyomo_dae(elements: int, options: dict[str, object] | None = None) -> Measured:
    """``pyomo.dae``, ``dae.collocation`` and the ipopt executable."""
    started = time.perf_counter()
    m = stated_with_pyomo_dae()
    built = time.perf_counter()
    transcribed_by_pyomo_dae(m, elements)
    transcribed = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        log_file = Path(folder) / "ipopt.log"
        solver = pyo.SolverFactory("ipopt", executable=find_ipopt_executable())
        # "OF_" has Pyomo write a file of options: Ipopt's command line knows only some of them.
        solver.options.update({"max_iter": 3000, **{f"OF_{name}": value for name, value in (options or {}).items()}})
        solver.solve(m, logfile=str(log_file))
        ended = time.perf_counter()
        log = log_file.read_text()
    inside = _seconds_in_ipopt(log)
    iterations = int(re.search(r"Number of Iterations\.*: (\d+)", log).group(1))
    variables = int(re.search(r"Total number of variables\.*: +(\d+)", log).group(1))
    return Measured(
        built - started,
        transcribed - built,
        ended - transcribed - inside,
        inside,
        pyo.value(m.cost),
        iterations,
        variables,
    )


def by_hand_in_casadi(elements: int, options: dict[str, object] | None = None) -> Measured:
    """The program that an expert writes: one element as a function, vectorised over the mesh."""
    started = time.perf_counter()
    scheme, h = rcp.schemes.radau(STAGES), HORIZON / elements
    first, stages, forces = casadi.SX.sym("first", 4), casadi.SX.sym("x", 4, STAGES), casadi.SX.sym("u", 1, STAGES)
    slopes = casadi.mtimes(casadi.horzcat(first, stages), casadi.DM(scheme.D.T)) / h
    residuals, cost = [], 0
    for k in range(STAGES):
        position, theta, velocity, omega = (stages[i, k] for i in range(4))
        answer = rates(theta, velocity, omega, forces[k], casadi.sin, casadi.cos)
        residuals.append(slopes[:, k] - casadi.vertcat(*answer))
        cost += h * scheme.b[k] * running_cost(position, theta, velocity, omega, forces[k])
    element = casadi.Function("element", [first, stages, forces], [casadi.vertcat(*residuals), cost])
    columns = elements * STAGES
    x, u = casadi.MX.sym("x", 4, columns + 1), casadi.MX.sym("u", 1, columns)
    # Radau elements end in their last stage, which is where the next one starts.
    rows, costs = element.map(elements)(x[:, 0:columns:STAGES], x[:, 1:], u)
    program = {"x": casadi.veccat(x, u), "f": casadi.sum2(costs), "g": casadi.vec(rows)}
    lower, upper = (np.tile(np.array(BOUNDS)[:, [side]], (1, columns + 1)) for side in (0, 1))
    for bound in (lower, upper):
        bound[:, 0], bound[:, -1] = START, GOAL
    lower, upper = (
        np.concatenate([bound.ravel(order="F"), np.full(columns, FORCE[side])])
        for side, bound in enumerate((lower, upper))
    )
    times = (np.arange(elements)[:, None] * h + h * scheme.c).ravel()
    line = np.array([[straight_line(i, t) for t in (0.0, *times)] for i in range(4)])
    start = np.concatenate([line.ravel(order="F"), np.zeros(columns)])
    built = time.perf_counter()
    ipopt = {"print_level": 0, "sb": "yes", "max_iter": 3000, **(options or {})}
    solver = casadi.nlpsol("solver", "ipopt", program, {"print_time": False, "ipopt": ipopt})
    ready = time.perf_counter()
    answer = solver(x0=start, lbx=lower, ubx=upper, lbg=0, ubg=0)
    ended = time.perf_counter()
    return Measured(
        built - started,
        None,
        ready - built,
        ended - ready,
        float(answer["f"]),
        int(solver.stats()["iter_count"]),
        int((lower < upper).sum()),
    )


def _seconds_in_ipopt(log: str) -> float:
    found = re.findall(r"Total (?:CPU secs|seconds) in (?:IPOPT|NLP function evaluations).*= +([\d.]+)", log)
    return sum(map(float, found))
