"""The physical score passes a plan that was made by hand from the laws of motion, and finds every fault put into it."""

import itertools
import math
import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.mechanics.plan_score import PhysicalScore, PlannedBody

planar = rcp.mechanics.planar
GROUND = planar.GroundFriction(coefficient=0.2, lever=0.25)
ROD = planar.RigidBody(planar.Capsule(radius=0.05, half_length=0.45), mass=2.0, inertia=2 / 12, resistance=GROUND)
DISC = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=10.0, speed_limit=3.0)
STEP, STEPS, SQUEEZE = 0.07, 20, 6.0
SCORE = planar.Score(ROD, DISC, friction=0.5, step=STEP, goal=(0.35, 0.0, 0.0))

Plans = dict[str, dict[str, np.ndarray]]


def carrying(length: float = 0.35, squeeze: float = SQUEEZE, share_of_sine: float = 1.0) -> Plans:
    """Two robots press a rod from both sides and carry it along its axis, by friction alone.

    The speed rises and falls like a sine; forces follow from it by Newton's law on implicit Euler steps.
    """
    speed = np.sin(np.linspace(0, share_of_sine * math.pi, STEPS + 1))
    speed *= length / (STEP * speed[1:].sum())
    path = STEP * np.concatenate([[0.0], np.cumsum(speed[1:])])
    acceleration = np.diff(speed) / STEP
    still = np.zeros(STEPS + 1)
    friction = 0.2 * 2.0 * 9.81 * speed[1:] / np.sqrt(speed[1:] ** 2 + 0.05**2)
    share = (2.0 * acceleration + friction) / 2
    rod = {"qx": path, "qy": still, "qth": still, "ux": speed, "uy": still, "uth": still}
    plans: Plans = {"rod": {f"body.{name}": values for name, values in rod.items()}}
    beside = math.sqrt(0.15**2 - 1e-6)
    for name, side in (("left", 1.0), ("right", -1.0)):
        # The tangent is the normal turned left: on the left side it points backwards.
        along = side * share
        robot = {
            "x": path,
            "y": still + side * beside,
            "vx": speed,
            "vy": still,
            "tau_x": acceleration + share,
            "tau_y": np.full(STEPS, -side * squeeze),
            "c": np.full(STEPS, squeeze),
            "alpha_plus": np.maximum(along, 0.0),
            "alpha_minus": np.maximum(-along, 0.0),
        }
        plans[name] = {f"me.{component}": values for component, values in robot.items()}
    return plans


def test_a_plan_made_by_hand_passes() -> None:
    score = SCORE(carrying())
    assert score.strict
    assert score.practical
    assert score.misses("strict") == []
    # The smoothed normal is shorter than 1 by 2e-5.
    assert score.object_force < 5e-4
    assert score.object_moment < 1e-10
    assert score.robot_force < 5e-4
    assert max(score.gap_product, score.friction_product, score.separation_product) < 1e-9
    assert score.goal_distance < 1e-4
    assert score.goal_angle < 1e-9
    assert score.distance == pytest.approx(0.3, abs=1e-4)
    assert "physical score: strict" in str(score)


def change(name: str, components: str, by: Callable[[np.ndarray], np.ndarray]) -> Callable[[Plans], None]:
    def put(plans: Plans) -> None:
        for component in components.split():
            plans[name][component] = by(plans[name][component])

    return put


driven_less = change("left", "me.tau_x", lambda tau: tau - 0.1)


def friction_flipped(plans: Plans) -> None:
    left = plans["left"]
    left["me.alpha_plus"], left["me.alpha_minus"] = left["me.alpha_minus"], left["me.alpha_plus"]


def pulling(plans: Plans) -> None:
    for name in ("left", "right"):
        change(name, "me.c me.tau_y", np.negative)(plans)


FAULTS = {
    "no force": (change("left", "me.c me.alpha_plus me.alpha_minus", np.zeros_like), "force missing to the object"),
    "moved away": (change("left", "me.y", lambda y: y + 0.01), "force times gap"),
    "moved in": (change("left", "me.y", lambda y: y - 0.01), "penetration"),
    "moved once": (change("left", "me.x", lambda x: x + 0.01 * np.eye(STEPS + 1)[7]), "force missing to the robots"),
    "friction flipped": (friction_flipped, "force missing to the object"),
    # Both unknowns grow: their difference, and so the motion, stays.
    "beyond the cone": (change("left", "me.alpha_plus me.alpha_minus", lambda a: a + 2.0), "outside the friction cone"),
    "pulling": (pulling, "outside the friction cone"),
    # The rod is planned to go faster than its pushers drive it: its robots slip.
    "object elsewhere": (change("rod", "body.qx", lambda x: 1.2 * x), "force missing to the object"),
    "driven less": (driven_less, "force missing to the robots"),
}
GRAVE = ("no force", "moved away", "friction flipped", "pulling")


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_found(name: str) -> None:
    spoil, found = FAULTS[name]
    plans = carrying()
    spoil(plans)
    score = SCORE(plans)
    assert not score.strict
    assert not (score.practical and name in GRAVE)
    assert any(found in miss for miss in score.misses("strict")), str(score)


