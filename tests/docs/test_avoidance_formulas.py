"""The numbered formulas on separations and on planning in rounds, evaluated against the code."""

from __future__ import annotations

import functools
import itertools
import re
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, placed, set_poses, turning_move
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles.formulations import PlacedShape
from pyrobocop_pyomo.obstacles.formulations.rows import facet_weights
from pyrobocop_pyomo.obstacles.initial_separations import _cheapest_path
from pyrobocop_pyomo.obstacles.tightening import DEVIATION_FACTOR, tighten

from .code_blocks import ROOT

seeds = st.integers(0, 10**6)
PAGE = ROOT / "docs" / "explanation" / "obstacle-avoidance.md"


def two_shapes(seed: int, spread: float = 3.0) -> tuple[np.random.Generator, rcp.Polytope, rcp.Polytope, np.ndarray]:
    """Random shapes, and corners of the first at a random translation."""
    random = np.random.default_rng(seed)
    first, second = (rcp.Polytope.hull(random.normal(size=(6, 2))) for _ in range(2))
    return random, first, second, random.normal(size=2) * spread


def gap(n: np.ndarray, p: np.ndarray, q: np.ndarray) -> float:
    return float((p @ n).min() - (q @ n).max())


def unit(random: np.random.Generator) -> np.ndarray:
    n = random.normal(size=2)
    return n / np.linalg.norm(n)


@given(seed=seeds, factor=st.floats(0, 10))
def test_gaps_grow_with_the_normal_and_are_concave(seed: int, factor: float) -> None:
    """eq-gap."""
    random, first, second, t = two_shapes(seed)
    p, q = first.vertices + t, second.vertices
    n, other = random.normal(size=(2, 2))
    differences = (p[:, None] - q[None, :]).reshape(-1, 2)
    assert gap(n, p, q) == pytest.approx((differences @ n).min(), abs=1e-12)
    assert gap(factor * n, p, q) == pytest.approx(factor * gap(n, p, q), abs=1e-9)
    assert gap((n + other) / 2, p, q) >= (gap(n, p, q) + gap(other, p, q)) / 2 - 1e-12


@given(seed=seeds)
def test_weak_and_strong_duality(seed: int) -> None:
    """eq-strong-duality, the least distance of points by a program that knows no directions."""
    random, first, second, t = two_shapes(seed)
    p, q = first.vertices + t, second.vertices
    heavy = 1e4  # of the rows that say that shares add up to one
    sums = np.array([[1.0] * len(p) + [0.0] * len(q), [0.0] * len(p) + [1.0] * len(q)])
    shares = nnls(np.vstack([np.hstack([p.T, -q.T]), heavy * sums]), np.array([0, 0, heavy, heavy]))[0]
    a, c = shares[: len(p)], shares[len(p) :]
    primal = float(np.linalg.norm(a @ p / a.sum() - c @ q / c.sum()))
    found = rcp.scenes.signed_distance(first, second, rcp.planar_pose(*t))
    assert gap(random.uniform() * unit(random), p, q) <= primal + 1e-6
    assert max(gap(found.normal, p, q), 0.0) == pytest.approx(primal, abs=1e-5)


@given(seed=seeds, length=st.floats(0, 2))
def test_depth_is_the_least_translation_that_separates(seed: int, length: float) -> None:
    """eq-signed-duality in overlap."""
    random, first, second, t = two_shapes(seed, spread=0.3)
    p, q = first.vertices + t, second.vertices
    found = rcp.scenes.signed_distance(first, second, rcp.planar_pose(*t))
    if found.distance >= 0:
        return
    moved = p - found.distance * found.normal
    assert gap(found.normal, moved, q) == pytest.approx(0.0, abs=1e-9)
    tau = min(length, 0.999) * -found.distance * unit(random)
    assert rcp.scenes.signed_distance(first, second, rcp.planar_pose(*(t + tau))).distance < 0.0


@given(seed=seeds)
def test_reach_by_weights_of_facets(seed: int) -> None:
    """eq-support: the linear program, its dual, and the weights that separations start from."""
    random, shape, _, _ = two_shapes(seed)
    normals, offsets = shape.halfspaces
    v = random.normal(size=2)
    dual = linprog(offsets, A_eq=normals.T, b_eq=v)
    assert dual.status == 0
    assert dual.fun == pytest.approx((shape.vertices @ v).max(), abs=1e-7)
    weights = facet_weights(shape, v)
    assert weights.min() >= 0
    assert normals.T @ weights == pytest.approx(v, abs=1e-9)
    assert offsets @ weights == pytest.approx(dual.fun, abs=1e-7)


def random_weights(random: np.random.Generator, shape: rcp.Polytope, v: np.ndarray) -> np.ndarray:
    """Any weights >= 0 with G'm = v: the best ones, and something that adds up to nothing."""
    extra = random.uniform(size=len(shape.halfspaces[1]))
    return facet_weights(shape, v - shape.halfspaces[0].T @ extra) + extra


