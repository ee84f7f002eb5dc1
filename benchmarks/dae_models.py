"""Models written with pyomo.dae: errors and sizes through two transformations, and how the time of ours grows.

    python benchmarks/dae_models.py [--quick]

Six models with known answers (``tests/catalogue/dae_models.py``) are discretised by ``pyrobocop.collocation`` and by
``dae.collocation`` at equal size, and solved tightly by the same Ipopt. The error of the states is the largest at any
element boundary; the other error is that of the integral or estimate that the model is about. ``free`` counts the
variables that no equation determines. Those should be the estimated number and, at collocation points, the controls and
the sides of pairs; what is more is left to the whim of the solver.

The last table has models of other people, unchanged but for the transformation's name, solved by ``rcp.solve`` with its
defaults: the examples of pyomo.dae, a cart with a pole that stands up (125 steps, Legendre points), and flowsheets of
IDAES where idaes-pse is installed. ``variables`` are those in equations that are not fixed.
"""

from __future__ import annotations

import argparse
import importlib
import logging
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from pyomo.contrib.incidence_analysis import IncidenceGraphInterface
from pyomo.dae import ContinuousSet
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from catalogue import pyomo_examples
from catalogue.cart_pole import cart_pole
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


def others() -> Iterator[tuple[str, Callable[[], Any], Callable[[Any], None], dict[str, Any]]]:
    """Name, builder, what is fixed after the transformation, and options of it."""
    elements = {"parameter_estimation": 8, "car": 8, "distillation": 10, "disease": 8, "path_constraint": 8}
    for name, count in elements.items():
        yield name.replace("_", " "), getattr(pyomo_examples, name), lambda m: None, {"nfe": count, "ncp": 3}
    legendre = {"nfe": 125, "ncp": 2, "scheme": "LAGRANGE-LEGENDRE"}
    yield "cart with a pole", cart_pole, lambda m: None, legendre
    try:
        flowsheets = importlib.import_module("catalogue.flowsheets").FLOWSHEETS
    except ImportError:
        return
    for name, flowsheet in flowsheets.items():
        yield name, flowsheet.build, flowsheet.fix, {"nfe": 6, "ncp": 3}


def other_row(name: str, way: str, build: Any, fix: Any, options: dict[str, Any]) -> tuple[object, ...]:
    """One line of the table of other people's models."""
    model = build()
    domain = next(model.component_objects(ContinuousSet)) if model.find_component("fs") is None else model.fs.time
    pyo.TransformationFactory(way).apply_to(model, wrt=domain, **options)
    fix(model)
    size = len(IncidenceGraphInterface(model, include_inequality=False).variables)
    started = time.process_time()
    result = rcp.solve(model, progress=False)
    seconds = time.process_time() - started
    return name, way, size, result.iterations, seconds, result.objective, str(result.quality.name).lower()


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

    print()
    table = Table(
        [
            ("model", "<34"), ("transformation", "<22"), ("variables", ">9d"), ("iterations", ">10d"),
            ("CPU s", ">6.2f"), ("objective", ">10.4g"), ("point", "<16"),
        ]
    )  # fmt: skip
    table.header()
    for name, build, fix, options in others():
        for way in WAYS[::-1]:
            show_progress(f"{name}, {way}")
            line = other_row(name, way, build, fix, options)
            show_progress("")
            table.add(*line)


if __name__ == "__main__":
    main()
