"""The best values, found again without any relaxation: branch by branch, by scanning, or by a bound and a point."""

import math

import pytest
from known_mpccs import MpccProblem, mpcc_problem, mpcc_problems
from known_mpccs.equilibrium import FIRMS
from scipy.optimize import brentq, minimize_scalar

import pyrobocop_pyomo.ipopt.in_process  # noqa: F401  (registers the solver)

from .branches import Branching, branch_and_bound, enumerate_branches
from .point_check import PointCheck

pytestmark = pytest.mark.casadi

# Bounded from below by the problem without complementarity, and reached by the point that was planted.
PLANTED = ("planted qpec", "aligned qpec", "membrane")
LONG = {"string over a floor 31", "electricity, two nodes", "saturated controller"}


def how(problem: MpccProblem) -> str:
    """Which of the ways below is for a problem."""
    if problem.name.startswith(PLANTED) or problem.name.startswith("projection 500"):
        return "bound"
    if problem.name.startswith("oligopoly"):
        return "scan"
    # A product of a price and a quantity is concave before the branch is chosen: no bound at inner nodes.
    inner_nodes_convex = "convex" in problem.tags
    return "tree" if inner_nodes_convex else "branches"


def problems(way: str) -> list[object]:
    return [
        pytest.param(problem, id=problem.name, marks=[pytest.mark.slow] if problem.name in LONG else [])
        for problem in mpcc_problems()
        if how(problem) == way
    ]


def agrees(problem: MpccProblem, found: float) -> None:
    if problem.best is None:
        assert math.isinf(found)
    else:
        assert found == pytest.approx(problem.best, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("problem", problems("tree"))
def test_branch_and_bound_finds_the_best_value(problem: MpccProblem) -> None:
    found, _ = branch_and_bound(problem.build())
    agrees(problem, found)


@pytest.mark.parametrize("problem", problems("branches"))
def test_no_branch_from_any_start_is_better_and_one_is_as_good(problem: MpccProblem) -> None:
    found, _ = enumerate_branches(problem.build())
    agrees(problem, found)


@pytest.mark.parametrize("problem", [problem for problem in problems("bound") if "projection" not in problem.id])
def test_the_relaxed_problem_is_no_better_than_the_planted_point(problem: MpccProblem) -> None:
    assert "convex" in problem.tags
    bound = Branching(problem.build()).solve({})
    assert bound >= problem.best - 1e-4


@pytest.mark.parametrize("cells", [6, 12])
def test_the_planted_membrane_is_feasible_and_costs_nothing(cells: int) -> None:
    model = mpcc_problem(f"membrane {cells}x{cells}").build()
    check = PointCheck(model)
    from_wanted(model, cells)
    point = check.point()
    assert max(point.violation, point.natural) <= 1e-9
    assert point.objective == pytest.approx(0.0, abs=1e-12)


def from_wanted(model: object, cells: int) -> None:
    """Heights and forces as planted; the load is what the rows then ask for."""
    quarter = {}
    for i, j in model.height:
        x, y = i / cells, j / cells
        lifted, bears = x < 0.5 and y < 0.5, x > 0.5 and y > 0.5
        quarter[i, j] = 4 * x * (0.5 - x) * y * (0.5 - y) if lifted else 0.0
        model.height[i, j].set_value(quarter[i, j])
        model.force[i, j].set_value(4 * (x - 0.5) * (1 - x) + 1.0 if bears else 0.0)
    for i, j in model.pull:
        around = sum(quarter.get(p, 0.0) for p in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)))
        model.pull[i, j].set_value((4 * quarter[i, j] - around) * cells**2 / 16 - model.force[i, j].value)


def test_planes_of_a_projection_are_decided_one_by_one() -> None:
    best = sum(min((i % 5) ** 2, (i % 3) ** 2) for i in range(1, 501))
    assert mpcc_problem("projection 500").best == best


@pytest.mark.parametrize("problem", problems("scan"))
def test_scanning_what_the_leader_sells_finds_the_best_profit(problem: MpccProblem) -> None:
    """For a total on the market every follower's quantity is the root of a monotone function: no program at all."""
    gamma, capacity = map(float, problem.name.removeprefix("oligopoly ").split(","))

    def production(firm: int, quantity: float) -> float:
        unit, exponent = FIRMS[firm]
        power = (1 + exponent) / exponent
        return unit * quantity + 5.0 ** (-1 / exponent) / power * quantity**power

    def reply(firm: int, total: float) -> float:
        unit, exponent = FIRMS[firm]
        price = (5000 / total) ** (1 / gamma)

        def profit_slope(quantity: float) -> float:
            return price * (1 - quantity / (gamma * total)) - unit - (quantity / 5.0) ** (1 / exponent)

        if profit_slope(0.0) <= 0:
            return 0.0
        if profit_slope(capacity) >= 0:
            return capacity
        return brentq(profit_slope, 0.0, capacity, xtol=1e-12)

    def loss(own: float) -> float:
        def excess(total: float) -> float:
            return own + sum(reply(firm, total) for firm in (2, 3, 4, 5)) - total

        total = brentq(excess, max(own, 1e-3), own + 4 * capacity + 1, xtol=1e-11)
        return production(1, own) - own * (5000 / total) ** (1 / gamma)

    grid = [capacity * k / 60 for k in range(61)]
    nearest = min(grid, key=loss)
    step = capacity / 60
    scanned = minimize_scalar(
        loss,
        bounds=(max(0.0, nearest - step), min(capacity, nearest + step)),
        method="bounded",
        options={"xatol": 1e-8},
    )
    assert problem.best == pytest.approx(min(scanned.fun, loss(nearest)), rel=1e-5)
