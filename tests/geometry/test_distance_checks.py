"""Signed distances agree with programs and methods that know nothing of ours, on a thousand pairs of poses each."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from harness.random_bodies import gap, random_body, random_pose, touching
from scipy.optimize import nnls

from pyrobocop_pyomo.geometry import Polytope, signed_distance

pytestmark = pytest.mark.heavy

PAIRS = 1000


def pairs(dimension: int, seed: int) -> list[tuple[Polytope, Polytope]]:
    """In the world: apart, overlapping, and every fifth touching in one corner."""
    random = np.random.default_rng(seed)
    made = []
    for k in range(PAIRS):
        first, second = random_body(random, dimension), random_body(random, dimension)
        first = first.placed(random_pose(random, dimension))
        made.append(touching(random, first, second) if k % 5 == 0 else (first, second))
    return made


def nearest_by_quadratic_program(first: Polytope, second: Polytope) -> float:
    """The least of |V'a - W'b| over weights that sum to one each: non-negative least squares with heavy sums."""
    heavy = 1e7
    v, w = first.vertices.T, second.vertices.T
    sums = np.zeros((2, v.shape[1] + w.shape[1]))
    sums[0, : v.shape[1]], sums[1, v.shape[1] :] = heavy, heavy
    weights, _ = nnls(np.vstack([np.hstack([v, -w]), sums]), np.concatenate([np.zeros(len(v)), [heavy, heavy]]))
    a, b = weights[: v.shape[1]], weights[v.shape[1] :]
    return float(np.linalg.norm(v @ (a / a.sum()) - w @ (b / b.sum())))


def depth_by_enumeration(first: Polytope, second: Polytope) -> float:
    """Largest gap over all directions that two edges (in the plane one) of all differences span: no hull, no search."""
    edges = np.array([a - b for body in (first, second) for a, b in itertools.combinations(body.vertices, 2)])
    if first.dimension == 2:
        normals = np.column_stack([-edges[:, 1], edges[:, 0]])
    else:
        i, j = np.triu_indices(len(edges), 1)
        normals = np.cross(edges[i], edges[j])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    normals = np.vstack([normals, -normals])
    gaps = (first.vertices @ normals.T).min(axis=0) - (second.vertices @ normals.T).max(axis=0)
    return float(gaps.max())


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_answer_proves_itself(dimension: int) -> None:
    """Points of both bodies bound the distance from above, the gap along the normal from below: they meet."""
    for first, second in pairs(dimension, seed=dimension):
        found = signed_distance(first, second)
        assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-12)
        assert gap(found.normal, first.vertices, second.vertices) == pytest.approx(found.distance, abs=1e-9)
        assert found.first_point - found.second_point == pytest.approx(found.distance * found.normal, abs=1e-9)
        for body, place in ((first, found.first_point), (second, found.second_point)):
            normals, offsets = body.halfspaces
            assert (normals @ place - offsets).max() <= 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_distances_agree_with_a_quadratic_program_and_depths_with_enumeration(dimension: int) -> None:
    overlapping = 0
    for first, second in pairs(dimension, seed=10 + dimension):
        found = signed_distance(first, second)
        if found.distance > 1e-9:
            assert found.distance == pytest.approx(nearest_by_quadratic_program(first, second), abs=1e-9)
        else:
            overlapping += 1
            assert found.distance == pytest.approx(depth_by_enumeration(first, second), abs=1e-9)
    assert 0.1 * PAIRS < overlapping < 0.9 * PAIRS
