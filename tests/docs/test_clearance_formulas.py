"""The numbered formulas of the page on obstacle avoidance, evaluated against the code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import by_states, check, on_points, placed
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope, distances_of_points, planar_pose, signed_distance
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.clearance_proof import ProofSettings, _Proof
from pyrobocop_pyomo.motion.moving_shapes import moving_shapes
from pyrobocop_pyomo.motion.required_clearance import RequiredClearance
from pyrobocop_pyomo.numerics.bernstein import bernstein_from_samples, bernstein_matrix, restrict
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial

seeds = st.integers(0, 10**6)


def scene(seed: int, spread: float = 2.0) -> tuple[np.random.Generator, Polytope, Polytope]:
    random = np.random.default_rng(seed)
    first = Polytope.hull(random.normal(size=(6, 2)), radius=random.uniform(0, 0.3))
    second = Polytope.hull(random.normal(size=(6, 2)) + random.normal(size=2) * spread, radius=random.uniform(0, 0.3))
    return random, first, second


def gap(n: np.ndarray, p: np.ndarray, q: np.ndarray) -> float:
    return float((p @ n).min() - (q @ n).max())


@given(seed=seeds)
def test_corners_and_signed_distance(seed: int) -> None:
    """eq-corners and eq-signed-distance: no direction leaves a larger gap, and the returned one leaves this."""
    random, first, second = scene(seed)
    x, y, theta = random.normal(size=3)
    found = signed_distance(first, second, planar_pose(x, y, theta))
    p = placed(first.vertices, np.array([[x, y, theta]]))[0]
    radii = first.radius + second.radius
    angles = np.linspace(0, 2 * np.pi, 500)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    assert max(gap(n, p, second.vertices) for n in directions) - radii <= found.distance + 1e-9
    assert gap(found.normal, p, second.vertices) - radii == pytest.approx(found.distance, abs=1e-9)


@given(seed=seeds, c=st.floats(-3, 3), length=st.floats(0.01, 10))
def test_separations(seed: int, c: float, length: float) -> None:
    """eq-separation, for a random plane, and that the best one loses nothing."""
    random, first, second = scene(seed)
    p, q, radii = first.vertices, second.vertices, first.radius + second.radius
    found = signed_distance(first, second)
    n = random.normal(size=2)
    n *= length / np.linalg.norm(n)
    shift = max(float((q @ n).max()), c)
    gamma = float((p @ n).min()) - shift
    assert found.distance >= gamma / length - radii - 1e-9
    best = length * found.normal
    gamma = float((p @ best).min()) - float((q @ best).max())
    assert gamma / length - radii == pytest.approx(found.distance, abs=1e-9)


@given(seed=seeds, share=st.floats(0, 1))
def test_chords_are_safe(seed: int, share: float) -> None:
    """eq-chord: what a plane says about both ends, it says about everything on the chords."""
    random, first, second = scene(seed, spread=5.0)
    moves, n = random.normal(size=(2, 2)), random.normal(size=2)
    p, q = (
        [shape.vertices, shape.vertices @ random.normal(size=(2, 2)) + move]
        for shape, move in zip((first, second), moves, strict=True)
    )
    c = max(float((corners @ n).max()) for corners in q)
    gamma = min(float((corners @ n).min()) for corners in p) - c
    assert (((1 - share) * p[0] + share * p[1]) @ n).min() >= c + gamma - 1e-9
    assert (((1 - share) * q[0] + share * q[1]) @ n).max() <= c + 1e-9


@given(seed=seeds, start=st.floats(-2, 2), width=st.floats(0.01, 3))
def test_the_chord_deviation(seed: int, start: float, width: float) -> None:
    """eq-chord-deviation for random cubics, whose second derivative is largest at an end."""
    cubic = np.polynomial.Polynomial(np.random.default_rng(seed).normal(size=4))
    end = start + width
    curvature = max(cubic.deriv(2)(start), cubic.deriv(2)(end))
    lowest = cubic(np.linspace(start, end, 500)).min()
    assert lowest >= min(cubic(start), cubic(end)) - width**2 / 8 * max(0.0, curvature) - 1e-12


def test_a_parabola_attains_the_chord_deviation() -> None:
    """eq-chord-deviation: no smaller constant is right."""
    assert 0.0 == 1.0 - 2.0**2 / 8 * 2.0  # s^2 on [-1, 1]


@given(angle=st.floats(-6, 6), radius=st.floats(0.1, 5))
def test_turning(angle: float, radius: float) -> None:
    """eq-turning: how far the arc leaves its chord, and the bound."""
    arc = radius * np.exp(1j * np.linspace(-angle / 2, angle / 2, 1001))
    assert float(arc.real.max() - arc.real[0]) == pytest.approx(radius * (1 - math.cos(angle / 2)), abs=1e-9)
    assert radius * (1 - math.cos(angle / 2)) <= radius * angle**2 / 8 + 1e-12


def proof(m: Any, others: Any, first: Polytope, second: Polytope) -> _Proof:
    shapes = [
        moving_shapes(motion_of(model.t, model), {"body": Body(shape, by_states)})["body"][0]
        for model, shape in ((m, first), (others, second))
    ]
    return _Proof(*shapes, RequiredClearance(0.0), ProofSettings(0.001, 5, 100), np.zeros(1))


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


@given(seed=seeds, degree=st.integers(1, 6), start=st.floats(0, 0.9), width=st.floats(0.01, 1.0))
def test_bernstein_coefficients_bound_the_polynomial(seed: int, degree: int, start: float, width: float) -> None:
    """eq-bernstein, with the polynomial evaluated by other means."""
    end = min(start + width, 1.0)
    polynomial = np.polynomial.Polynomial(np.random.default_rng(seed).normal(size=degree + 1))
    points, matrix = bernstein_from_samples(degree)
    beta = restrict((matrix @ polynomial(points))[None, :], [start], [end])[0]
    u = np.linspace(0, 1, 50)
    values = polynomial(start + u * (end - start))
    binomials = [math.comb(degree, k) for k in range(degree + 1)]
    formula = sum(beta[k] * binomials[k] * u**k * (1 - u) ** (degree - k) for k in range(degree + 1))
    assert formula == pytest.approx(values, abs=1e-10)
    assert bernstein_matrix(degree, u) @ beta == pytest.approx(values, abs=1e-10)
    assert beta.min() - 1e-10 <= values.min()
    assert values.max() <= beta.max() + 1e-10


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


@given(seed=seeds, turn=st.floats(0, 2))
def test_advancement(seed: int, turn: float) -> None:
    """A proof by speed: sd(s) >= (sd(a) + sd(b) - l) / 2, with the largest relative way l of two corners."""
    random, first, second = scene(seed)
    poses = random.normal(size=(2, 3)) * [1, 1, turn]
    change = poses[1] - poses[0]
    travelled = np.linalg.norm(change[:2]) + np.linalg.norm(first.vertices, axis=1).max() * abs(change[2])
    distances = [
        signed_distance(first, second, planar_pose(*(poses[0] + share * change))).distance
        for share in np.linspace(0, 1, 11)
    ]
    assert min(distances) >= (distances[0] + distances[-1] - travelled) / 2 - 1e-9


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
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        body=rcp.Polytope.box(0.3, 0.2),
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.h[t]),
        obstacles={"post": rcp.Polytope.box(0.1, 0.1, center=(0.9, 1.2))},
        clearance=0.05,
    )
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
