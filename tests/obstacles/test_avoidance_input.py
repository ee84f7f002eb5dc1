"""What makes no sense is refused by name, and leaves nothing behind."""

from __future__ import annotations

import logging

import networkx
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, placed, turning_move

import pyrobocop_pyomo as rcp

CUBE = rcp.Polytope.box(1, 1, 1)
SEGMENT = rcp.Polytope.from_vertices([(0, 3), (1, 3)], allow_flat=True)
STILL = rcp.Body(WALL)
ARROWS = {name: rcp.Body(ARROW, pose=placed) for name in ("arrow", "other")}

BAD = {
    "clearance zero": ({"clearance": 0}, "'arrow' and 'wall'.*length > 0"),
    "clearance negative": ({"clearance": -0.1}, "'arrow' and 'wall'"),
    "clearance not a number": ({"clearance": "small"}, "'arrow' and 'wall'"),
    "clearance infinite": ({"clearance": float("inf")}, "'arrow' and 'wall'"),
    "clearance missing for a pair": ({"bodies": ARROWS, "clearance": {("arrow", "wall"): 0.1}}, "'other'"),
    "clearance of nobody": ({"clearance": {("arrow", "wal"): 0.1}}, "'wal'.*'wall'"),
    "clearance of what is not watched": (
        {
            "bodies": ARROWS,
            "clearance": {("arrow", "wall"): 0.1, ("other", "wall"): 0.1},
            "body_pairs": [("arrow", "wall")],
        },
        "not watched",
    ),
    "no body": ({"bodies": {}}, "no body"),
    "no pair": ({"exclude": [("arrow", "wall")]}, "no body pair"),
    "pairs of nobody": ({"body_pairs": [("arrow", "nobody")]}, "'nobody'"),
    "pairs of one": ({"body_pairs": [("arrow", "arrow")]}, "two different"),
    "pairs of obstacles": (
        {"obstacles": {"a": WALL, "b": WALL}, "body_pairs": [("a", "b")]},
        "'a' and 'b', two obstacles",
    ),
    "pairs that stand still": (
        {"bodies": {**ARROWS, "rock": STILL}, "body_pairs": [("rock", "wall")]},
        "'rock' and 'wall', which both stand still",
    ),
    "exclude nobody": ({"exclude": [("arrow", "nobody")]}, "'nobody'"),
    "one name twice": ({"obstacles": {"arrow": WALL}}, "'arrow'"),
    "name of a part": ({"obstacles": {"wall": [WALL, WALL], "wall[1]": WALL}}, r"'wall\[1\]'"),
    "shape that is none": ({"obstacles": {"wall": "big"}}, "'wall' is 'big'"),
    "dimensions": ({"obstacles": {"wall": CUBE}}, "'arrow' has dimension 2, 'wall' has dimension 3"),
    "formulation": ({"formulation": "planes"}, "'planes'.*'plane'"),
    "norm": ({"norm": "cube"}, "'cube'"),
    "norm of offset": ({"formulation": "offset", "norm": "ball"}, "'offset'"),
    "between": ({"between": "nodes"}, "'nodes'"),
    "between for duals": ({"formulation": "dual", "between": "plane"}, "one pose at a time"),
    "broad phase below clearance": ({"broad_phase": 0.05}, "nearer than the clearance"),
    "flat for duals": ({"formulation": "dual", "obstacles": {"edge": SEGMENT}}, "'edge' is flat.*plane"),
    "unbounded for optimality": (
        {
            "formulation": "optimality",
            "obstacles": {"ground": rcp.Polytope.from_halfspaces([[0, 1]], [-1], bounded=False)},
        },
        "'ground' is unbounded",
    ),
    "names without intervals": ({"points": ["a", "b"], "between": "plane"}, "between=None"),
    "times that do not increase": ({"points": [0.0, 1.0, 0.5]}, "increase"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused_by_name_and_nothing_left(case):
    options, message = BAD[case]
    m = turning_move(elements=2)
    before = list(m.component_data_objects(descend_into=True)), set(m.move.component_map())
    with pytest.raises(rcp.errors.ObstacleError, match=f"(?s)'move.avoid'.*{message}|{message}"):
        avoiding(m, **options)
    assert (list(m.component_data_objects(descend_into=True)), set(m.move.component_map())) == before


def test_a_pose_that_fails_leaves_nothing():
    m = turning_move(elements=2)
    with pytest.raises(rcp.errors.ObstacleError, match="nothing"):
        avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=lambda b, t: rcp.planar_pose(b.nothing[t], 0))})
    assert m.move.component("avoid") is None


