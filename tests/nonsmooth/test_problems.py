"""Every nonsmooth problem is solved, assessed by the true motion, and keeps the laws of its mechanics."""

from functools import cache
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from nonsmooth_problems import PROBLEMS, turbo_car
from nonsmooth_problems.problem import at_boundaries

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi

# With one mode per element the thermostat is not found, and the discs have a better answer that passes through them.
AT_POINTS = ("thermostat", "discs")


@cache
def solved(name: str, detect: bool | None = None, elements: int = 20) -> pyo.ConcreteModel:
    """By ``rcp.solve`` as it is; switches are detected, but for the problems above."""
    detect = name not in AT_POINTS if detect is None else detect
    model = PROBLEMS[name].build(elements, detect=detect, **({"stages": 2} if detect else {}))
    rcp.solve(model, progress=False).raise_for_status()
    return model


def trajectory(name: str, *arguments: Any) -> rcp.Trajectory:
    return solved(name, *arguments).phase.trajectory()


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_problem_is_solved_by_independent_numbers(name: str) -> None:
    assessment = PROBLEMS[name].assess(solved(name))
    assert assessment.faults == ()
    assert assessment.natural_residual < 1e-6


# Where the switches are detected and the motion between them is a polynomial of the scheme's degree, nothing is left of
# the discretisation: neither in the cost, nor in the motion.
EXACT = ("sliding by step", "sliding by modes", "braking with friction", "turbo car", "turbo car with hysteresis",
         "pushed blocks")  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_detected_switches_leave_no_error_of_discretisation(name: str) -> None:
    assessment = PROBLEMS[name].assess(solved(name))
    assert abs(assessment.objective_error) < 1e-7
    assert assessment.deviation < 1e-7
    assert assessment.natural_residual < 1e-8


@pytest.mark.slow
def test_elements_that_end_at_switches_are_kept_where_few_more_would_change_little() -> None:
    """Meshes agree on the cart-pole to 0.14 %; with its switches inside of elements its speed is off by 8 %."""
    model = PROBLEMS["cart-pole with friction"].build(20)
    result = rcp.solve(model, progress=False)
    assert result.strategy == "switches at boundaries"
    assert result.discretisation.motion_error < 1e-2
    assert any("are few" in doubt.message for doubt in result.doubts)


def test_a_wrong_motion_is_not_accepted() -> None:
    problem = PROBLEMS["sliding by step"]
    model = problem.build(20, detect=True)
    rcp.solve(model, progress=False).raise_for_status()
    assert problem.assess(model).solved
    for t in model.phase.points:
        model.phase.right[t].set_value(0.3)
    faults = " ".join(problem.assess(model).faults)
    assert "violation" in faults
    assert "natural residual" in faults


def test_a_bad_local_optimum_is_not_accepted() -> None:
    problem = PROBLEMS["turbo car"]
    model = problem.build(20)
    model.phase.v.setub(turbo_car.THRESHOLD / 10)  # without ever using the turbo
    rcp.solve(model, progress=False).raise_for_status()
    assert any(fault.startswith("objective error") for fault in problem.assess(model).faults)


@pytest.mark.parametrize("name", ["sliding by step", "sliding by modes"])
def test_what_has_reached_the_surface_slides_on_it(name: str) -> None:
    found = trajectory(name)
    arrived = np.flatnonzero(np.abs(found.x) < 1e-6)
    assert np.abs(found.x[arrived[0] :]).max() < 1e-6
    assert found.time[arrived[0]] == pytest.approx(2.0, abs=1e-5)


def test_the_grouping_detects_switches_where_elements_move() -> None:
    problem = PROBLEMS["turbo car"]
    model = problem.build(20, moving=True)
    rcp.solve(
        model, strategies=rcp.Strategy(grouping=rcp.relaxations.Crossed(left_end="first")), progress=False
    ).raise_for_status()
    assessment = problem.assess(model)
    assert abs(assessment.objective_error) < 1e-7
    assert assessment.deviation < 1e-7


def test_memory_makes_the_car_faster_and_it_brakes_with_the_turbo() -> None:
    assert trajectory("turbo car with hysteresis").duration < trajectory("turbo car").duration - 0.3
    found = trajectory("turbo car with hysteresis")
    # Elements move: none of their points need lie between the two thresholds.
    later = found(np.linspace(found.duration / 2, found.duration, 500))
    braking = (later["v"] > 1.0 + 1e-6) & (later["v"] < 1.5 - 1e-6)
    assert braking.any()
    assert later["turbo"][braking] == pytest.approx(1.0, abs=1e-4)


def test_the_mass_sticks_to_the_belt_exactly() -> None:
    found = trajectory("belt")
    v = found(found.points)["v"]
    rides = (found.slower > 0.01) & (found.slower < 0.99)  # friction below its full strength
    assert rides.sum() > 10
    assert np.abs(v[rides] - 1).max() < 1e-7
    assert v.max() < 1 + 1e-7  # friction never drags faster than the belt


@pytest.mark.parametrize(
    ("name", "gap"),
    [
        ("pushed blocks", lambda x: x.y - x.x - 1),
        ("throw", lambda x: x.y),
        ("hop", lambda x: x.y_f),
        ("overflow", lambda x: 1 - x.g),
        ("discs", lambda x: np.hypot(x.x_1 - x.x, x.y_1 - x.y) - 1),
    ],
)
def test_nothing_penetrates(name: str, gap: Any) -> None:
    assert gap(trajectory(name)).min() > -1e-7


def test_a_thrown_puck_gains_no_energy_and_ends_at_rest_on_the_floor() -> None:
    states = at_boundaries(trajectory("throw", False), "y", "v", "w")
    energy = 10 * states[:, 0] + 0.5 * (states[:, 1] ** 2 + states[:, 2] ** 2)
    assert np.diff(energy).max() < 1e-6
    assert states[-1] == pytest.approx([0, 0, 0], abs=1e-4)


def test_the_best_answer_of_all_strategies_wins() -> None:
    """The barrier parameter leads to a dearer local solution; the way down from delta = 1 finds a better one."""
    problem = PROBLEMS["signum"]
    objectives = {}
    for strategies in ("barrier", "continuation", None):
        model = problem.build(20)
        result = rcp.solve(model, strategies=strategies, progress=False, mesh_tolerance=None)
        assert result.solved
        assert problem.assess(model).solved
        objectives[strategies] = result.objective
    assert objectives["continuation"] < objectives["barrier"] - 5e-4
    assert objectives[None] == pytest.approx(objectives["continuation"], rel=1e-8)
    assert result.strategy == "continuation"


def test_the_discs_give_way_symmetrically() -> None:
    found = trajectory("discs")
    assert np.abs(found.y).max() < 1e-6
    assert found.x_1 == pytest.approx(found.x_2, abs=1e-6)
    assert found.y_1 == pytest.approx(-found.y_2, abs=1e-6)
    assert found.force_1 == pytest.approx(found.force_2, abs=1e-5)


def test_pairs_of_sums_allow_one_mode_per_element() -> None:
    found = trajectory("turbo car")
    stages = found.grid.scheme.stages
    above, turbo = found.turbo_above, found.turbo
    for element in range(found.grid.mesh.elements):
        here = slice(element * stages, (element + 1) * stages)
        assert above[here].max() * (1 - turbo[here]).max() < 1e-6
