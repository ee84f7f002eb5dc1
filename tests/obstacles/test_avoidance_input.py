"""What makes no sense is refused by name, and leaves nothing behind."""

import math
import re

import networkx
import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, keep_clear, placed, turning_move

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

STILL = rcp.Body(WALL)
ARROWS = {name: rcp.Body(ARROW, pose=placed) for name in ("arrow", "other")}

BAD = {
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
    "between": ({"between": "nodes"}, "'nodes'"),
    "broad phase below clearance": ({"broad_phase": 0.05}, "nearer than the clearance"),
    "points that are no times": ({"points": ["a", "b"], "between": None}, "ordered numbers"),
    "times that do not increase": ({"points": [0.0, 1.0, 0.5]}, "increase"),
    "the phase as points": ({"points": lambda m: m.move}, "'move.time'"),
    "several sets": ({"points": lambda m: [m.move.time, m.move.points]}, "list of sets", "one block for each phase"),
    "no points": ({"points": lambda m: None}, "None", "set of times", r"phase\.time"),
    "corners as a shape": (
        {"obstacles": [np.array([(0, 0), (1, 0), (1, 1)])]},
        "'obstacle 1'",
        r"Polytope\.from_vertices",
    ),
    "a name as obstacles": ({"obstacles": "wall"}, "obstacles=", "dict of names"),
    "a pair as a body": ({"bodies": {"car": (ARROW, None)}}, "'car'", r"Body\(shape, pose=rule\)"),
    "a body that nothing moves": ({"bodies": {"car": ARROW}}, "'car'", "nothing moves", r"Body\(shape, pose=rule\)"),
    "no pose": ({"bodies": None, "body": ARROW}, "pose=rule", r"rule\(block, t\)"),
    "a mistyped keyword": ({"obstacle": {"wall": WALL}}, "Did you mean 'obstacles'"),
    "a cube in the plane": (
        {"obstacles": {"crate": rcp.Polytope.box(1, 1, 1)}},
        "'arrow' has dimension 2",
        "'crate' has dimension 3",
        "all in space",
    ),
    "no clearance": ({"clearance": None}, "clearance= is missing", "length > 0"),
    **{
        f"clearance {clearance}": (
            {"clearance": clearance},
            "'arrow' and 'wall'",
            repr(clearance),
            "length > 0",
            "tolerance",
        )
        for clearance in (0, math.nan, "small")
    },
}


@pytest.mark.parametrize("case", BAD)
def test_refused_by_name_and_nothing_left(case):
    given, *words = BAD[case]
    m = turning_move(elements=2)
    points = given.get("points", m.move.time)
    options = {**given, "points": points(m) if callable(points) else points}
    before = list(m.component_data_objects(descend_into=True)), set(m.move.component_map())
    with pytest.raises(ModelError) as caught:
        avoiding(m, **options)
    assert [word for word in words if re.search(word, str(caught.value), re.DOTALL) is None] == []
    assert (list(m.component_data_objects(descend_into=True)), set(m.move.component_map())) == before


def test_flat_bodies_are_fine_where_corners_suffice():
    m = turning_move(elements=2, height=3)
    rod = rcp.Polytope.from_vertices([(-0.5, 0), (0.5, 0)], allow_flat=True)
    avoiding(m, bodies={"rod": rcp.Body(rod, pose=placed)}).initialize()
    assert min(m.move.avoid.separation_gaps().values()) > 0.05


def test_pairs_by_graph_and_by_exclusion():
    m = turning_move(elements=1, stages=1)
    walls = {"a": WALL, "b": WALL}
    graph = networkx.Graph([("a", "arrow"), ("other", "arrow")])
    avoid = avoiding(m, bodies=ARROWS, obstacles=walls, body_pairs=graph)
    assert list(avoid.record.scene.clearances) == [("arrow", "other"), ("arrow", "a")]
    del m.move.avoid
    m.move.del_component("avoid")
    avoid = avoiding(m, bodies=ARROWS, obstacles=walls, exclude=[("other", "arrow"), ("a", "other")])
    assert list(avoid.record.scene.clearances) == [("arrow", "a"), ("arrow", "b"), ("other", "b")]


def test_shorthand_for_one_body():
    m = turning_move(elements=1, stages=1)
    keep_clear(m.move, ARROW, [WALL], placed, 0.1)
    assert list(m.move.avoid.record.scene.clearances) == [("body", "obstacle 1")]
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