STRONG = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=1e3, speed_limit=3.0)
FAST = planar.DiscRobot(planar.Disc(0.1), mass=1.0, force_limit=1e3, speed_limit=100.0)


@pytest.mark.parametrize(
    ("robot", "plans", "length", "found"),
    [
        (DISC, carrying(squeeze=200.0), 0.35, ["driving force beyond its limit (-): 190 N"]),
        (STRONG, carrying(9.0, squeeze=200.0), 9.0, ["speed of a robot beyond its limit (-): 7.1"]),
        (
            FAST,
            carrying(9.0, squeeze=200.0, share_of_sine=0.5),
            9.0,
            ["speed at the end (simulated): 9.7", "speed of a robot at the end (-): 9.7"],
        ),
    ],
    ids=["200 N at a limit of 10 N", "10 m/s at a limit of 3 m/s", "the goal reached at 10 m/s"],
)
def test_a_motion_that_obeys_newton_but_not_the_task_is_refused(
    robot: planar.DiscRobot, plans: Plans, length: float, found: list[str]
) -> None:
    """Nothing else is wrong with these plans: robots that may do so make them strict."""
    task = planar.Score(ROD, robot, friction=0.5, step=STEP, goal=(length, 0.0, 0.0))
    score = task(plans)
    assert not score.practical
    misses = score.misses("strict")
    assert [miss.startswith(start) for miss, start in zip(misses, found, strict=True)] == [True] * len(found), misses
    assert replace(task, robot=FAST, rest_at_end=False)(plans).strict


def test_bounds_of_the_agents_are_kept() -> None:
    plans = carrying()
    bounds = {"left": {"me.x": (0.0, None)}, "rod": {"body.qx": (0.0, 0.3)}}
    assert SCORE(plans).bound_excess == 0.0
    score = replace(SCORE, bounds=bounds)(plans)
    assert score.bound_excess == pytest.approx(0.05)
    assert not score.practical
    for wrong in ({"up": {"me.x": (0.0, 1.0)}}, {"left": {"me.z": (0.0, 1.0)}}):
        with pytest.raises(TrajectoryError, match=r"bounds for 'up'|has no 'me\.z'"):
            replace(SCORE, bounds=wrong)(plans)


@pytest.mark.parametrize("component", ["me.tau_x", "me.c", "me.x", "me.vx"])
def test_a_number_that_is_none_keeps_no_limit(component: str) -> None:
    plans = carrying()
    plans["right"][component] = plans["right"][component] * math.nan
    score = SCORE(plans)
    assert not score.strict
    assert any("nan" in miss for miss in score.misses("strict"))


