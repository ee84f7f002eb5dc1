"""Models written with pyomo.dae: errors and sizes through two transformations, and how the time of ours grows.

    python benchmarks/dae_models.py [--quick]

Six models with known answers (``tests/catalogue/dae_models.py``) are discretised by ``pyrobocop.collocation`` and by
``dae.collocation`` at equal size, and solved tightly by the same Ipopt. The error of the states is the largest at any
element boundary; the other error is that of the integral or estimate that the model is about. ``free`` counts the
variables that no equation determines. Those should be the estimated number and, at collocation points, the controls and
the sides of pairs; what is more is left to the whim of the solver.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from pathlib import Path

import pyomo.environ as pyo
from pyomo.contrib.incidence_analysis import IncidenceGraphInterface
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from catalogue.dae_models import CASES

WAYS = ("pyrobocop.collocation", "dae.collocation")
SCHEMES = {"radau": "LAGRANGE-RADAU", "gauss": "LAGRANGE-LEGENDRE"}
TIGHT = {"tol": 1e-12, "constr_viol_tol": 1e-13, "bound_relax_factor": 0.0}


def row(name: str, way: str, scheme: str, elements: int, stages: int) -> tuple[object, ...]:
    """One line of the table of errors."""
    case = CASES[name]
    model = case.build()
    try:
        pyo.TransformationFactory(way).apply_to(model, nfe=elements, ncp=stages, scheme=SCHEMES[scheme])
    except TypeError:
        return name, way, scheme, None, None, None, None, "cannot be discretised"
    graph = IncidenceGraphInterface(model, include_inequality=False)
    size, free = len(graph.variables), len(graph.variables) - len(graph.maximum_matching())
    result = rcp.solve(model, options=TIGHT, progress=False)
    try:
        errors: tuple[float | None, ...] = case.errors(model)
    except TypeError:
        errors = (None, None)  # a variable without value, since it is in no row
    return name, way, scheme, size, free, *errors, str(result.quality.name).lower()


def seconds(way: str, elements: int, repeats: int) -> float:
    """Smallest time of several to transcribe the reactor."""
    taken = []
    for _ in range(repeats):
        model = CASES["reactor, index 1"].build()
        started = time.perf_counter()
        pyo.TransformationFactory(way).apply_to(model, nfe=elements, ncp=3)
        taken.append(time.perf_counter() - started)
    return min(taken)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small meshes only")
    arguments = parser.parse_args()
    logging.getLogger("pyomo").setLevel(logging.CRITICAL)  # what cannot be discretised is said in the table

    elements, stages = (7, 3) if arguments.quick else (7, 5)
    print(f"{elements} elements of {stages} stages")
    errors = Table(
        [
            ("model", "<18"), ("transformation", "<22"), ("scheme", "<6"), ("size", ">5d"), ("free", ">4d"),
            ("states", ">9.1e"), ("quantity", ">9.1e"), ("point", "<22"),
        ]
    )  # fmt: skip
    errors.header()
    for name in CASES:
        for scheme in SCHEMES:
            for way in WAYS:
                show_progress(f"{name}, {way}, {scheme}")
                line = row(name, way, scheme, elements, stages)
                show_progress("")
                errors.add(*line)

    print()
    times = Table([("transformation", "<22"), ("elements", ">8d"), ("seconds", ">8.3f"), ("ratio", ">6.1f")])
    times.header()
    for way in WAYS:
        first = None
        for count in (20, 60) if arguments.quick else (100, 1000):
            show_progress(f"{way}, {count} elements")
            taken = seconds(way, count, 1 if arguments.quick else 5)
            show_progress("")
            times.add(way, count, taken, None if first is None else taken / first)
            first = taken


if __name__ == "__main__":
    main()