@given(seed=seeds, theta=st.floats(-3, 3))
def test_any_weights_err_on_the_safe_side(seed: int, theta: float) -> None:
    """eq-weights, at a pose that turns."""
    random, first, second, t = two_shapes(seed)
    pose = rcp.planar_pose(*t, theta)
    rotation = np.array(pose.rotation, dtype=float)
    n = random.normal(size=2)
    m = random_weights(random, first, -rotation.T @ n)
    weights = random_weights(random, second, n)
    proven = n @ t - first.halfspaces[1] @ m - second.halfspaces[1] @ weights
    assert gap(n, first.vertices @ rotation.T + t, second.vertices) >= proven - 1e-9


def block_at(formulation: str, pose: tuple[float, float, float], **options: Any) -> Any:
    m = turning_move(elements=2, stages=1)
    avoid = avoiding(m, formulation=formulation, between=None, **options)
    set_poses(m.move, np.tile(pose, (3, 1)))
    for state in (m.move.x, m.move.y, m.move.theta):
        state.unfix()
    avoid.initialize()
    return m, avoid


@functools.cache
def kept_block(formulation: str) -> Any:
    """One model for all examples of a law, whose poses are set anew."""
    return block_at(formulation, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("formulation", ["plane", "dual", "mixed"])
@given(seed=seeds)
def test_started_separations_prove_the_distance(formulation: str, seed: int) -> None:
    """eq-plane, eq-dual and eq-mixed: what the started rows leave is the distance less what is required."""
    pose = tuple(np.random.default_rng(seed).normal(size=3) * [2, 2, 1] + [2, 0, 0])
    m, avoid = kept_block(formulation)
    set_poses(m.move, np.tile(pose, (3, 1)))
    avoid.initialize()
    sd = rcp.scenes.signed_distance(ARROW, WALL, placed(m.move, 0.0)).distance
    index = next(iter(avoid.separations))
    spare = sd - pyo.value(avoid.required[index])
    if sd <= 0:
        return  # the start is then a chosen side, not the distance
    if formulation == "plane":
        first = min(pyo.value(avoid.first_shape[(*index, 0.0, i)].body) for i in range(4))
        second = max(pyo.value(avoid.second_shape[(*index, 0.0, j)].body) for j in range(4))
        assert first - second == pytest.approx(spare, abs=1e-8)
        assert first == pytest.approx(-second, abs=1e-8)
    elif formulation == "dual":
        assert pyo.value(avoid.gap[index].body) == pytest.approx(spare, abs=1e-8)
        assert [pyo.value(avoid.balance[(*index, axis)].body) for axis in (0, 1)] == pytest.approx([0, 0], abs=1e-9)
    else:
        assert min(pyo.value(avoid.first_shape[(*index, i)].body) for i in range(4)) == pytest.approx(spare, abs=1e-8)
    assert pyo.value(avoid.unit[index].body) == pytest.approx(1.0, abs=1e-9)


def test_what_is_required() -> None:
    """eq-required, with every part of it."""
    padded = {"arrow": rcp.Body(ARROW.padded(0.25), pose=placed)}
    _, avoid = block_at("plane", (0.0, 0.0, 0.0), bodies=padded, obstacles={"wall": WALL.padded(0.125)})
    index = next(iter(avoid.separations))
    avoid.scale_clearance(0.5)
    avoid.set_margin(*index, 0.01)
    assert pyo.value(avoid.required[index]) == pytest.approx(0.5 * 0.05 + 0.375 + 0.01, abs=1e-15)
    avoid.soften(7.0)
    for slack in avoid.slack.values():
        slack.set_value(0.0)
    avoid.slack[index].set_value(0.02)
    assert pyo.value(avoid.required[index]) == pytest.approx(0.5 * 0.05 + 0.375 + 0.01 - 0.02, abs=1e-15)
    assert pyo.value(avoid.softness) == pytest.approx(7.0 * 0.02)


def offset_values(first: rcp.Polytope, second: rcp.Polytope, t: np.ndarray) -> tuple[float, float]:
    """The gap of eq-offset, and twice the length by which facets move until the shapes touch: two linear programs."""
    (G, g), (A, b) = first.halfspaces, second.halfspaces
    dual = linprog(
        np.concatenate([g + G @ t, b]),  # n = -G'm, so that n.t = -(G t).m
        A_eq=np.vstack([np.hstack([G.T, A.T]), np.ones((1, len(g) + len(b)))]),
        b_eq=[0, 0, 2],
    )
    pushed = linprog(
        [0, 0, 2],
        A_ub=np.vstack([np.hstack([G, -np.ones((len(g), 1))]), np.hstack([A, -np.ones((len(b), 1))])]),
        b_ub=np.concatenate([g + G @ t, b]),
        bounds=(None, None),
    )
    assert dual.status == pushed.status == 0
    return -dual.fun, pushed.fun


@given(seed=seeds)
def test_pushed_out_facets(seed: int) -> None:
    """eq-offset, primal and dual; the gap never exceeds a distance."""
    _, first, second, t = two_shapes(seed)
    proven, twice = offset_values(first, second, t)
    assert proven == pytest.approx(twice, abs=1e-7)
    sd = rcp.scenes.signed_distance(first, second, rcp.planar_pose(*t)).distance
    assert (sd > 1e-7) == (proven > 1e-7) or abs(sd) < 1e-5
    if sd > 0:
        assert proven <= sd + 1e-9


@pytest.mark.parametrize(("t", "share"), [((3, 0), 1.0), ((3, 0.4), 1.0), ((3, 3), 0.5**0.5)])
def test_pushed_out_facets_of_squares(t: tuple[float, float], share: float) -> None:
    """Face to face the distance itself, corner to corner less by a factor of the square root of two."""
    square = rcp.Polytope.box(1, 1)
    proven, _ = offset_values(square, square, np.array(t, dtype=float))
    assert proven == pytest.approx(
        share * rcp.scenes.signed_distance(square, square, rcp.planar_pose(*t)).distance, abs=1e-9
    )


def test_rows_of_pushed_out_facets_start_with_the_sum_that_is_fixed() -> None:
    _, avoid = block_at("offset", (0.0, 0.0, 0.3))
    index = next(iter(avoid.separations))
    assert pyo.value(avoid.measure[index].body) == pytest.approx(2.0)
    assert [pyo.value(avoid.balance[(*index, axis)].body) for axis in (0, 1)] == pytest.approx([0, 0], abs=1e-9)


@given(seed=seeds, spoiled=st.floats(0, 1))
def test_optimality_errs_on_the_unsafe_side(seed: int, spoiled: float) -> None:
    """eq-optimality and eq-unsafe-side, for points between the nearest ones and any others."""
    random, first, second, t = two_shapes(seed, spread=5.0)
    p, q = first.vertices + t, second.vertices
    found = rcp.scenes.signed_distance(first, second, rcp.planar_pose(*t))
    if found.distance <= 0.01:
        return
    weights = []
    for corners, near in ((p, found.first_point), (q, found.second_point)):
        best = nnls(np.vstack([corners.T, np.ones(len(corners))]), np.append(near, 1.0))[0]
        other = random.dirichlet(np.ones(len(corners)))
        weights.append((1 - spoiled) * best / best.sum() + spoiled * other)
    a, c = weights
    v = a @ p - c @ q
    lam, kappa = -(p @ v).min(), (q @ v).max()
    nu, mu = p @ v + lam, -q @ v + kappa
    epsilon, length = float(a @ nu + c @ mu), float(np.linalg.norm(v))
    assert min(nu.min(), mu.min()) >= 0
    assert length - epsilon / length <= found.distance + 1e-9
    assert found.distance <= length + 1e-9
    assert gap(v, p, q) / length == pytest.approx(length - epsilon / length, abs=1e-9)


@given(length=st.floats(0.01, 1), required=st.floats(0.01, 1))
def test_the_smoothed_row_asks_for_the_same(length: float, required: float) -> None:
    """eq-smoothed, as the block builds it."""
    s = required / 2
    smooth = (length**2 + s**2) ** 0.5 - (required**2 + s**2) ** 0.5
    assert (smooth >= 0) == (length >= required) or abs(length - required) < 1e-9
    _, avoid = kept_block("optimality")
    index = next(iter(avoid.separations))
    avoid.clearance["arrow", "wall"] = required
    for axis, number in enumerate((length, 0.0)):
        avoid.normal[(*index, axis)].set_value(number)
    assert pyo.value(avoid.gap[index].body) == pytest.approx(smooth, abs=1e-12)


def sizes_of_page() -> dict[str, dict[str, tuple[int, int]]]:
    rows = re.findall(r'^\| `"(\w+)"` \|.*\| (\d+), (\d+) \| (\d+), (\d+) \|$', PAGE.read_text("utf-8"), re.MULTILINE)
    return {name: {"plane": (int(a), int(b)), "space": (int(c), int(d))} for name, a, b, c, d in rows}


@pytest.mark.parametrize("where", ["plane", "space"])
@pytest.mark.parametrize("formulation", ["plane", "mixed", "dual", "offset", "optimality"])
def test_the_table_of_sizes(formulation: str, where: str) -> None:
    m = turning_move(elements=2, stages=1)
    box = rcp.Polytope.box(1, 1) if where == "plane" else rcp.Polytope.box(1, 1, 1)
    pose = (
        placed if where == "plane" else (lambda b, t: rcp.spatial_pose((b.x[t], b.y[t], 3), euler=(0, 0, b.theta[t])))
    )
    avoid = avoiding(m, formulation=formulation, between=None, bodies={"body": rcp.Body(box, pose)}, obstacles=[box])
    unknowns = sum(len(variable) for variable in avoid.component_objects(pyo.Var))
    rows = sum(1 for _ in avoid.component_data_objects(pyo.Constraint))
    assert (unknowns / 3, rows / 3) == sizes_of_page()[formulation][where]


@given(seed=seeds, required=st.floats(0.01, 1))
def test_bounded_normals_collapse_in_overlap(seed: int, required: float) -> None:
    """eq-collapse."""
    random, first, second, t = two_shapes(seed, spread=0.3)
    p, q = first.vertices + t, second.vertices
    found = rcp.scenes.signed_distance(first, second, rcp.planar_pose(*t))
    if found.distance >= 0:
        return
    shortfalls = [required - gap(length * unit(random), p, q) for length in random.uniform(0, 1, 50)]
    assert min(shortfalls) >= required - 1e-12
    assert required - gap(np.zeros(2), p, q) == required
    assert required - gap(found.normal, p, q) == pytest.approx(required - found.distance, abs=1e-9)
    assert min(required - gap(unit(random), p, q) for _ in range(50)) >= required - found.distance - 1e-9
    tau, n = random.normal(size=(2, 2))
    assert gap(n, p + tau, q) - gap(n, p, q) == pytest.approx(n @ tau, abs=1e-9)


@given(seed=seeds, ends=st.tuples(st.booleans(), st.booleans()))
def test_sides_along_time(seed: int, ends: tuple[bool, bool]) -> None:
    """eq-normals: no other choice of candidates costs less."""
    random = np.random.default_rng(seed)
    segments = []
    for _ in range(3):
        shapes = [rcp.Polytope.hull(random.normal(size=(5, 2))) for _ in range(2)]
        segments.append(tuple(PlacedShape(s, s.vertices, s.rays, np.eye(2), np.zeros(2)) for s in shapes))
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


@pytest.mark.parametrize("equations", [False, True])
def test_margins_are_sags_and_what_was_missing(equations: bool) -> None:
    """eq-measured-deviation and eq-margin, for a body that turns beside the wall at constant rates."""
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
    tighten(avoid, report, split=False)
    unsafe = set(pair.unproven)
    # Of the plan, the missing distance decides in one interval, and in the one beside it the margin that it gets.
    assert unsafe == ({0, 1} if equations else {0})
    missing = {m: pair.clearance + pair.interval_deviation[m] - pair.interval_distance[m] for m in unsafe}
    raised = {m: before[index] + missing[m] for m, index in enumerate(before) if m in unsafe}
    for interval, index in enumerate(avoid.separations):
        times = sorted(m.move.time)[interval : interval + 2]
        n = np.array([avoid.normal[(*index, axis)].value for axis in (0, 1)])
        n /= np.linalg.norm(n)
        ends = np.array([[state[t].value for state in (m.move.x, m.move.y, m.move.theta)] for t in times])
        fractions = np.linspace(0, 1, 1001)[:, None]
        x, y, theta = (ends[0] + fractions * (ends[1] - ends[0])).T
        c, s = np.cos(theta), np.sin(theta)
        corners = ARROW.vertices @ np.array([[c, s], [-s, c]]).transpose(2, 0, 1) + np.stack([x, y], 1)[:, None]
        reach = -(corners @ n).min(axis=1)
        led = pair.interval_deviation[interval]
        enough = DEVIATION_FACTOR * (reach.max() - max(reach[0], reach[-1])) + led
        wanted = raised.get(interval) or max(before[index], min(enough, raised[1 - interval]))
        assert avoid.margin[index].value == pytest.approx(wanted, abs=1e-3)
        assert avoid.margin[index].value > 1.5 * before[index]


def test_softened_planes_have_normals_of_length_one() -> None:
    """eq-soft: the slack of a start is what is missing along its normal."""
    _, avoid = block_at("plane", (1.9, 0.0, 0.0))
    required = pyo.value(avoid.required[next(iter(avoid.separations))])
    avoid.soften(3.0)
    avoid.initialize()
    for index in avoid.separations:
        n = np.array([avoid.normal[(*index, axis)].value for axis in (0, 1)])
        missing = required - gap(n, ARROW.vertices + np.array([1.9, 0.0]), WALL.vertices)
        assert avoid.slack[index].value == pytest.approx(missing, abs=1e-9)
        assert avoid.unit[index].equality
    assert pyo.value(avoid.softness) == pytest.approx(3.0 * sum(slack.value for slack in avoid.slack.values()))