@pytest.mark.parametrize("formulation", ["plane", "mixed"])
def test_flat_bodies_are_fine_where_corners_suffice(formulation):
    m = turning_move(elements=2, height=3)
    rod = rcp.Polytope.from_vertices([(-0.5, 0), (0.5, 0)], allow_flat=True)
    avoiding(m, bodies={"rod": rcp.Body(rod, pose=placed)}, formulation=formulation).initialize()
    assert min(m.move.avoid.separation_gaps().values()) > 0.05


def test_fixed_poses_that_are_too_close_are_named_with_the_room_there_is():
    m = turning_move(elements=2)
    avoid = avoiding(m, obstacles={"post": rcp.Polytope.box(1, 1, center=(-1, 0))}, clearance={("post", "arrow"): 0.3})
    with pytest.raises(
        rcp.errors.ObstacleError, match=r"'arrow' and 'post' are only 0\.2 apart at t = 0\.0.*clearance is 0\.3.*0\.2"
    ):
        avoid.initialize()
    inside = turning_move(elements=2)
    avoid = avoiding(inside, obstacles={"post": rcp.Polytope.box(1, 1, center=(4, 0))})
    with pytest.raises(rcp.errors.ObstacleError, match=r"'arrow' and 'post' are .* into each other at t = 1\.0"):
        avoid.initialize()


def test_a_pose_without_value_is_named():
    m = turning_move(elements=2)
    avoid = avoiding(m)
    m.move.y[0.5].set_value(None)
    with pytest.raises(rcp.errors.ObstacleError, match=r"'arrow' at 0\.5 reads 'move\.y\[0\.5\]'"):
        avoid.initialize()


def test_a_mirrored_pose_is_refused():
    m = turning_move(elements=2)

    def mirrored(b, t):
        cosine, sine = pyo.cos(b.theta[t]), pyo.sin(b.theta[t])
        return rcp.scenes.Pose(((cosine, sine), (sine, -cosine)), (b.x[t], b.y[t]))

    avoid = avoiding(m, bodies={"arrow": rcp.Body(ARROW, pose=mirrored)})
    with pytest.raises(rcp.errors.ObstacleError, match="'arrow'.*mirrors"):
        avoid.initialize()


def rolling(unit_length):
    m = pyo.ConcreteModel()
    m.q = pyo.Var(range(4), [0, 1], initialize=lambda m, k, t: 1.0 if k == 0 else 0.0)
    if unit_length:
        m.length = pyo.Constraint([0, 1], rule=lambda m, t: sum(m.q[k, t] ** 2 for k in range(4)) == 1)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        [0, 1],
        body=CUBE,
        pose=lambda m, t: rcp.spatial_pose((0, 0, 5), quaternion=[m.q[k, t] for k in range(4)]),
        obstacles=[CUBE],
        clearance=0.1,
    )
    return m


