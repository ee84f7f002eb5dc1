"""The numbered formulas of the page on obstacle avoidance, evaluated against the code."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, on_points, placed
from harness.scenes import keep_clear
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope, distances_of_points, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.clearance_proof import _Proof
from pyrobocop_pyomo.motion.moving_shapes import moving_shapes
from pyrobocop_pyomo.motion.required_clearance import RequiredClearance
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial

seeds = st.integers(0, 10**6)


def scene(seed: int, spread: float = 2.0) -> tuple[np.random.Generator, Polytope, Polytope]:
    random = np.random.default_rng(seed)
    first = Polytope.hull(random.normal(size=(6, 2)), radius=random.uniform(0, 0.3))
    second = Polytope.hull(random.normal(size=(6, 2)) + random.normal(size=2) * spread, radius=random.uniform(0, 0.3))
    return random, first, second


def gap(n: np.ndarray, p: np.ndarray, q: np.ndarray) -> float:
    return float((p @ n).min() - (q @ n).max())


def proof(m: Any, others: Any, first: Polytope, second: Polytope) -> _Proof:
    shapes = [
        moving_shapes(motion_of(model.t, model), {"body": Body(shape, by_states)})["body"][0]
        for model, shape in ((m, first), (others, second))
    ]
    return _Proof(*shapes, RequiredClearance(0.0), 0.001, 5, 100, np.zeros(1), np.zeros(1), "")


@given(seed=seeds, start=st.floats(0, 0.9), width=st.floats(0.01, 1.0), turn=st.floats(0, 3), length=st.floats(0.1, 3))
def test_plane_bounds_and_their_convergence(seed: int, start: float, width: float, turn: float, length: float) -> None:
    """eq-plane-bound and eq-converges, for two bodies that move and turn."""
    random, first, second = scene(seed)
    end = min(start + width, 1.0)
    poses, others = (random.normal(size=(2, 3)) * [1, 1, turn] for _ in range(2))
    proof_of_pair = proof(on_points(poses), on_points(others), first, second)
    at = np.array([0]), np.array([start]), np.array([end])
    p, q = proof_of_pair.first.path_bounds(*at), proof_of_pair.second.path_bounds(*at)
    middle, normals = proof_of_pair._measure(at[0], 0.5 * (at[1] + at[2]))
    bound = proof_of_pair._plane_bounds(length * normals, p, q, proof_of_pair.clearance.bounds(*at))[0]
    fractions = np.linspace(start, end, 200)[:, None]
    paths = [
        placed(shape.vertices, pair[0] + fractions * (pair[1] - pair[0]))
        for shape, pair in ((first, poses), (second, others))
    ]
    along = [path @ normals[0] for path in paths]
    radii = first.radius + second.radius
    assert bound <= (along[0].min(axis=1) - along[1].max(axis=1)).min() - radii + 1e-9
    reaches = [np.linalg.norm(shape.vertices, axis=1).max() for shape in (first, second)]
    rates = [abs(pair[1, 2] - pair[0, 2]) for pair in (poses, others)]
    speeds = [np.linalg.norm(pair[1, :2] - pair[0, :2]) for pair in (poses, others)]
    fastest = sum(speed + reach * rate for speed, reach, rate in zip(speeds, reaches, rates, strict=True))
    # Rotations are bounded entry by entry: the bound of the second derivative is at most twice the true bound.
    curvature = 2 * math.sqrt(2) * sum(reach * rate**2 for reach, rate in zip(reaches, rates, strict=True))
    h = end - start
    assert bound >= middle[0] - fastest * h / 2 - curvature * h**2 / 8 - 1e-9


def form_of(number: float, slope: float, curvature: float) -> TaylorForm:
    return taylor_form_of_polynomial(tuple(np.array([[bound]]) for bound in (number, slope, curvature)))


@given(u=st.tuples(*[st.floats(-3, 3)] * 3), v=st.tuples(*[st.floats(-3, 3)] * 3))
def test_rules_of_second_derivatives(u: Any, v: Any) -> None:
    """eq-taylor-form on single points, where intervals are numbers."""
    product = form_of(*u) * form_of(*v)
    assert product.second.low[0] == pytest.approx(u[2] * v[0] + 2 * u[1] * v[1] + u[0] * v[2], abs=1e-9)
    sine = form_of(*u).sin()
    expected = -math.sin(u[0]) * u[1] ** 2 + math.cos(u[0]) * u[2]
    assert sine.second.low[0] == pytest.approx(expected, abs=1e-9)
    assert sine.second.high[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("gap_left", "safe"), [(0.0991, True), (0.0989, False)])
def test_proven_means_up_to_the_tolerance(gap_left: float, safe: bool) -> None:
    """eq-proven with the default of one percent."""
    m = on_points([(0, 0, 0), (4, 0, 0)])
    wall = Polytope.box(20, 1, center=(0, -1.0 - gap_left))
    report = check(m, Polytope.box(1, 1), [wall], 0.1)
    assert report.safe is safe
    assert report.body_pairs[0].tolerance == pytest.approx(0.001)


def test_sliding_takes_one_plane_where_advancement_needs_stretches_as_short_as_the_tolerance() -> None:
    m = on_points([(0, 0, 0), (4, 0, 0)])
    pair = check(m, Polytope.box(1, 1), [Polytope.box(20, 1, center=(0, -1.1))], 0.1).body_pairs[0]
    assert pair.safe
    assert pair.subintervals == 1
    assert 4.0 / (2 * pair.tolerance) >= 2000  # subintervals, each of length twice the tolerance


def test_a_square_root_is_decided_by_its_values() -> None:
    """The remark on second derivatives without bound."""
    m = on_points([(0, 0, 0), (1, 0, 0)])
    wall = Polytope.box(1, 1, center=(2.2, 0))
    pair = check(m, Polytope.box(1, 1), [wall], 0.1, pose=lambda b, t: planar_pose(pyo.sqrt(b.x[t]), 0)).body_pairs[0]
    assert pair.safe
    assert pair.subintervals > 1


def test_the_equations_are_no_nearer_than_what_is_proven_less_the_deviation() -> None:
    """eq-deviation and eq-both-motions, for a car on a coarse mesh against its own re-integration."""
    m = pyo.ConcreteModel()
    m.drive = b = rcp.PhaseBlock(duration=2.0, elements=5, scheme="implicit_euler")
    b.x, b.y, b.h = rcp.State(initial=0), rcp.State(initial=0), rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: pyo.cos(b.h[t]), b.y: pyo.sin(b.h[t]), b.h: 0.7})
    b.initialize(b.simulate(method="scheme"))
    near = {"post": rcp.Polytope.box(0.1, 0.1, center=(0.9, 1.2))}
    keep_clear(b, rcp.Polytope.box(0.3, 0.2), near, lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.h[t]))
    (pair,) = b.avoid.verify().body_pairs
    motion = b.reintegrate()
    corners = rcp.Polytope.box(0.3, 0.2).vertices

    def corners_of(states: Any) -> Any:
        x, y, h = (states[name] for name in ("x", "y", "h"))
        turn = np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])
        return np.einsum("rcnk,ic->nkir", turn, corners) + np.stack([x, y], axis=-1)[:, :, None, :]

    led, planned = corners_of(motion.open_loop), corners_of(motion.planned)
    expected = 1.1 * np.linalg.norm(led - planned, axis=3).max(axis=(1, 2))
    np.testing.assert_allclose(pair.interval_deviation, expected, rtol=1e-9)
    post = np.array([[0.85, 1.15], [0.95, 1.15], [0.95, 1.25], [0.85, 1.25]])
    for interval, shapes in enumerate(led):
        repeated = np.broadcast_to(post, (len(shapes), 4, 2))
        no_rays = np.zeros((len(shapes), 0, 2))
        distances, _ = distances_of_points(shapes, repeated, no_rays, no_rays)
        assert distances.min() >= pair.interval_proven[interval] - pair.interval_deviation[interval] - 1e-12
