"""Elements that a tolerance takes: refined where the error is, against uniform.

    python benchmarks/mesh_refinement.py [--quick]

Two problems whose motion hurries in some places and rests in others: a hyper-sensitive regulator, minimise the integral
of x^2 + u^2 with x' = -x^3 + u from 1 to 1.5 over 50 seconds, which takes a second at each end and nothing between; and
the swing-up of a cart-pole with the example's numbers. The error is that of an element re-integrated from its own
start, in the units of the states, by `Trajectory.verify`. The uniform mesh is the
coarsest of those tried, each a tenth finer than the one before, that meets the tolerance.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from math import pi
from typing import Any

import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp


def regulator(mesh: Any = None) -> Any:
    """Layers at both ends of a long horizon."""
    m = pyo.ConcreteModel("regulator")
    m.phase = b = rcp.PhaseBlock(duration=50.0, mesh=mesh)
    b.x, b.u = rcp.State(initial=1, final=1.5), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t] - b.x[t] ** 3})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.x[t] ** 2 + b.u[t] ** 2))
    return m


def cart_pole(mesh: Any = None) -> Any:
    """Swing-up of a pole of half a metre and 0.3 kg on a cart of 1 kg."""
    m = pyo.ConcreteModel("cart-pole")
    m.phase = b = rcp.PhaseBlock(duration=2.0, mesh=mesh)
    b.x, b.theta = rcp.State(initial=0, final=1, bounds=(-2, 2)), rcp.State(initial=0, final=pi)
    b.v, b.omega = rcp.State(initial=0, final=0), rcp.State(initial=0, final=0)
    b.force = rcp.Control(bounds=(-20, 20))

    def dynamics(b: Any, t: float) -> Any:
        sin, cos, length, pole, cart, g = pyo.sin(b.theta[t]), pyo.cos(b.theta[t]), 0.5, 0.3, 1.0, 9.81
        mass = cart + pole * sin**2
        push = b.force[t] + pole * length * b.omega[t] ** 2 * sin
        return {
            b.x: b.v[t],
            b.theta: b.omega[t],
            b.v: (push + pole * g * sin * cos) / mass,
            b.omega: -(push * cos + (cart + pole) * g * sin) / (length * mass),
        }

    b.ode(dynamics)
    b.initialize_straight_lines()
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2))
    return m


def best_uniform(build: Callable[[Any], Any], tolerance: float, first: int) -> tuple[int, float, float, int, float]:
    """Elements, error, objective, iterations and seconds of the first uniform mesh that meets a tolerance."""
    elements = first
    while True:
        show_progress(f"{elements} uniform elements")
        horizon = build(None).phase.grid.mesh.boundaries[-1]
        started = time.perf_counter()
        m = build(rcp.schemes.Mesh.uniform(0, horizon, elements))
        result = rcp.solve(m, progress=False)
        seconds = time.perf_counter() - started
        error = m.phase.trajectory().verify().element_error
        if error <= tolerance:
            show_progress("")
            return elements, error, result.objective, result.iterations, seconds
        elements = max(elements + 1, round(1.1 * elements))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the regulator at one loose tolerance only")
    arguments = parser.parse_args()
    cases = [(regulator, 1e-4, 250)]
    if not arguments.quick:
        cases += [(regulator, 1e-6, 400), (cart_pole, 1e-6, 10)]
    table = Table(
        [
            ("problem", "<10"), ("tolerance", ">9.0e"), ("mesh", "<8"), ("elements", ">8d"),
            ("error", ">8.1e"), ("objective", ">12.8g"), ("iterations", ">10d"),
            ("seconds", ">7.2f"),
        ]
    )  # fmt: skip
    table.header()
    for build, tolerance, first in cases:
        m, started = build(None), time.perf_counter()
        result = rcp.solve(m, mesh_tolerance=tolerance / 10, progress=False)
        result.raise_for_status()
        seconds, last = time.perf_counter() - started, m.phase.grid.mesh.elements
        error = m.phase.trajectory().verify().element_error
        table.add(m.name, tolerance, "refined", last, error, result.objective, result.iterations, seconds)
        elements, error, *rest = best_uniform(build, tolerance, first)
        table.add(m.name, tolerance, "uniform", elements, error, *rest)


if __name__ == "__main__":
    main()
