"""Models at points, and what two statements of a problem say of them, by code that shares nothing with the package."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
from mpcc_catalogue.point_check import Point, check_point

from pyrobocop_pyomo.files import FileProblem, read_file, write_file

COLLECTION = Path(__file__).parent / "collection"
# Best objective of each file, and where it is from.
OPTIMA = {
    "box": 0.25,  # by inspection: (2, 0.5)
    "capacity": 4.0,  # by inspection: the flow 2, the toll 0.25
    "df1": 0.0,  # MacMPEC
    "gauvin": 20.0,  # MacMPEC
    "ralph2": 0.0,  # MacMPEC
}


def scatter(model: Any, seed: int) -> None:
    """Give all free variables values, many of them such that sides are exactly zero."""
    choose = random.Random(seed)
    for variable in model.component_data_objects(pyo.Var):
        if not variable.fixed:
            value = choose.choice([0.0, 0.0, 0.5, 1.0, 2.0, -1.0, choose.uniform(-3.0, 3.0)])
            variable.set_value(value, skip_validation=True)


def written_and_read(model: Any, path: Path, **options: Any) -> FileProblem:
    """The same problem after it was in a file. New variables start at what their rows say."""
    return read_file(write_file(model, path, **options))


def is_as_bad(one: float, other: float) -> bool:
    return one == other or math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)


def check_same(model: Any, problem: FileProblem, sign: float = 1.0) -> None:
    """The file says of the model's point what the model says, and so does the model that is made of the file."""
    stated, judged, again = check_point(model), problem.check(problem.start), check_point(problem.model())
    if math.isinf(badness(stated)):  # a number does not exist
        assert math.isinf(max(judged.violation, judged.natural))
        return
    assert is_as_bad(stated.objective, sign * judged.objective)
    assert is_as_bad(stated.objective, sign * again.objective)
    assert is_as_bad(badness(stated), max(judged.violation, judged.natural))
    assert is_as_bad(badness(stated), badness(again))


def badness(point: Point) -> float:
    return max(point.violation, point.natural)
