"""The same problem as this package's example states it, solved by `rcp.solve` with defaults."""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .problem import Answer, SmoothProblem

sys.path.append(str(Path(__file__).parents[2] / "examples"))  # examples are scripts, not a package


def solved_by_phase(problem: SmoothProblem, elements: int) -> Answer:
    """From the example of the problem's name."""
    build = importlib.import_module(problem.name).build
    started = time.process_time()
    m = build(elements=elements)
    result = rcp.solve(m, progress=False, mesh_tolerance=None)
    ended = time.process_time()
    (phase,) = rcp.phases_of(m)
    found = phase.trajectory()
    return Answer(
        np.column_stack([getattr(found, name) for name in problem.states]),
        np.column_stack([getattr(found, name) for name in problem.controls]),
        result.iterations,
        sum(not v.fixed for v in m.component_data_objects(pyo.Var)),
        sum(1 for _ in m.component_data_objects(pyo.Constraint, active=True)),
        ended - started,
    )
