"""JSON with functions of CasADi: both layouts are read, and the model has the values of the file."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from mpcc_catalogue.point_check import check_point
from problem_files import FileProblem, read_file

from pyrobocop_pyomo.optional_imports import casadi

pytestmark = pytest.mark.casadi


def symbols() -> tuple[Any, Any]:
    return casadi.vertcat(casadi.SX.sym("u"), casadi.SX.sym("v"), casadi.SX.sym("s")), casadi.SX.sym("p", 1)


def described(objective: Any, rows: list[Any], firsts: list[Any], seconds: list[Any], w: Any, p: Any) -> dict[str, Any]:
    """The layout that the collection describes, as MATLAB writes it: a vector of one is a number, infinity is null."""

    def function(*values: Any) -> str:
        return str(casadi.Function("f", [w, p], [casadi.vertcat(*values)]).serialize())

    return {
        "w": w.serialize(), "lbw": [None, 0, -1], "ubw": [None, None, 1], "w0": [0.5, 1, 2], "p": p.serialize(),
        "p0": 3, "g_fun": function(*rows), "lbg": None, "ubg": 1, "G_fun": function(*firsts),
        "H_fun": function(*seconds),
        "augmented_objective_fun": function(objective),
    }  # fmt: skip


def newer(facts: dict[str, Any]) -> dict[str, Any]:
    """The same in the layout of newer files."""
    vector = lambda **numbers: {"numerical_vectors": numbers}  # noqa: E731
    return {
        "w": {"sym": facts["w"], **vector(lb=[-math.inf, 0, -1], ub=[math.inf, math.inf, 1], init=facts["w0"])},
        "g": {"sym": facts["g_fun"], **vector(lb=-math.inf, ub=1)},
        "p": {"sym": facts["p"], **vector(val=3)},
        "G": {"sym": facts["G_fun"]}, "H": {"sym": facts["H_fun"]}, "f": facts["augmented_objective_fun"],
    }  # fmt: skip


def read(facts: dict[str, Any], folder: Path) -> FileProblem:
    (folder / "problem.json").write_text(json.dumps(facts))
    return read_file(folder / "problem.json")


@pytest.mark.parametrize("layout", [dict, newer])
def test_both_layouts_are_read(layout: Any, tmp_path: Path) -> None:
    w, p = symbols()
    u, v, s = casadi.vertsplit(w)
    problem = read(layout(described(p * u**2 + v, [u + s], [v, u], [s + 1, p - u], w, p)), tmp_path)
    assert problem.variables == ("u", "v", "s")
    assert (problem.lower, problem.upper) == ([-math.inf, 0, -1], [math.inf, math.inf, 1])
    assert problem.start == [0.5, 1, 2]
    point = problem.check([0.5, 1.0, 2.0])
    assert point == (3 * 0.25 + 1, 1.5, 1.0)  # u + s is 2.5 and not 1, s is 2 and not 1; min(v, s + 1) is 1
    model = problem.model()
    assert len(model.pairs) == 2
    again = check_point(model)
    assert (again.objective, again.natural) == (point.objective, point.natural)
