"""Models with absolute values are solved as they stand: known optima, and the model stays the user's."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from complementarity.harness import nl_text, state
from harness.checked import solution
from harness.phases import mass
from harness.routes import every_backend
from mpcc_catalogue.point_check import check_point

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.ipopt

TWO_PARTS = "absolute values as pairs"


def least_fuel(elements: int = 20, scheme: str = "implicit_euler") -> pyo.ConcreteModel:
    """A mass moves by 1 in 3 seconds, from rest to rest, with forces of at most 1: full thrust, none, full thrust."""
    rest = {"x": {"initial": 0, "final": 1}, "v": {"initial": 0, "final": 0}}
    m, b = mass(**rest, u={"bounds": (-1, 1)}, duration=3.0, elements=elements, scheme=scheme)
    m.fuel = pyo.Objective(expr=b.integral(lambda b, t: abs(b.u[t])))
    return m


# Thrust for s seconds at either end moves the mass by s (3 - s) = 1.
LEAST_FUEL = 3 - 5**0.5


def test_least_fuel_is_thrust_rest_thrust() -> None:
    m = least_fuel(elements=60)
    before = state(m)
    result = solution(m)
    assert result.strategy == TWO_PARTS
    assert state(m) == before
    assert result.objective == pytest.approx(pyo.value(m.fuel), abs=1e-12)
    assert result.objective == pytest.approx(LEAST_FUEL, rel=5e-3)
    assert check_point(m).violation <= 1e-6
    forces = m.p.trajectory()["u"][1:]
    # A linear program with two conditions at the end: no more than two forces are between.
    assert np.count_nonzero(np.abs(forces - np.round(forces)) > 1e-4) <= 2
    assert list(dict.fromkeys(np.round(forces[np.abs(forces - np.round(forces)) <= 1e-4]))) == [1.0, 0.0, -1.0]


def test_the_optimum_does_not_depend_on_who_splits() -> None:
    m, stated = least_fuel(scheme="radau"), least_fuel(scheme="radau")
    pyo.TransformationFactory("pyrobocop.absolute_values_to_complementarity").apply_to(stated)
    results = [rcp.solve(each, progress=False, mesh_tolerance=None) for each in (m, stated)]
    assert all(result.solved for result in results)
    assert results[0].objective == pytest.approx(results[1].objective, rel=1e-6)


@every_backend
@pytest.mark.parametrize("start", [-3.0, 0.5, 2.0])
def test_a_distance_as_objective(start: float, backend: str) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=start)
    m.cost = pyo.Objective(expr=abs(m.x - 0.5))
    result = solution(m, backend=backend)
    assert m.x.value == pytest.approx(0.5, abs=1e-6)
    assert result.objective == abs(m.x.value - 0.5)


def test_rows_that_say_more_than_a_derivative_can() -> None:
    """The points of ``|x| + |y| == 1`` nearest to (0, 3) and farthest from the origin: corners."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0.3), pyo.Var(initialize=0.2)
    m.diamond = pyo.Constraint(expr=abs(m.x) + abs(m.y) == 1)
    m.cost = pyo.Objective(expr=m.x**2 + (m.y - 3) ** 2)
    text = nl_text(m)
    solution(m)
    assert (m.x.value, m.y.value) == pytest.approx((0.0, 1.0), abs=1e-5)
    assert check_point(m).violation <= 1e-6
    assert nl_text(m).count("\n") == text.count("\n")


def test_suffixes_have_the_multipliers_of_the_rows() -> None:
    """One more unit of distance costs the fuel that a finite difference says."""

    def solved(distance: float) -> tuple[Any, float]:
        m = pyo.ConcreteModel()
        m.x, m.y = pyo.Var(initialize=2.0), pyo.Var(initialize=1.0)
        m.far = pyo.Constraint(expr=m.x + 2 * m.y == distance)
        m.cost = pyo.Objective(expr=abs(m.x) + 3 * abs(m.y - 0.1))
        m.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
        result = solution(m)
        assert result.strategy == TWO_PARTS
        return m.dual[m.far], result.objective

    (dual, cost), (_, more) = solved(5.0), solved(5.1)
    assert dual == pytest.approx((more - cost) / 0.1, abs=1e-5)


def test_a_model_without_absolute_values_has_no_such_try() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0, bounds=(0.5, None))
    m.row = pyo.Constraint(expr=m.x * abs(m.x) <= -1)
    m.pieces = pyo.Constraint([1, 2], rule=lambda m, i: abs(m.x - i) >= 2 if i == 1 else m.x <= i)
    m.pieces[1].deactivate()
    m.cost = pyo.Objective(expr=m.x)
    result = rcp.solve(m, progress=False, strategies=(TWO_PARTS, "elastic rows"))
    assert not result.solved
    assert TWO_PARTS not in [step.label for step in result.steps]
