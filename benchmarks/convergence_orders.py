"""Measured orders of convergence against the orders computed from the schemes.

    python benchmarks/convergence_orders.py [--quick]

States and running cost: the forced oscillator ``x'' = -4 x + cos t``, which depends on time, so that wrong points show
as well as wrong weights, with the running cost ``x^2``. From rest at 1 it moves as ``x = (2 cos 2t + cos t) / 3``.
The error of the states is the largest at any element boundary.

Index-1 DAE: ``x' = z``, ``z exp(-x) = cos t``, hence ``exp(-x) = 1 - sin t``: the state at the end, and the algebraic
at any collocation point, where a scheme has the order of its stages.

Optimal control and cost: minimise the integral of ``x^2 + u^2`` with ``x' = u``, ``x(0) = 1``, over T = 3 seconds: the
cost is ``tanh(T)``, the control ``-sinh(T - t) / cosh(T)``, compared at any collocation point. Explicit methods of two
and three stages have a stage without weight; their control is constant over each element, which is of order one.

The slope is fitted to the meshes whose error is above rounding; "-" where there are fewer than two such.
"""

from __future__ import annotations

import argparse
from math import cos, cosh, log, sin, sinh, tanh

import numpy as np
import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp

FINAL_TIME = 3.0
ROUNDING_FLOOR = 5e-14
TIGHT = {"tol": 1e-12, "constr_viol_tol": 1e-14, "bound_relax_factor": 0.0}


def oscillator_errors(scheme: str, stages: int, elements: int) -> tuple[float, float]:
    """Errors of the states and of the running cost."""
    m = pyo.ConcreteModel(name="oscillator")
    m.phase = b = rcp.PhaseBlock(duration=FINAL_TIME, elements=elements, scheme=scheme, stages=stages)
    b.x = rcp.State(initial=1)
    b.v = rcp.State(initial=0)

    @b.ode
    def oscillator(b, t):
        return {b.x: b.v[t], b.v: -4 * b.x[t] + cos(t)}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2))
    rcp.solve(m, options=TIGHT, progress=False, mesh_tolerance=None)
    state_error = max(
        max(
            abs(b.x[t].value - (2 * cos(2 * t) + cos(t)) / 3),
            abs(b.v[t].value + (4 * sin(2 * t) + sin(t)) / 3),
        )
        for t in b.grid.mesh.boundaries
    )
    return state_error, abs(pyo.value(m.cost) - _exact_cost(FINAL_TIME))


def _exact_cost(t: float) -> float:
    """The integral of ``((2 cos 2t + cos t) / 3)^2`` from 0."""
    return (2.5 * t + sin(4 * t) / 2 + 2 * sin(3 * t) / 3 + 2 * sin(t) + sin(2 * t) / 4) / 9


def algebraic_errors(scheme: str, stages: int, elements: int) -> tuple[float, float]:
    """Errors of the state and of the algebraic variable of an index-1 DAE."""
    m = pyo.ConcreteModel(name="index one")
    m.phase = b = rcp.PhaseBlock(duration=0.5, elements=elements, scheme=scheme, stages=stages)
    b.x = rcp.State(initial=0)
    b.z = rcp.Algebraic(initial_guess=1)

    @b.ode
    def slope(b, t):
        return {b.x: b.z[t]}

    @b.residual
    def algebraic(b, t):
        return b.z[t] * pyo.exp(-b.x[t]) == cos(t)

    m.nothing = pyo.Objective(expr=0)
    rcp.solve(m, options=TIGHT, progress=False, mesh_tolerance=None)
    state_error = abs(b.x[0.5].value + log(1 - sin(0.5)))
    return state_error, max(abs(b.z[t].value - cos(t) / (1 - sin(t))) for t in b.points)


def optimal_errors(scheme: str, stages: int, elements: int) -> tuple[float, float]:
    """Errors of the control and of the optimal cost of a linear-quadratic problem."""
    m = pyo.ConcreteModel(name="regulator")
    m.phase = b = rcp.PhaseBlock(duration=FINAL_TIME, elements=elements, scheme=scheme, stages=stages)
    b.x = rcp.State(initial=1)
    weightless = abs(b.grid.scheme.b).min() < 1e-14
    b.u = rcp.Control(parametrization="piecewise_constant" if weightless else "collocated")

    @b.ode
    def integrator(b, t):
        return {b.x: b.u[t]}

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    rcp.solve(m, options=TIGHT, progress=False, mesh_tolerance=None)
    control_error = max(abs(pyo.value(b.u[t]) + sinh(FINAL_TIME - t) / cosh(FINAL_TIME)) for t in b.points)
    return control_error, abs(pyo.value(m.cost) - tanh(FINAL_TIME))


def observed_order(meshes: list[int], errors: list[float]) -> float | None:
    """Slope of log(error) over log(mesh), by the finest meshes above rounding; None with fewer than two."""
    usable = [(n, error) for n, error in zip(meshes, errors, strict=True) if error > ROUNDING_FLOOR][-3:]
    if len(usable) < 2:
        return None
    return float(-np.polyfit(*np.log(np.array(usable)).T, deg=1)[0])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one and two stages only")
    arguments = parser.parse_args()

    table = Table(
        [
            ("scheme", "<11"), ("order", ">5d"), ("state", ">6.2f"), ("cost", ">6.2f"), ("DAE state", ">9.2f"),
            ("algebraic", ">9.2f"), ("control", ">8.2f"), ("optimal cost", ">12.2f"), ("meshes", "<22"),
        ]
    )  # fmt: skip
    table.header()
    for scheme, most in (("radau", 5), ("gauss", 5), ("lobatto", 5)):
        for stages in range(2 if scheme == "lobatto" else 1, min(most, 2 if arguments.quick else most) + 1):
            order = rcp.schemes.find_scheme(scheme, stages).order
            # High orders reach rounding on a few elements already; low ones need many to show their slope.
            meshes = [40, 80, 160, 320] if order <= 2 else [12, 18, 26, 38] if order <= 5 else [6, 8, 10, 12, 14]
            errors = []
            for elements in meshes:
                show_progress(f"{scheme}({stages}), {elements} elements")
                run = (scheme, stages, elements)
                errors.append((*oscillator_errors(*run), *algebraic_errors(*run), *optimal_errors(*run)))
            show_progress("")
            slopes = [observed_order(meshes, list(column)) for column in zip(*errors, strict=True)]
            table.add(f"{scheme}({stages})", order, *slopes, ", ".join(map(str, meshes)))


if __name__ == "__main__":
    main()
