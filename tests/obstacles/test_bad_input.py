"""The catalogue of bad input: each entry is stated as a user would, and answered by name, with numbers and a remedy.

What is refused is refused by an error, and leaves nothing on the model; what is only seldom meant is told in the log.
Options of the block that contradict each other are in `test_avoidance_input`, lists of points and rows that are none
of a kind in `tests/geometry`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, placed, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

Polytope = rcp.Polytope
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
NOTCHED = [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)]


@dataclass(frozen=True)
class Entry:
    """One line of the catalogue: what is wrong, how it is stated, what the answer must say."""

    what: str
    state: Callable[[], Any]
    words: Sequence[str]


def moving(pose: Any, height: float = 3.0, turn: float = 0.6, **options: Any) -> Any:
    """An arrow of which the pose rule is given, well above its wall."""
    m = turning_move(elements=2, height=height, turn=turn)
    return avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=pose)}, **options)


def guessed(pose: Any, **options: Any) -> None:
    moving(pose, **options).initialize()


def solved(height: float = 3.0, **options: Any) -> None:
    m = turning_move(elements=2, height=height)
    avoiding(m, **options)
    rcp.solve(m)


def mirrored(b: Any, t: Any) -> rcp.scenes.Pose:
    cosine, sine = pyo.cos(b.theta[t]), pyo.sin(b.theta[t])
    return rcp.scenes.Pose(((cosine, sine), (sine, -cosine)), (b.x[t], b.y[t]))


def sheared(b: Any, t: Any) -> rcp.scenes.Pose:
    cosine, sine = pyo.cos(b.theta[t]), pyo.sin(b.theta[t])
    return rcp.scenes.Pose(((cosine, sine), (sine, cosine)), (b.x[t], b.y[t]))


def spatial(b: Any, t: Any) -> rcp.scenes.Pose:
    return rcp.spatial_pose((b.x[t], b.y[t], 0))


def kinked(b: Any, t: Any) -> rcp.scenes.Pose:
    return rcp.planar_pose(b.x[t], b.y[t], abs(b.theta[t]))


def jumping(b: Any, t: Any) -> rcp.scenes.Pose:
    return rcp.planar_pose(b.x[t], b.y[t], 0.1 if t > 0.5 else 0.0)


def start_is(number: Any) -> None:
    m = turning_move(elements=2, height=3)
    avoid = avoiding(m)
    m.move.y[0.5].set_value(number, skip_validation=True)
    avoid.initialize()


# A slot around the goal that leaves the arrow less than 20 cm.
SLOT = {"above": Polytope.box(3, 1, center=(4, 1.1)), "below": Polytope.box(3, 1, center=(4, -1.1))}

REFUSED = [
    # Corners.
    Entry(
        "corner that is not a number",
        lambda: Polytope.from_vertices([(0, 0), (1, np.nan), (0, 1)], name="car"),
        ["'car'", "not finite", "row 1", "nan"],
    ),
    Entry(
        "corner at infinity",
        lambda: Polytope.from_vertices([(0, 0), (np.inf, 0), (0, 1)], name="car"),
        ["'car'", "not finite", "row 1", "inf"],
    ),
    Entry("words", lambda: Polytope.from_vertices([("a", "b")], name="car"), ["'car'", "points of numbers"]),
    Entry("no corners", lambda: Polytope.from_vertices([], name="car"), ["'car'", "(0,)", "one row per point"]),
    Entry(
        "corners in four dimensions",
        lambda: Polytope.from_vertices(np.eye(5, 4), name="car"),
        ["'car'", "(5, 4)", "2 or 3 coordinates"],
    ),
    Entry(
        "corners of different dimensions",
        lambda: Polytope.from_vertices([(0, 0), (1, 0, 0)], name="car"),
        ["'car'", "no list of points"],
    ),
    Entry(
        "corners on a line",
        lambda: Polytope.from_vertices([(0, 0), (1, 1), (2, 2)], name="car"),
        ["'car'", "3 distinct points", "a line", "needs 3 points", "allow_flat=True"],
    ),
    Entry(
        "corners in a plane in space",
        lambda: Polytope.from_vertices([(0, 0, 1), (1, 0, 1), (0, 1, 1)], name="car"),
        ["'car'", "a plane", "needs 4 points", "allow_flat=True"],
    ),
    Entry(
        "outline that is not convex",
        lambda: Polytope.from_vertices(NOTCHED, name="car"),
        ["'car'", "not convex", "point 3", "decompose(outline)", "Polytope.hull"],
    ),
    Entry(
        "outline that crosses itself",
        lambda: Polytope.from_vertices([SQUARE[k] for k in (0, 2, 1, 3)], name="car"),
        ["'car'", "crosses itself", "in order", "Polytope.hull"],
    ),
    Entry(
        "outline to be cut that crosses itself",
        lambda: rcp.scenes.decompose([SQUARE[k] for k in (0, 2, 1, 3)], name="car"),
        ["'car'", "Self-intersection", "in order"],
    ),
    Entry("padding below zero", lambda: Polytope.ball(-1.0, name="car"), ["'car'", "-1.0", "not negative"]),
    Entry(
        "padding in words",
        lambda: Polytope.from_vertices(SQUARE, radius="wide", name="car"),
        ["'car'", "'wide'", "finite length"],
    ),
    Entry("side of no length", lambda: Polytope.box(1, 0, name="car"), ["'car'", "(1, 0)", "positive length"]),
    Entry("side in words", lambda: Polytope.box(1, "wide", name="car"), ["'car'", "'wide'", "positive length"]),
    # Half-spaces.
    Entry(
        "row of zeros",
        lambda: Polytope.from_halfspaces([[1, 0], [0, 0]], [1, 1], name="wall"),
        ["'wall'", "row 1", "zero"],
    ),
    Entry(
        "all normals inwards: an empty set",
        lambda: Polytope.from_halfspaces([[-1, 0], [1, 0], [0, -1], [0, 1]], [-1, -1, -1, -1], name="wall"),
        ["'wall'", "is empty", "point outwards", "signs"],
    ),
    Entry(
        "set without interior",
        lambda: Polytope.from_halfspaces([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, -1, 1, 1], name="wall"),
        ["'wall'", "no interior"],
    ),
    Entry(
        "missing side: a set without end",
        lambda: Polytope.from_halfspaces([[1, 0], [0, 1], [-1, 0]], [1, 1, 1], name="wall"),
        ["'wall'", "no end in the direction", "bounded=False"],
    ),
    Entry(
        "offset that is not a number",
        lambda: Polytope.from_halfspaces([[1, 0], [-1, 0]], [1, np.nan], name="wall"),
        ["'wall'", "finite offsets", "nan"],
    ),
    Entry(
        "offsets in words",
        lambda: Polytope.from_halfspaces([[1, 0], [-1, 0]], [1, "far"], name="wall"),
        ["'wall'", "offsets", "'far'"],
    ),
    Entry(
        "offsets that do not fit",
        lambda: Polytope.from_halfspaces([[1, 0], [-1, 0]], [1], name="wall"),
        ["'wall'", "2 normals", "as many"],
    ),
    # Bodies and poses.
    Entry(
        "points in place of a shape",
        lambda: rcp.Body(SQUARE),
        ["(1, 1)", "expected a Polytope", "from_vertices", "decompose"],
    ),
    Entry(
        "pose in place of a rule",
        lambda: rcp.Body(ARROW, pose=rcp.planar_pose(1, 2)),
        ["'arrow'", "function of (block, t)", "placed"],
    ),
    Entry("rule that returns numbers", lambda: moving(lambda b, t: (0, 1)), ["'arrow'", "(0, 1)", "planar_pose"]),
    Entry("rule that returns nothing", lambda: moving(lambda b, t: None), ["'arrow'", "None", "planar_pose"]),
    Entry("pose in space of a body in the plane", lambda: moving(spatial), ["'arrow'", "2 dim", "3", "planar_pose"]),
    Entry(
        "obstacle in space, body in the plane",
        lambda: moving(placed, obstacles={"crate": Polytope.box(1, 1, 1)}),
        ["'arrow' has dimension 2", "'crate' has dimension 3", "all in space"],
    ),
    Entry(
        "pose that mirrors", lambda: guessed(mirrored), ["'arrow'", "mirrors", "determinant", "signs", "right-handed"]
    ),
    Entry(
        "pose that mirrors, in a solve", lambda: solved(bodies={"arrow": rcp.Body(ARROW, pose=mirrored)}), ["mirrors"]
    ),
    Entry("pose that shears", lambda: guessed(sheared), ["'arrow'", "differs from the identity by", "signs"]),
    Entry("guess that is not a number", lambda: start_is(np.nan), ["'arrow' at 0.5", "not finite"]),
    Entry("guess that is missing", lambda: start_is(None), ["'arrow' at 0.5", "'move.y[0.5]'", "no value", "guess"]),
    Entry(
        "pose that reads a control",
        lambda: moving(lambda b, t: rcp.planar_pose(b.x[t], b.u[t])),
        ["'arrow'", "move.u", "states"],
    ),
    Entry(
        "nothing that moves",
        lambda: avoiding(turning_move(elements=2), bodies={"arrow": ARROW}),
        ["'arrow'", "nothing moves", "pose=rule"],
    ),
    Entry("no set of times", lambda: moving(placed, points=None), ["None", "set of times", "phase.time"]),
    Entry(
        "pose of a function with a kink",
        lambda: solved(bodies={"arrow": rcp.Body(ARROW, pose=kinked)}),
        ["'arrow'", "the function 'abs'", "sin, cos"],
    ),
    Entry(
        "pose that asks for the time",
        lambda: solved(bodies={"arrow": rcp.Body(ARROW, pose=jumping)}),
        ["'arrow'", "of t", "'if'"],
    ),
    # Clearances.
    Entry("no clearance", lambda: moving(placed, clearance=None), ["clearance= is missing", "length > 0"]),
    *(
        Entry(
            f"clearance of {clearance!r}",
            lambda clearance=clearance: moving(placed, clearance=clearance),
            ["'arrow' and 'wall'", repr(clearance), "length > 0", "tolerance"],
        )
        for clearance in (0, -0.1, float("nan"), float("inf"), "small")
    ),
    Entry(
        "clearance within a solver's tolerance",
        lambda: solved(clearance=9e-5),
        [
            "'move.avoid'",
            "'arrow' and 'wall'",
            "9e-05",
            "100 times",
            "1e-06",
            "unit of length",
            "feasibility_tolerance",
        ],
    ),
    Entry(
        "slot at the goal that is too narrow for the clearance",
        lambda: guessed(placed, obstacles=SLOT, clearance=0.3),
        ["'arrow' and 'above'", "at t = 1.0", "poses are fixed", "clearance is 0.3", "Ask for less than 0.1"],
    ),
    Entry(
        "slot that is too narrow, in a solve",
        lambda: solved(obstacles=SLOT, clearance=0.3),
        ["'arrow' and 'above'", "Ask for less than 0.1"],
    ),
    Entry(
        "goal inside an obstacle",
        lambda: solved(obstacles={"post": Polytope.box(1, 1, center=(4, 0))}),
        ["'arrow' and 'post'", "into each other at t = 1.0", "clearance is 0.05", "Move the fixed pose"],
    ),
    Entry(
        "two moving bodies that start on each other",
        lambda: solved(bodies={name: rcp.Body(ARROW, pose=placed) for name in ("arrow", "twin")}),
        ["'arrow' and 'twin'", "into each other at t = 0.0"],
    ),
]


def parameter(entry: Entry) -> Any:
    solves = "solved" in entry.state.__code__.co_names
    return pytest.param(entry, id=entry.what, marks=[pytest.mark.ipopt] if solves else [])


@pytest.mark.parametrize("entry", [parameter(entry) for entry in REFUSED])
def test_refused_by_name_with_numbers_and_remedy(entry: Entry) -> None:
    with pytest.raises(ModelError) as caught:
        entry.state()
    missing = [word for word in entry.words if word not in str(caught.value)]
    assert not missing, f"{missing} not in: {caught.value}"


def close_goal(m: pyo.ConcreteModel) -> None:
    avoiding(m, obstacles={"post": Polytope.box(1, 1, center=(4, 0))})


def small_clearance(m: pyo.ConcreteModel) -> None:
    avoiding(m, clearance=9e-5)


def pose_with_a_kink(m: pyo.ConcreteModel) -> None:
    avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=kinked)})


@pytest.mark.ipopt
@pytest.mark.parametrize("state", [close_goal, small_clearance, pose_with_a_kink])
def test_a_solve_that_is_refused_changes_nothing(state: Callable[[pyo.ConcreteModel], None]) -> None:
    m = turning_move(elements=2, height=3)
    state(m)
    before = [(variable, variable.value) for variable in m.component_data_objects(pyo.Var)]
    names = [component.name for component in m.component_objects()]
    with pytest.raises(rcp.errors.ObstacleError):
        rcp.solve(m)
    assert [(variable, variable.value) for variable in m.component_data_objects(pyo.Var)] == before
    assert [component.name for component in m.component_objects()] == names
    assert m.effort.active


@pytest.mark.ipopt
def test_a_tighter_tolerance_allows_a_smaller_clearance() -> None:
    m = turning_move(elements=2, height=3)
    small_clearance(m)
    options = {"tol": 1e-9, "constr_viol_tol": 1e-9}
    assert rcp.solve(m, feasibility_tolerance=1e-8, options=options).quality is not rcp.Quality.INFEASIBLE


@pytest.mark.parametrize(
    "pose",
    [lambda b, t: (0, 1), lambda b, t: rcp.planar_pose(b.nothing[t], 0), spatial],
    ids=["numbers", "missing variable", "dimension"],
)
def test_a_rule_that_fails_leaves_nothing_half_built(pose: Any) -> None:
    m = turning_move(elements=2)
    with pytest.raises((rcp.errors.ObstacleError, AttributeError)):
        avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=pose)})
    assert m.move.component("avoid") is None


def free_quaternion() -> None:
    m = pyo.ConcreteModel()
    m.q = pyo.Var(range(4), [0, 1], initialize=lambda m, k, t: 1.0 if k == 0 else 0.0)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        [0, 1],
        bodies={
            "drone": rcp.Body(
                Polytope.box(1, 1, 1),
                pose=lambda m, t: rcp.spatial_pose((0, 0, 5), quaternion=[m.q[k, t] for k in range(4)]),
            )
        },
        obstacles=[Polytope.box(1, 1, 1)],
        clearance=0.1,
    )
    m.avoid.initialize()


CRATE = Polytope.box(2, 2, center=(2, 9))
TOLD = [
    Entry(
        "corner given twice",
        lambda: Polytope.from_vertices([SQUARE[0], *SQUARE], name="car"),
        ["WARNING", "'car'", "1 of its points are repeated"],
    ),
    Entry(
        "corner that is none",
        lambda: Polytope.from_vertices([(0, 0), (0.5, 0), (1, 0), (0, 1)], name="car"),
        ["WARNING", "'car'", "1 of its 4 points are no corners"],
    ),
    Entry(
        "point inside, in space",
        lambda: Polytope.from_vertices([*Polytope.box(1, 1, 1).vertices, (0, 0, 0.1)], name="car"),
        ["WARNING", "'car'", "1 of its 9 points are no corners"],
    ),
    Entry(
        "row that cuts nothing off",
        lambda: Polytope.from_halfspaces([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]], [1, 1, 1, 1, 5], name="wall"),
        ["WARNING", "'wall'", "cut nothing off", "rows [4]"],
    ),
    Entry("degrees", lambda: guessed(placed, turn=90.0), ["WARNING", "'arrow'", "an angle of its pose", "radians"]),
    Entry(
        "quaternion of any length", free_quaternion, ["WARNING", "'drone'", "length one", "q[0,", "Add the equation"]
    ),
    Entry(
        "sizes that differ by much",
        lambda: moving(placed, obstacles={"ground": Polytope.box(1e4, 1, center=(0, -5))}),
        ["WARNING", "'ground'", "1.11e+04 times as large as 'arrow'", "Cut it"],
    ),
    Entry(
        "obstacles that overlap",
        lambda: moving(placed, obstacles={"one": CRATE, "two": CRATE}),
        ["INFO", "'one' and 'two'", "stand still and overlap"],
    ),
]


@pytest.mark.parametrize("entry", TOLD, ids=lambda entry: entry.what)
def test_told_in_the_log(entry: Entry, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="pyrobocop_pyomo"):
        entry.state()
    missing = [word for word in entry.words if word not in caplog.text]
    assert not missing, f"{missing} not in: {caplog.text}"


def test_degrees_are_told_once_per_body(caplog: pytest.LogCaptureFixture) -> None:
    guessed(placed, turn=90.0)
    assert caplog.text.count("an angle of its pose") == 1


FINE = [
    Entry("outline either way", lambda: Polytope.from_vertices(SQUARE[::-1]), []),
    Entry("closed ring", lambda: Polytope.from_vertices([*SQUARE, SQUARE[0]]), []),
    Entry("rows of any length", lambda: Polytope.from_halfspaces([[2, 0], [-4, 0], [0, 1], [0, -3]], [2, 4, 1, 3]), []),
    Entry("open wedge on purpose", lambda: Polytope.from_halfspaces([[1, 0], [0, 1]], [0, 0], bounded=False), []),
    Entry("rod on purpose", lambda: Polytope.from_vertices([(0, 0), (1, 0)], allow_flat=True), []),
    Entry("outline to be cut", lambda: rcp.scenes.decompose(NOTCHED), []),
    Entry(
        "half-plane: endless, but no question of sizes",
        lambda: moving(placed, obstacles={"ground": Polytope.from_halfspaces([[0, 1]], [-5], bounded=False)}),
        [],
    ),
    Entry("two turns", lambda: guessed(placed, turn=4 * np.pi), []),
    Entry("clearance of NumPy", lambda: moving(placed, clearance=np.float64(0.1)), []),
]


@pytest.mark.parametrize("entry", FINE, ids=lambda entry: entry.what)
def test_what_is_fine_is_not_talked_about(entry: Entry, caplog: pytest.LogCaptureFixture) -> None:
    entry.state()
    assert caplog.text == ""


def test_half_spaces_are_normalised() -> None:
    normals, offsets = Polytope.from_halfspaces([[2, 0], [-4, 0], [0, 1], [0, -3]], [2, 4, 1, 3]).halfspaces
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert offsets == pytest.approx(1.0)


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