def test_quaternions_without_an_equation_for_their_length_are_warned_about(caplog):
    kept = rolling(True)
    kept.avoid.initialize()
    assert caplog.text == ""
    free = rolling(False)
    free.avoid.initialize()
    assert "'body'" in caplog.text
    assert "length one" in caplog.text
    angles = turning_move(elements=2, height=3)
    caplog.clear()
    avoiding(angles).initialize()
    assert caplog.text == ""


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
@pytest.mark.parametrize("unit_length", [True, False])
def test_quaternions_of_a_phase_are_warned_about_although_their_ends_are_fixed(caplog, scheme, unit_length):
    m = pyo.ConcreteModel()
    m.fly = b = rcp.PhaseBlock(duration=1.0, elements=2, scheme=scheme, stages=2)
    b.w, b.z = rcp.State(initial=1, final=0.6, initial_guess=1), rcp.State(initial=0, final=0.8, initial_guess=0)
    b.rate, b.stretch = rcp.Control(), rcp.Control()
    b.ode(
        lambda b, t: {b.w: b.stretch[t] * b.w[t] - b.rate[t] * b.z[t], b.z: b.stretch[t] * b.z[t] + b.rate[t] * b.w[t]}
    )
    if unit_length:

        @b.constraint
        def length(b, t):
            return b.w[t] ** 2 + b.z[t] ** 2 == 1

    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        body=CUBE,
        pose=lambda b, t: rcp.spatial_pose((0, 0, 5), quaternion=(b.w[t], 0, 0, b.z[t])),
        obstacles=[CUBE],
        clearance=0.1,
    )
    b.avoid.initialize()
    assert ("length one" in caplog.text) == (not unit_length)


def test_sizes_that_cost_digits_are_warned_about(caplog):
    m = turning_move(elements=2)
    avoiding(m, obstacles={"ground": rcp.Polytope.box(1e4, 1, center=(0, -5))})
    assert "'ground' is 1.11e+04 times as large as 'arrow'" in caplog.text


def test_what_stands_still_and_overlaps_is_mentioned(caplog):
    m = turning_move(elements=2)
    with caplog.at_level(logging.INFO, logger="pyrobocop_pyomo"):
        avoiding(m, obstacles={"one": WALL, "two": WALL})
    assert "'one' and 'two' stand still and overlap" in caplog.text


def test_pairs_by_graph_and_by_exclusion():
    m = turning_move(elements=1, stages=1)
    walls = {"a": WALL, "b": WALL}
    graph = networkx.Graph([("a", "arrow"), ("other", "arrow")])
    avoid = avoiding(m, bodies=ARROWS, obstacles=walls, body_pairs=graph)
    assert avoid.record.scene.body_pairs == [("arrow", "other"), ("arrow", "a")]
    del m.move.avoid
    m.move.del_component("avoid")
    avoid = avoiding(m, bodies=ARROWS, obstacles=walls, exclude=[("other", "arrow"), ("a", "other")])
    assert avoid.record.scene.body_pairs == [("arrow", "a"), ("arrow", "b"), ("other", "b")]


def test_shorthand_for_one_body():
    m = turning_move(elements=1, stages=1)
    m.move.avoid = rcp.ObstacleAvoidanceBlock(m.move.time, body=ARROW, pose=placed, obstacles=[WALL], clearance=0.1)
    assert m.move.avoid.record.scene.body_pairs == [("body", "obstacle 1")]
    with pytest.raises(rcp.errors.ObstacleError, match="not both"):
        m.move.other = rcp.ObstacleAvoidanceBlock(m.move.time, body=ARROW, pose=placed, bodies=ARROWS, clearance=1)


def test_rules_take_index_sets_only_and_have_to_build():
    with pytest.raises(rcp.errors.ObstacleError, match="index sets only"):
        rcp.ObstacleAvoidanceBlock([1, 2], rule=lambda block, i: None, body=ARROW)
    with pytest.raises(rcp.errors.ObstacleError, match="one set of points"):
        rcp.ObstacleAvoidanceBlock([1, 2], [3], body=ARROW, pose=placed, clearance=1)
    m = pyo.ConcreteModel()
    with pytest.raises(rcp.errors.ObstacleError, match=r"block\.build"):
        m.avoid = rcp.ObstacleAvoidanceBlock([1, 2], rule=lambda block, i: None)
    assert m.component("avoid") is None
