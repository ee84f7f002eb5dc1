"""JSON with functions of CasADi: both layouts are read, every operator means the same, and what is missing is said."""

import json
import math
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mpcc_catalogue.point_check import check_point
from problem_files import FileProblem, read_file

from pyrobocop_pyomo.errors import ModelError
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


OPERATORS = {
    "sq": lambda c, a, b: a**2, "power": lambda c, a, b: (1 + a * a) ** b,
    "constant power": lambda c, a, b: (2 + a) ** 1.5,
    "fmin": lambda c, a, b: c.fmin(a, b), "fmax": lambda c, a, b: c.fmax(a, b), "twice": lambda c, a, b: 2 * a,
    "inverse": lambda c, a, b: 1 / (3 + a), "choice": lambda c, a, b: c.if_else(a < b, a, 2 * b),
    "choice of an equal": lambda c, a, b: c.if_else(a <= b, a, b - 1), "sign": lambda c, a, b: c.sign(a) * b,
    "log1p": lambda c, a, b: c.log1p(a * a), "expm1": lambda c, a, b: c.expm1(b),
    "hypot": lambda c, a, b: c.hypot(a, b),
    "fabs": lambda c, a, b: c.fabs(a - b), "negative": lambda c, a, b: -a, "quotient": lambda c, a, b: a / (b * b + 1),
    **{name: (lambda c, a, b, name=name: getattr(c, name)(a / 4 + 0.1)) for name in (
        "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "atanh", "exp", "floor", "ceil",
    )},
    "sqrt and log": lambda c, a, b: c.sqrt(a * a + 1) * c.log(b * b + 2), "acosh": lambda c, a, b: c.acosh(a * a + 1),
}  # fmt: skip


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(name=st.sampled_from(sorted(OPERATORS)), a=st.integers(-4, 4), b=st.integers(-4, 4))
def test_operators_mean_the_same_in_the_model(name: str, a: int, b: int, tmp_path: Path) -> None:
    """Judged, a file is evaluated by CasADi; the model is made of its instructions."""
    w, p = symbols()
    value = OPERATORS[name](casadi, w[0] / 2, w[1] / 2)
    shared = value * p + w[2]  # used three times
    problem = read(described(shared + shared**2, [shared], [w[1]], [w[2] + 1], w, p), tmp_path)
    model = problem.model()
    for variable, number in zip(model.x.values(), (a, b, 0.5), strict=True):
        variable.set_value(number, skip_validation=True)
    assert pyo.value(model.objective) == pytest.approx(problem.check([a, b, 0.5]).objective, rel=1e-12, abs=1e-12)
    assert len(model.shared) >= 1


def test_an_operator_that_pyomo_does_not_have_is_refused(tmp_path: Path) -> None:
    w, p = symbols()
    with pytest.raises(ModelError, match="operator"):
        read(described(casadi.atan2(w[0], w[1]), [w[0]], [w[1]], [w[2]], w, p), tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"G_fun": None}, "no problem with functions of CasADi"),
        ({"lbw": [0, 0]}, "2 lower bounds, 3 upper bounds, 3 start values"),
        ({"lbg": [0, 0]}, "1 rows with 2 lower and 1 upper bounds"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    w, p = symbols()
    facts = described(w[0], [w[0]], [w[1]], [w[2]], w, p)
    with pytest.raises(ModelError, match=message):
        read({**facts, **change}, tmp_path)
    with pytest.raises(ModelError, match="has no entry 'ubg'"):
        read({name: value for name, value in facts.items() if name != "ubg"}, tmp_path)
