"""Paths for cars: free of collisions by an independent check, drivable, exact at their ends, the same every time."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles import hybrid_a_star
from pyrobocop_pyomo.contrib.vehicles.best_first_search import BestFirstSearch
from pyrobocop_pyomo.contrib.vehicles.car_kinematics import follow_arcs
from pyrobocop_pyomo.contrib.vehicles.car_path import CarPath
from pyrobocop_pyomo.contrib.vehicles.cost_to_go import CostToGo
from pyrobocop_pyomo.contrib.vehicles.free_space import FreeSpace
from pyrobocop_pyomo.contrib.vehicles.motion_primitives import CarSearch, MotionPrimitives
from pyrobocop_pyomo.contrib.vehicles.shortcuts import with_shortcuts
from pyrobocop_pyomo.contrib.vehicles.staged_search import staged_search
from pyrobocop_pyomo.errors import InitialGuessError, PathNotFound

from .car_scenes import CAR, PARALLEL, REVERSE, START, STEERING, WHEELBASE, is_free, least_distance, park, without_end

pytestmark = pytest.mark.heavy

# What the poses between two of the path's may be off, for rounding only: nothing is allowed for coarse checks.
ROUNDING = 1e-8


def assert_drivable(path: CarPath) -> None:
    """Each segment is the arc that its direction and steering say, recomputed from scratch."""
    assert np.all(np.isin(path.directions, (-1.0, 1.0)))
    assert np.all(np.abs(path.steering) <= STEERING + 1e-12)
    for before, after, direction, steering in zip(
        path.poses[:-1], path.poses[1:], path.directions, path.steering, strict=False
    ):
        curvature = math.tan(steering) / WHEELBASE
        turn = after[2] - before[2]
        middle = 0.5 * (before[2] + after[2])
        chord = (after[:2] - before[:2]) @ [math.cos(middle), math.sin(middle)]
        across = (after[:2] - before[:2]) @ [-math.sin(middle), math.cos(middle)]
        assert chord * direction > 0
        assert across == pytest.approx(0.0, abs=1e-8)
        # An arc of length s with this curvature turns by s * curvature; its chord is 2 sin(turn / 2) / curvature.
        assert curvature * chord == pytest.approx(2.0 * math.sin(0.5 * turn), abs=1e-8)


def assert_ends(path: CarPath, start: Any, goal: Any) -> None:
    assert path.poses[0].tolist() == list(start)
    assert path.poses[-1, :2].tolist() == list(goal[:2])
    turns = (path.poses[-1, 2] - goal[2]) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-12)
    assert np.abs(np.diff(path.poses[:, 2])).max() < 0.5  # no jump by a turn


@pytest.mark.parametrize(
    ("scene", "clearance"), [(REVERSE, 0.15), (PARALLEL, 0.05), (PARALLEL, 0.15)], ids=["reverse", "parallel", "close"]
)
def test_a_car_is_parked(scene: Any, clearance: float) -> None:
    path = park(scene=scene, clearance=clearance)
    assert least_distance(path, scene["obstacles"]) >= clearance - ROUNDING
    assert_drivable(path)
    assert_ends(path, START, scene["goal"])
    x, y, _ = path.poses.T
    assert x.min() >= -15
    assert x.max() <= 15
    assert y.min() >= 1
    assert y.max() <= 10
    # No path is shorter than the straight line, and a good one has no detour of the size of the scene.
    assert math.dist(START[:2], scene["goal"][:2]) < path.length < 17
    assert path.cusps <= (1 if scene is REVERSE else 3 if clearance == 0.05 else 5)


@pytest.mark.parametrize("scene", [REVERSE, PARALLEL], ids=["reverse", "parallel"])
def test_a_car_is_parked_from_wherever_it_stands(scene: Any) -> None:
    rng = np.random.default_rng(7)
    tried = 0
    while tried < 2:
        start = (rng.uniform(-10, 10), rng.uniform(6.5, 9.5), rng.uniform(-math.pi, math.pi))
        if is_free(start, scene["obstacles"], 0.1):
            tried += 1
            path = park(start, scene)
            assert least_distance(path, scene["obstacles"], every=0.1) >= 0.1 - ROUNDING
            assert_drivable(path)
            assert_ends(path, start, scene["goal"])


def test_the_same_question_has_the_same_answer() -> None:
    first, second = park(scene=PARALLEL), park(scene=PARALLEL)
    for name in ("poses", "directions", "steering"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_a_start_that_is_tight_as_well_is_left_with_finer_primitives() -> None:
    """Across a lane that is a metre longer than the car, the motion primitives of the first search lead nowhere."""
    start = (7.148, 6.6, 1.443)
    path = park(start)
    assert least_distance(path, REVERSE["obstacles"], every=0.1) >= 0.1 - ROUNDING
    assert_ends(path, start, REVERSE["goal"])


def test_lengths_in_another_unit_give_the_same_path() -> None:
    """Everything in centimetres: all that the search chooses by itself grows along."""
    scale = 100.0
    obstacles = {name: replace(shape, vertices=shape.vertices * scale) for name, shape in REVERSE["obstacles"].items()}
    goal = (REVERSE["goal"][0] * scale, REVERSE["goal"][1] * scale, REVERSE["goal"][2])
    path = park(
        (START[0] * scale, START[1] * scale, START[2]), {"goal": goal, "obstacles": obstacles}, 0.1 * scale,
        body=rcp.Polytope.from_vertices(CAR.vertices * scale), wheelbase=WHEELBASE * scale,
        bounds=((-15 * scale, 15 * scale), (1 * scale, 10 * scale)),
    )  # fmt: skip
    reference = park()
    assert path.length == pytest.approx(reference.length * scale, rel=1e-6)
    assert path.cusps == reference.cusps


def test_without_obstacles_the_shortest_path_is_found() -> None:
    ahead = park((0, 2, 0), {"goal": (8, 2, 0), "obstacles": []})
    assert ahead.length == pytest.approx(8.0, abs=1e-9)
    assert ahead.cusps == 0
    assert np.abs(ahead.steering).max() == 0.0


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_a_heading_is_reached_with_its_whole_turns_where_they_count(turns: int) -> None:
    goal = (3.0, 8.0, 2.0 + 2 * math.pi * turns)
    options: dict[str, Any] = {"obstacles": {}, "bounds": ((-15, 15), (-15, 15))}
    path = park(scene={"goal": goal}, search=CarSearch(whole_turns=True), **options)
    assert path.poses[-1].tolist() == list(goal)
    assert_drivable(path)
    assert_ends(path, START, goal)
    # It costs nothing where the easiest path ends there.
    easiest = park(scene={"goal": goal}, **options)
    assert path.length >= easiest.length - 1e-9
    assert path.length < easiest.length + 1e-9 or easiest.poses[-1, 2] != goal[2]


def test_shortcuts_take_out_what_goes_back_and_forth() -> None:
    """A path out of the slot that shunts three times for nothing."""
    walls = REVERSE["obstacles"]
    primitives = MotionPrimitives.of(WHEELBASE, STEERING, CarSearch())
    limits = ((-15.0, 15.0), (1.0, 10.0))
    space = FreeSpace.around(CAR, list(walls.values()), 0.05, 30.0)
    cost_to_go = CostToGo.to(np.array(START), limits, CAR, list(walls.values()), 0.05, primitives, 30.0)
    search = BestFirstSearch(np.array([0.0, 1.3, math.pi / 2]), limits, primitives, 1.5, space, cost_to_go)
    lengths = np.repeat([2.0, -1.0, 2.0, -1.0, 2.0], 20) / 20
    bent, bends = with_shortcuts(search, lengths, np.zeros(100))
    assert bent.sum() == pytest.approx(4.0, abs=1e-6)
    assert np.abs(bent).sum() == pytest.approx(4.0, abs=1e-6)
    ends = [follow_arcs(search.root, *arcs)[-1] for arcs in ((lengths, np.zeros(100)), (bent, bends))]
    np.testing.assert_allclose(*ends, atol=1e-6)


def test_padded_flat_and_pointlike_shapes_are_kept_clear_of() -> None:
    body = rcp.Polytope.capsule((0.0, 0.0), (2.7, 0.0), 0.9)
    obstacles = [
        rcp.Polytope.ball(0.8, (0.0, 5.0)),
        rcp.Polytope.point((-4.0, 4.0)),
        rcp.Polytope.capsule((4.0, 2.0), (4.0, 6.5), 0.0),
        rcp.Polytope.regular_polygon(5, 1.0, (8.0, 7.0)).padded(0.3),
    ]
    path = park((-9, 5, 0), {"goal": (11, 4, 0), "obstacles": obstacles}, 0.2, body=body)
    assert least_distance(path, obstacles, body) >= 0.2 - ROUNDING


def test_an_end_in_collision_is_refused_with_what_is_there() -> None:
    with pytest.raises(
        InitialGuessError, match=r"at the start .*'car' collides with 'wall': it is only 0\.0[0-9]* away.*0\.1"
    ):
        park((-6.0, 9.95, 0.0))
    with pytest.raises(InitialGuessError, match=r"at the goal .*collides with 'left': it overlaps it by 0\.2"):
        park(scene={**REVERSE, "goal": (-0.5, 1.3, math.pi / 2)})
    boxes = [rcp.Polytope.box(1, 1, center=(20, 20)), rcp.Polytope.box(1, 1, center=(-6, 9.5))]
    with pytest.raises(InitialGuessError, match="collides with 'obstacle 2'"):
        park(scene={**REVERSE, "obstacles": boxes})


# As long as the car and a little: it may shunt, but neither turn nor get out, though a disc could.
BOX = {
    "behind": without_end([[1, 0]], [-3.9]), "ahead": without_end([[-1, 0]], [-3.9]),
    "below": without_end([[0, 1]], [-1.15]), "above": without_end([[0, -1]], [-1.15]),
}  # fmt: skip


def test_where_there_is_no_path_it_says_so() -> None:
    gate = {"gate": rcp.Polytope.box(4, 1, center=(0, 6.2))}
    with pytest.raises(InitialGuessError, match="no way even for a disc"):
        park(scene={**REVERSE, "obstacles": REVERSE["obstacles"] | gate})
    with pytest.raises(InitialGuessError, match=r"no path was found: from the goal, \d+ poses"):
        park(
            (0.1, 0, math.pi), {"goal": (0, 0, 0), "obstacles": BOX}, bounds=((-2, 5), (-2, 2)),
            search=rcp.scenes.CarSearch(refinements=0),
        )  # fmt: skip
    with pytest.raises(PathNotFound, match=r"and 1e-06 seconds"):
        park(time_limit=1e-6)


def test_a_search_ends_after_its_expansions_whatever_they_find(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all levels and of both ends together, and of all stages: where a car has no room to turn."""
    counted: list[BestFirstSearch] = []
    most = 7
    expand = BestFirstSearch._expand

    def counting(search: BestFirstSearch) -> None:
        counted.append(search)
        expand(search)

    monkeypatch.setattr(BestFirstSearch, "_expand", counting)
    case: dict[str, Any] = {
        "body": CAR, "obstacles": BOX, "wheelbase": WHEELBASE, "steering_limit": STEERING, "clearance": 0.05,
        "search": CarSearch(max_expansions=most),
    }  # fmt: skip
    bounds = ((-2.0, 5.0), (-2.0, 2.0))
    with pytest.raises(PathNotFound) as one:
        hybrid_a_star((0.1, 0, math.pi), (0, 0, 0), bounds=bounds, **case)
    assert one.value.expansions == len(counted) <= most
    counted.clear()
    with pytest.raises(PathNotFound):
        staged_search((0.1, 0, math.pi), (0, 0, 0), regions=[bounds], **case)
    assert 0 < len(counted) <= most


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": (0, 9)}, r"the start is \(0, 9\)"),
        ({"start": (0, 10.5, 0)}, r"y = 10\.5, out of the bounds from 1 to 10"),
        ({"start": REVERSE["goal"]}, "the same pose"),
        ({"bounds": ((0, 0), (1, 2))}, "bounds ="),
        ({"wheelbase": 0.0}, "wheelbase = 0"),
        ({"steering_limit": 2.0}, "steering_limit = 2"),
        ({"clearance": -1.0}, "clearance = -1"),
        ({"time_limit": 0.0}, "time_limit = 0"),
        ({"body": without_end([[1, 0]], [0])}, "expected a bounded Polytope"),
        ({"body": rcp.Polytope.box(1, 1, 1)}, "in the plane"),
        ({"obstacles": {"cube": rcp.Polytope.box(1, 1, 1)}}, "obstacle 'cube'"),
    ],
)
def test_what_makes_no_sense_is_refused(options: Any, message: str) -> None:
    scene = {name: options.pop(name, REVERSE[name]) for name in ("goal", "obstacles")}
    with pytest.raises(InitialGuessError, match=message):
        park(options.pop("start", START), scene, options.pop("clearance", 0.1), **options)


@pytest.mark.parametrize("options", [{"cell": 0.0}, {"headings": 3}, {"steerings": 4}, {"heuristic_weight": math.inf}])
def test_a_search_that_makes_no_sense_is_refused(options: Any) -> None:
    with pytest.raises(InitialGuessError, match=f"CarSearch: .*{next(iter(options))} = "):
        rcp.scenes.CarSearch(**options)
