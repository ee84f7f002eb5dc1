"""The model as users of pyomo.dae write it: a ContinuousSet, DerivativeVars, and the ipopt executable."""

from __future__ import annotations

import math
import os
import re
import tempfile
from pathlib import Path

import numpy as np
import pyomo.dae as dae
import pyomo.environ as pyo

from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable

from .problem import Answer, SmoothProblem


def solved_by_pyomo_dae(problem: SmoothProblem, elements: int) -> Answer:
    """Implicit Euler is ``dae.finite_difference`` with the scheme BACKWARD."""
    started = _cpu_seconds()
    m = pyo.ConcreteModel(name=problem.name)
    m.t = dae.ContinuousSet(bounds=(0, problem.duration))
    states = [_variable(m, name, bounds) for name, bounds in zip(problem.states, problem.state_bounds, strict=True)]
    controls = [
        _variable(m, name, bounds) for name, bounds in zip(problem.controls, problem.control_bounds, strict=True)
    ]
    rates = []
    for state, name, bounds in zip(states, problem.states, problem.rate_bounds, strict=True):
        rates.append(dae.DerivativeVar(state, wrt=m.t, bounds=_finite(bounds), initialize=0.0))
        m.add_component(f"rate_of_{name}", rates[-1])

    @m.Constraint(m.t, range(len(states)))
    def dynamics(m, t, i):
        if t == 0:
            return pyo.Constraint.Skip  # implicit Euler needs no derivative there
        stated = problem.rates([state[t] for state in states], [control[t] for control in controls], pyo)
        return rates[i][t] == stated[i]

    pyo.TransformationFactory("dae.finite_difference").apply_to(m, wrt=m.t, nfe=elements, scheme="BACKWARD")
    for state, last in zip(states, problem.final, strict=True):
        state[0].fix(0.0)
        if last is not None:
            state[problem.duration].fix(last)
    times = list(m.t)
    # The package's own Integral is the trapezoid rule.
    m.cost = pyo.Objective(
        expr=problem.duration
        / elements
        * sum(problem.cost([state[t] for state in states], [one[t] for one in controls]) for t in times[1:])
    )
    with tempfile.TemporaryDirectory() as folder:
        log_file = Path(folder) / "ipopt.log"
        solver = pyo.SolverFactory("ipopt", executable=find_ipopt_executable())
        solver.options["max_iter"] = 3000
        solver.solve(m, logfile=str(log_file))
        log = log_file.read_text()
    ended = _cpu_seconds()
    iterations, variables, rows = (
        int(re.search(rf"{words}[. ]*: +(\d+)", log).group(1))
        for words in ("Number of Iterations", "Total number of variables", "Total number of equality constraints")
    )
    x = np.array([[pyo.value(state[t]) for state in states] for t in times])
    u = np.array([[pyo.value(control[t]) for control in controls] for t in times[1:]])
    return Answer(x, u, iterations, variables, rows, ended - started)


def _variable(m: pyo.ConcreteModel, name: str, bounds: tuple[float, float]) -> pyo.Var:
    m.add_component(name, pyo.Var(m.t, bounds=_finite(bounds), initialize=0.0))
    return m.component(name)


def _finite(bounds: tuple[float, float]) -> tuple[float | None, float | None]:
    lower, upper = (bound if math.isfinite(bound) else None for bound in bounds)
    return lower, upper


def _cpu_seconds() -> float:
    """Of this process and of the ipopt processes that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system
