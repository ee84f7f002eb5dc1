"""The program that an expert writes in CasADi: one element as a function, mapped over the mesh."""

from __future__ import annotations

import time

import casadi
import numpy as np

from .problem import Answer, SmoothProblem


def solved_by_casadi(problem: SmoothProblem, elements: int) -> Answer:
    """Implicit Euler, Ipopt's defaults but for the number of iterations; CasADi's own derivatives."""
    started = time.process_time()
    n, k, step = len(problem.states), len(problem.controls), problem.duration / elements
    before, after, control = casadi.SX.sym("before", n), casadi.SX.sym("after", n), casadi.SX.sym("u", k)
    rate = casadi.SX.sym("rate", n) if problem.keeps_rates else (after - before) / step
    stated = problem.rates(casadi.vertsplit(after), casadi.vertsplit(control), casadi)
    rows = [rate - casadi.vertcat(*stated)]
    if problem.keeps_rates:
        rows.append((after - before) / step - rate)
    cost = step * problem.cost(casadi.vertsplit(after), casadi.vertsplit(control))
    given = [before, after, control, *([rate] if problem.keeps_rates else [])]
    element = casadi.Function("element", given, [casadi.vertcat(*rows), cost])

    x, u = casadi.MX.sym("x", n, elements + 1), casadi.MX.sym("u", k, elements)
    rates = [casadi.MX.sym("rates", n, elements)] if problem.keeps_rates else []
    residuals, costs = element.map(elements)(x[:, :-1], x[:, 1:], u, *rates)
    program = {"x": casadi.veccat(x, u, *rates), "f": casadi.sum2(costs), "g": casadi.vec(residuals)}

    bounds = []
    for side in (0, 1):
        of_x = np.tile(np.array(problem.state_bounds)[:, [side]], (1, elements + 1))
        of_x[:, 0] = 0.0
        of_x[:, -1] = [bound if last is None else last for bound, last in zip(of_x[:, -1], problem.final, strict=True)]
        of_u = np.tile(np.array(problem.control_bounds)[:, [side]], (1, elements))
        of_rates = [np.tile(np.array(problem.rate_bounds)[:, [side]], (1, elements)) for _ in rates]
        bounds.append(np.concatenate([part.ravel(order="F") for part in (of_x, of_u, *of_rates)]))
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 3000}}
    solver = casadi.nlpsol("solver", "ipopt", program, quiet)
    found = solver(x0=0, lbx=bounds[0], ubx=bounds[1], lbg=0, ubg=0)
    ended = time.process_time()

    values = np.array(found["x"]).ravel()
    states = values[: n * (elements + 1)].reshape(elements + 1, n)
    controls = values[n * (elements + 1) :][: k * elements].reshape(elements, k)
    free = int((bounds[0] < bounds[1]).sum())
    return Answer(states, controls, int(solver.stats()["iter_count"]), free, int(program["g"].numel()), ended - started)
