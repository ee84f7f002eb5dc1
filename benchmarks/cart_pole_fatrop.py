"""The cart-pole of ``cart_pole_ways.py``, written for fatrop: stage after stage, as multiple shooting orders it.

The state at the start of an element is the state of a stage; the values at the points within the element and the
forces are its controls. The next state equals the last of these values, and the equations of collocation are equalities
of the stage. The program is that of the other ways, with one copy of each state.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi
import numpy as np
from cart_pole_ways import BOUNDS, FORCE, GOAL, HORIZON, STAGES, START, rates, running_cost, straight_line

import pyrobocop_pyomo as rcp


@dataclass(frozen=True)
class FatropRun:
    """What fatrop tells of one run; seconds of CPU.

    Attributes
    ----------
    inside : float
        In the solver, functions included.
    evaluation : float
        In functions.
    """

    objective: float
    iterations: int
    success: bool
    inside: float
    evaluation: float


def by_fatrop(elements: int) -> FatropRun:
    """Solve by ``nlpsol`` with fatrop, which finds the stages itself."""
    scheme, h = rcp.schemes.radau(STAGES), HORIZON / elements
    first, stages, forces = casadi.SX.sym("first", 4), casadi.SX.sym("x", 4, STAGES), casadi.SX.sym("u", STAGES)
    slopes = casadi.mtimes(casadi.horzcat(first, stages), casadi.DM(scheme.D.T)) / h
    residuals, cost = [], 0
    for k in range(STAGES):
        position, theta, velocity, omega = (stages[i, k] for i in range(4))
        answer = rates(theta, velocity, omega, forces[k], casadi.sin, casadi.cos)
        residuals.append(slopes[:, k] - casadi.vertcat(*answer))
        cost += h * scheme.b[k] * running_cost(position, theta, velocity, omega, forces[k])
    element = casadi.Function("element", [first, stages, forces], [casadi.vertcat(*residuals), cost])
    lower, upper = np.array(BOUNDS).T
    unknowns, rows, start, low, high = [], [], [], [], []
    objective: casadi.MX = 0
    state = casadi.MX.sym("x0", 4)
    for k in range(elements):
        points, pushes = casadi.MX.sym(f"s{k}", 4, STAGES), casadi.MX.sym(f"u{k}", STAGES)
        after = casadi.MX.sym(f"x{k + 1}", 4)
        residual, part = element(state, points, pushes)
        objective += part
        unknowns += [state, casadi.vec(points), pushes]
        rows += [after - points[:, -1]]  # the step to the next stage comes before the equations of this one
        rows += [state - casadi.DM(START)] if k == 0 else []
        rows += [residual]
        times = [k * h, *(k * h + h * scheme.c)]
        start += [np.array([[straight_line(i, t) for i in range(4)] for t in times]).ravel(), np.zeros(STAGES)]
        # Ends of elements are bounded once, as points; a copy with bounds of its own would be another program.
        inner = STAGES - 1 if k == elements - 1 else STAGES
        free = np.full(4 * (STAGES - inner), np.inf)
        low += [np.full(4, -np.inf), np.tile(lower, inner), -free, np.full(STAGES, FORCE[0])]
        high += [np.full(4, np.inf), np.tile(upper, inner), free, np.full(STAGES, FORCE[1])]
        state = after
    unknowns, rows = [*unknowns, state], [*rows, state - casadi.DM(GOAL)]
    start, low, high = [*start, np.array(GOAL)], [*low, np.full(4, -np.inf)], [*high, np.full(4, np.inf)]
    g = casadi.vertcat(*rows)
    options = {
        "structure_detection": "auto", "equality": [True] * g.numel(), "print_time": False, "error_on_fail": False,
        "record_time": True, "fatrop": {"print_level": 0, "max_iter": 3000},
    }  # fmt: skip
    solver = casadi.nlpsol("solver", "fatrop", {"x": casadi.vertcat(*unknowns), "f": objective, "g": g}, options)
    x0, lbx, ubx = (np.concatenate(values) for values in (start, low, high))
    started = time.process_time()
    answer = solver(x0=x0, lbx=lbx, ubx=ubx, lbg=0, ubg=0)
    inside = time.process_time() - started
    found = solver.stats()
    evaluation = sum(value for name, value in found.items() if name.startswith("t_proc_nlp_"))
    return FatropRun(
        float(answer["f"]), int(found["iter_count"]), bool(found["success"]), inside, evaluation,
    )  # fmt: skip
