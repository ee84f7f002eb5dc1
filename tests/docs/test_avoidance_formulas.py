"""The numbered formulas on separations and on planning in rounds, evaluated against the code."""

import itertools
import re
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import avoiding, placed, set_poses, turning_move
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles.initial_separations import _cheapest_path
from pyrobocop_pyomo.obstacles.tightening import tighten

from .code_blocks import ROOT

seeds = st.integers(0, 10**6)
PAGE = ROOT / "docs" / "explanation" / "obstacle-avoidance.md"


def gap(n: np.ndarray, p: np.ndarray, q: np.ndarray) -> float:
    return float((p @ n).min() - (q @ n).max())


def unit(random: np.random.Generator) -> np.ndarray:
    n = random.normal(size=2)
    return n / np.linalg.norm(n)


@pytest.mark.parametrize("where", ["plane", "space"])
def test_the_table_of_sizes(where: str) -> None:
    m = turning_move(elements=2, stages=1)
    box = rcp.Polytope.box(1, 1) if where == "plane" else rcp.Polytope.box(1, 1, 1)
    pose = (
        placed if where == "plane" else (lambda b, t: rcp.spatial_pose((b.x[t], b.y[t], 3), euler=(0, 0, b.theta[t])))
    )
    avoid = avoiding(m, between=None, bodies={"body": rcp.Body(box, pose)}, obstacles=[box])
    unknowns = sum(len(variable) for variable in avoid.component_objects(pyo.Var))
    rows = sum(1 for _ in avoid.component_data_objects(pyo.Constraint))
    counts = re.search(r"^\| \$d \+ 1\$ \|.*\| (\d+), (\d+) \| (\d+), (\d+) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert counts is not None
    of_page = [int(count) for count in counts.groups()]
    assert [unknowns / 3, rows / 3] == (of_page[:2] if where == "plane" else of_page[2:])


@given(seed=seeds, ends=st.tuples(st.booleans(), st.booleans()))
def test_sides_along_time(seed: int, ends: tuple[bool, bool]) -> None:
    """eq-normals: no other choice of candidates costs less."""
    random = np.random.default_rng(seed)
    segments = []
    for _ in range(3):
        shapes = [rcp.Polytope.hull(random.normal(size=(5, 2))) for _ in range(2)]
        segments.append(tuple(shapes))
    candidates = [np.array([unit(random) for _ in range(4)]) for _ in segments]
    before, after = (unit(random) if there else None for there in ends)

    def cost(normals: Any) -> float:
        sizes = [sum(float(np.ptp(side.vertices, axis=0).max()) for side in segment) for segment in segments]
        depth = sum(
            -gap(n, first.vertices, second.vertices) / (len(segments) * size)
            for n, (first, second), size in zip(normals, segments, sizes, strict=True)
        )
        way = [n for n in (before, *normals, after) if n is not None]
        turns = [np.arccos(np.clip(n @ other, -1, 1)) for n, other in itertools.pairwise(way)]
        return depth + sum(angle**2 for angle in turns)

    chosen = _cheapest_path(candidates, segments, before, after, np.zeros(2))
    assert cost(chosen) == pytest.approx(min(cost(choice) for choice in itertools.product(*candidates)), abs=1e-9)


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("equations", [False, True])
def test_margins_grow_by_what_was_missing(equations: bool, split: bool) -> None:
    """eq-margin, for a body that turns beside the wall at constant rates."""
    m = turning_move(elements=2, stages=1)
    avoid = avoiding(m)
    set_poses(m.move, np.array([(0.92, -0.5, -0.6), (0.92, -0.5, 0.8), (0.75, -0.5, -0.6)]))
    for state in (m.move.x, m.move.y, m.move.theta):
        state.unfix()
    avoid.initialize()
    report = avoid.verify(equations=equations)
    (pair,) = report.body_pairs
    before = {index: 0.001 * number for number, index in enumerate(avoid.separations, start=1)}
    for index, margin in before.items():
        avoid.set_margin(*index, margin)
    tighten(avoid, report, split=split)
    assert set(pair.unproven) == ({0, 1} if equations else {0})
    led_away = np.nan_to_num(pair.interval_deviation)  # nothing where only the plan is looked at
    for interval, (index, margin) in enumerate(before.items()):
        missing = pair.clearance + led_away[interval] - pair.interval_distance[interval]
        wanted = margin + (1.25 if split else 1) * missing if interval in pair.unproven else margin
        halves = [key for key in avoid.separations if index[2] <= key[2] < index[2] + 0.5]
        is_split = split and interval in pair.unproven and interval not in pair.plan_only
        assert len(halves) == (2 if is_split else 1)
        assert [avoid.margin[key].value for key in halves] == pytest.approx(
            [wanted / (4 if is_split else 1)] * len(halves)
        )
