"""The catalogue of bad input: each entry is stated as a user would, and answered by name, with numbers and a remedy.

What is refused is refused by an error, and leaves nothing on the model; what is only seldom meant is told in the log.
Options of the block that contradict each other are in `test_avoidance_input`, slips in rules in `test_typical_slips`;
lists of points and rows that are no shape, and poses that are none, are in `tests/geometry`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, placed, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

Polytope = rcp.Polytope


def moving(pose: Any, height: float = 3.0, turn: float = 0.6, **options: Any) -> Any:
    """An arrow of which the pose rule is given, well above its wall."""
    m = turning_move(elements=2, height=height, turn=turn)
    return avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=pose)}, **options)


def guessed(pose: Any, **options: Any) -> None:
    moving(pose, **options).initialize()


def mirrored(b: Any, t: Any) -> rcp.scenes.Pose:
    cosine, sine = pyo.cos(b.theta[t]), pyo.sin(b.theta[t])
    return rcp.scenes.Pose(((cosine, sine), (sine, -cosine)), (b.x[t], b.y[t]))


def kinked(b: Any, t: Any) -> rcp.scenes.Pose:
    return rcp.planar_pose(b.x[t], b.y[t], abs(b.theta[t]))


def start_is(number: Any) -> None:
    m = turning_move(elements=2, height=3)
    avoid = avoiding(m)
    m.move.y[0.5].set_value(number, skip_validation=True)
    avoid.initialize()


# A slot around the goal that leaves the arrow less than 20 cm.
SLOT = {"above": Polytope.box(3, 1, center=(4, 1.1)), "below": Polytope.box(3, 1, center=(4, -1.1))}


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (lambda: guessed(mirrored), ["'arrow'", "mirrors", "determinant", "signs", "right-handed"]),
        (lambda: start_is(np.nan), ["'arrow' at 0.5", "not finite"]),
        (lambda: start_is(None), ["'arrow' at 0.5", "move.y[0.5]", "no value", "start values"]),
        (lambda: moving(lambda b, t: rcp.planar_pose(b.x[t], b.u[t])), ["'arrow'", "move.u", "states"]),
        (
            lambda: guessed(placed, obstacles=SLOT, clearance=0.3),
            ["'arrow' and 'above'", "at t = 1.0", "poses are fixed", "clearance is 0.3", "Ask for less than 0.1"],
        ),
    ],
    ids=["a pose that mirrors", "no number", "no value", "a control", "a slot that is too narrow"],
)
def test_refused_by_name_with_numbers_and_remedy(state: Callable[[], Any], words: list[str]) -> None:
    with pytest.raises(ModelError) as caught:
        state()
    assert [word for word in words if word not in str(caught.value)] == []


def close_goal(m: pyo.ConcreteModel) -> None:
    avoiding(m, obstacles={"post": Polytope.box(1, 1, center=(4, 0))})


def small_clearance(m: pyo.ConcreteModel) -> None:
    avoiding(m, clearance=9e-5)


def pose_with_a_kink(m: pyo.ConcreteModel) -> None:
    avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=kinked)})


@pytest.mark.ipopt
@pytest.mark.parametrize(
    ("state", "words"),
    [
        (close_goal, ["'arrow' and 'post'", "into each other at t = 1.0", "clearance is 0.05", "Move the fixed pose"]),
        (
            small_clearance,
            ["'move.avoid'", "9e-05", "100 times", "1e-06", "unit of length", "tolerances={'feasibility'"],
        ),
        (pose_with_a_kink, ["'arrow'", "the function 'abs'", "sin, cos"]),
    ],
)
def test_a_solve_that_is_refused_says_why_and_changes_nothing(
    state: Callable[[pyo.ConcreteModel], None], words: list[str]
) -> None:
    m = turning_move(elements=2, height=3)
    state(m)
    before = [(variable, variable.value) for variable in m.component_data_objects(pyo.Var)]
    names = [component.name for component in m.component_objects()]
    with pytest.raises(rcp.errors.ObstacleError) as caught:
        rcp.solve(m)
    assert [word for word in words if word not in str(caught.value)] == []
    assert [(variable, variable.value) for variable in m.component_data_objects(pyo.Var)] == before
    assert [component.name for component in m.component_objects()] == names
    assert m.effort.active


@pytest.mark.ipopt
def test_a_tighter_tolerance_allows_a_smaller_clearance() -> None:
    m = turning_move(elements=2, height=3)
    small_clearance(m)
    options = {"tol": 1e-9, "constr_viol_tol": 1e-9}
    assert rcp.solve(m, tolerances={"feasibility": 1e-8}, options=options).quality is not rcp.Quality.INFEASIBLE


def test_degrees_are_told_once_per_body(caplog: pytest.LogCaptureFixture) -> None:
    guessed(placed, turn=90.0)
    assert caplog.text.count("an angle of its pose") == 1


@pytest.mark.parametrize(
    "options",
    [
        {"obstacles": {"ground": Polytope.from_halfspaces([[0, 1]], [-5], bounded=False)}},
        {"clearance": np.float64(0.1)},
    ],
)
def test_what_is_fine_is_not_talked_about(options: dict[str, Any], caplog: pytest.LogCaptureFixture) -> None:
    moving(placed, **options)
    assert caplog.text == ""


def test_the_room_that_a_slot_leaves_is_the_one_that_it_names() -> None:
    with pytest.raises(rcp.errors.ObstacleError) as caught:
        guessed(placed, obstacles=SLOT, clearance=0.3)
    room = float(str(caught.value).partition("Ask for less than ")[2].partition(",")[0])
    goal = rcp.planar_pose(4, 0, 0.6)
    assert room == pytest.approx(rcp.scenes.signed_distance(ARROW, SLOT["above"], goal).distance, rel=1e-5)
    with pytest.raises(rcp.errors.ObstacleError):
        guessed(placed, obstacles=SLOT, clearance=1.001 * room)
    guessed(placed, obstacles={"above": SLOT["above"]}, height=-1.0, clearance=0.999 * room)
    assert rcp.scenes.signed_distance(ARROW, WALL, goal).distance > 0.3