@settings(max_examples=15)
@given(turn=st.floats(-3, 3), x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_the_score_does_not_depend_on_where_the_scene_is(turn: float, x: float, y: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    plans = carrying()
    driven_less(plans)
    for plan in plans.values():
        for first, second, shift in (("body.qx", "body.qy", (x, y)), ("body.ux", "body.uy", (0, 0)),
                                     ("me.x", "me.y", (x, y)), ("me.vx", "me.vy", (0, 0)),
                                     ("me.tau_x", "me.tau_y", (0, 0))):  # fmt: skip
            if first in plan:
                a, b = plan[first], plan[second]
                plan[first], plan[second] = c * a - s * b + shift[0], s * a + c * b + shift[1]
        if "body.qth" in plan:
            plan["body.qth"] = plan["body.qth"] + turn
    moved = planar.Score(ROD, DISC, friction=0.5, step=STEP, goal=(x + c * 0.35, y + s * 0.35, turn))(plans)
    straight = carrying()
    driven_less(straight)
    expected = SCORE(straight)
    products = ("gap_product", "friction_product", "separation_product")
    for name in ("object_force", "robot_force", "goal_distance", "distance", "penetration", *products):
        assert getattr(moved, name) == pytest.approx(getattr(expected, name), abs=1e-7)


def test_the_goal_may_be_a_region_or_left_out() -> None:
    plans = carrying()
    for goal, distance in (((0.5, 0.0, 0.0), 0.15), (((0.3, 0.4), None, None), 0.0), (((0.4, 0.5), None, 0.0), 0.05)):
        score = planar.Score(ROD, DISC, friction=0.5, step=STEP, goal=goal)(plans)
        assert score.goal_distance == pytest.approx(distance, abs=1e-4)
    full_turn = planar.Score(ROD, DISC, friction=0.5, step=STEP, goal=(0.35, 0.0, 2 * math.pi))(plans)
    assert full_turn.goal_angle == pytest.approx(0.0, abs=1e-9)


def at_rest(twist: Any = (0.0, 0.0, 0.0)) -> PlannedBody:
    """At the origin, or moving there."""
    return PlannedBody(np.zeros((1, 2)), np.eye(2)[None], np.array(twist))


@given(
    twist=st.tuples(*3 * [st.floats(-4, 4)]),
    wrench=st.tuples(*3 * [st.floats(-30, 30)]),
    resistance=st.sampled_from([GROUND, planar.ViscousDrag(linear=2.0, angular=0.1)]),
)
def test_every_step_of_the_simulation_meets_newtons_law(twist: tuple, wrench: tuple, resistance: Any) -> None:
    """However stiff friction is near rest."""
    score = replace(SCORE, body=replace(ROD, resistance=resistance))
    speeds = score.simulate(at_rest(twist), np.tile(wrench, (3, 1))).twist(STEP)
    for before, after in itertools.pairwise(speeds):
        needed = np.array([2.0, 2.0, 2 / 12]) * (after - before) / STEP
        assert needed == pytest.approx(np.array(wrench) + resistance.wrench(2.0, *after), abs=1e-8)


def test_the_simulation_meets_the_rows_that_a_phase_states() -> None:
    """Two implementations of one step: the rows of the model, and Newton's iteration of the score."""
    random = np.random.default_rng(3)
    wrench = random.normal(size=(6, 3)) * (8.0, 8.0, 2.0)
    moved = SCORE.simulate(at_rest(), wrench)
    twist = moved.twist(STEP)
    poses = np.column_stack([moved.position, STEP * np.cumsum(twist[:, 2])])
    m = pyo.ConcreteModel()
    grid: Any = {"duration": 6 * STEP, "elements": 6, "scheme": "implicit_euler"}
    m.push = rcp.PhaseBlock(rule=ROD.state_wrench, **grid)
    m.body = rcp.PhaseBlock(**grid)
    ROD.state_motion(m.body, [m.push], start=(0.0, 0.0, 0.0))
    for phase, names, values in ((m.body, ("qx", "qy", "qth"), poses), (m.body, ("ux", "uy", "uth"), twist),
                                 (m.push, ("fx", "fy", "mz"), wrench)):  # fmt: skip
        for name, column in zip(names, values.T, strict=True):
            for variable, value in zip(phase.component(name).values(), column, strict=True):
                variable.set_value(value, skip_validation=True)
    rows = list(m.body.component_data_objects(pyo.Constraint))
    assert len(rows) == 36
    assert max(abs(pyo.value(row.body) - row.ub) for row in rows) < 1e-9


def test_scores_travel() -> None:
    assert pickle.loads(pickle.dumps(SCORE)) == SCORE
    assert pickle.loads(pickle.dumps(SCORE(carrying()))) == SCORE(carrying())


def test_a_plan_becomes_a_film(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    plans = carrying()
    film = SCORE.animate(plans, tmp_path / "carry", frames=3)
    assert film.name == "carry.gif"
    assert film.stat().st_size > 1000


def test_plans_that_cannot_be_read_are_refused() -> None:
    plans: Any = carrying()
    with pytest.raises(TrajectoryError, match=r"none of the plans of 'rod' has 'me\.x'"):
        SCORE({"rod": plans["rod"]})
    del plans["left"]["me.c"]
    with pytest.raises(TrajectoryError, match=r"the plan of 'left' has no 'me\.c'; it has me\.alpha_minus"):
        SCORE(plans)
    plans = carrying()
    plans["left"]["me.x"] = plans["left"]["me.x"][:-1]
    plans["left"]["me.y"] = plans["left"]["me.y"][:-1]
    with pytest.raises(TrajectoryError, match="has 21 poses, 'left' has 20 positions and 20 forces"):
        SCORE(plans)


def test_practical_asks_less_than_strict_where_both_ask() -> None:
    """So that a strict plan is practical, and ends the rounds of a team as a success."""
    for entry in fields(PhysicalScore):
        strict, practical = entry.metadata["strict"], entry.metadata["practical"]
        if practical is not None:
            assert strict >= practical if entry.name == "distance" else strict <= practical
