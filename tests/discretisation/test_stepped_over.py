"""What lies between two points of the mesh is found, however thin it is, and nothing else is."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import bryson_denham, one_phase
from numpy.typing import NDArray

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.discretisation.lagrangian import least_integrand_within_rows
from pyrobocop_pyomo.discretisation.probe import stepped_over

Rule = Callable[[Any, float], Any]


def along(rule: Rule, scheme: str = "radau") -> Any:
    """A straight line from 0 to 1 in one second, with a rule that its points may keep."""
    m, b = one_phase(model="along", duration=1.0, elements=10, scheme=scheme)
    b.x, b.y = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u, b.v = rcp.Control(bounds=(-9, 9)), rcp.Control(bounds=(-9, 9))
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.v[t]})
    b.constraint(rule, name="limit")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.u[t] - 1) ** 2 + b.v[t] ** 2 + b.y[t] ** 2))
    for t in b.time:
        b.x[t].set_value(t), b.y[t].set_value(0.0)
    for t in b.points:
        b.u[t].set_value(1.0), b.v[t].set_value(0.0)
    return m


def post(radius: float, form: str) -> Rule:
    """A round post that stands on the line, at 0.5251."""

    def rule(b: Any, t: float) -> Any:
        square = (b.x[t] - 0.5251) ** 2 + b.y[t] ** 2
        return {
            "square": square >= radius**2,
            "difference": radius**2 - square <= 0,
            "distance": pyo.sqrt(square + 1e-14) >= radius,
            "range": (radius**2, square, 9),
        }[form]

    return rule


@pytest.mark.parametrize("scheme", ["radau", "gauss", "implicit_euler"])
@pytest.mark.parametrize("radius", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("form", ["square", "difference", "distance", "range"])
def test_a_post_between_two_points_is_found_whatever_its_radius_and_its_form(
    form: str, radius: float, scheme: str
) -> None:
    ((name, amount, moment),) = stepped_over(along(post(radius, form), scheme).p)
    assert name == "limit"
    assert moment == pytest.approx(0.5251, abs=0.5 * radius)
    assert amount == pytest.approx(radius if form == "distance" else radius**2, rel=0.15)


@pytest.mark.parametrize(
    "rule",
    [
        lambda b, t: (b.x[t] - 0.5251) ** 2 + (b.y[t] - 0.0101) ** 2 >= 0.01**2,  # beside the line
        lambda b, t: b.x[t] <= 1,  # kept at the end
        lambda b, t: b.x[t] == b.time_at(t),
        lambda b, t: pyo.tan(1.5 * b.x[t]) <= 15,
        lambda b, t: b.x[t] <= 2 if t > 0.3 else pyo.Constraint.Skip,
    ],
)
def test_nothing_is_said_of_what_is_kept_or_has_no_formula(rule: Rule) -> None:
    assert list(stepped_over(along(rule).p)) == []


@pytest.mark.casadi
@pytest.mark.parametrize("rule", [post(0.003, "square"), lambda b, t: pyo.tan(3.1 * b.x[t]) <= 300])
def test_a_thin_post_or_a_pole_that_is_stepped_over_is_doubted_in_the_first_lines(rule: Rule) -> None:
    result = rcp.solve(along(rule), progress=False, strategies=rcp.Strategy(exploration=0))
    assert str(result).splitlines()[1].startswith("DOUBTFUL: phase 'p': constraint 'limit' holds at the points")


@pytest.mark.casadi
@pytest.mark.parametrize("elements", [5, 10, 20])
def test_a_limit_that_is_touched_is_no_limit_that_is_stepped_over(elements: int) -> None:
    """A body is thrown against a lid that it touches, with a known cost of 4."""
    m = bryson_denham(elements=elements)
    m.p.x.setub(None)
    m.p.constraint(lambda b, t: b.x[t] <= 1 / 9, name="lid")
    assert rcp.solve(m, progress=False).objective == pytest.approx(4.0, rel=1e-3)
    assert list(stepped_over(m.p)) == []


# --------------------------------------------------------------------
# Where a row is no convex function of the controls, the least integrand is not above that of an optimal answer.


Array = NDArray[np.float64]


class Cone:
    """A thrust that costs its size, of which the part along the costate is worth something.

    ``size - worth * along`` with ``along ** 2 <= size ** 2`` and a size from one to three: for a worth below one the
    least size is best, for a worth above one the largest.
    """

    def __init__(self, worth: float) -> None:
        self.worth = worth

    def integrand(self, given: Mapping[str, Array], *, apart: bool = False) -> Array:
        multiplier = 0.5 * self.worth / self.best
        row = 0.0 if apart else multiplier * (given["along"] ** 2 - given["size"] ** 2)
        return given["size"] - self.worth * given["along"] + row

    def own_rows(self, given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        body = given["along"] ** 2 - given["size"] ** 2
        return [(body, np.full(body.shape, -np.inf), np.zeros(body.shape))]

    def limits(self, name: str) -> tuple[Array, Array]:
        none = np.full((1, 1), np.inf)
        return (np.full((1, 1), 1.0), np.full((1, 1), 3.0)) if name == "size" else (-none, none)

    @property
    def best(self) -> float:
        return 1.0 if self.worth < 1.0 else 3.0


@pytest.mark.parametrize("worth", [0.3, 0.5, 0.9, 1.2, 2.0])
def test_the_optimum_is_not_improved_and_not_made_worse(worth: float) -> None:
    cone = Cone(worth)
    here = {"size": np.full((1, 1), cone.best), "along": np.full((1, 1), cone.best)}
    assert least_integrand_within_rows(cone, here) == pytest.approx(cone.integrand(here), abs=1e-6)


class HalfPlane:
    """Two controls, each best at one; a row limits the first alone, and the answer is a hair beyond it."""

    def integrand(self, given: Mapping[str, Array], *, apart: bool = False) -> Array:
        return (given["limited"] - 1.0) ** 2 + (given["other"] - 1.0) ** 2

    def own_rows(self, given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        body = given["limited"]
        return [(body, np.full(body.shape, -np.inf), np.full(body.shape, 1.0 - 1e-9))]

    def limits(self, name: str) -> tuple[Array, Array]:
        return np.full((1, 1), -3.0), np.full((1, 1), 3.0)


def test_a_row_that_is_missed_by_a_hair_moves_no_control_that_it_does_not_read() -> None:
    plane, here = HalfPlane(), {"limited": np.ones((1, 1)), "other": np.ones((1, 1))}
    with np.errstate(all="ignore"):  # as its caller does
        assert least_integrand_within_rows(plane, here) == pytest.approx(0.0, abs=1e-6)
