"""Turning a rotation matrix by a vector: exact, smooth at rest, and a rotation for ever; frames across a normal."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from scipy.linalg import expm

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.mechanics.rotations import (
    cross_product,
    rotation_matrix,
    rotation_vector,
    tangents_across,
    turn_matrix,
    turn_quaternion,
)

numbers = st.floats(-1, 1)
turns = st.tuples(*3 * [numbers])
lines = turns.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: np.array(v) / np.linalg.norm(v))


def skew(v: Any) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def exponential(turn: Any, rotation: Any) -> np.ndarray:
    return np.array(turn_matrix(turn_quaternion(turn), rotation))


@given(turn=turns, before=turns)
def test_a_turn_is_the_matrix_exponential(turn: tuple, before: tuple) -> None:
    rotation = rotation_matrix(before)
    np.testing.assert_allclose(exponential(turn, rotation), expm(skew(turn)) @ rotation, atol=1e-12)


@given(axis=lines)
def test_the_series_reach_half_a_turn(axis: np.ndarray) -> None:
    np.testing.assert_allclose(exponential(math.pi * axis, np.eye(3)), 2 * np.outer(axis, axis) - np.eye(3), atol=1e-9)


def test_at_rest_derivatives_are_those_of_the_group() -> None:
    """First derivatives are the generators; second ones are their products, symmetrised."""
    m = pyo.ConcreteModel()
    m.v = pyo.Var(range(3), initialize=0.0)
    generators = [skew(axis) for axis in np.eye(3)]
    h = 1e-4

    def slopes() -> np.ndarray:
        entries = turn_matrix(turn_quaternion([m.v[i] for i in range(3)]), np.eye(3).tolist())
        variables = [m.v[i] for i in range(3)]
        return np.array(
            [[differentiate(e, wrt_list=variables, mode=Modes.reverse_numeric) for e in row] for row in entries]
        )

    at_rest = slopes()
    for k, generator in enumerate(generators):
        np.testing.assert_allclose(at_rest[:, :, k], generator, atol=1e-15)
        m.v[k].set_value(h)
        later = slopes()
        m.v[k].set_value(0.0)
        for j, other in enumerate(generators):
            second = (generator @ other + other @ generator) / 2
            np.testing.assert_allclose((later - at_rest)[:, :, j] / h, second, atol=1e-3)


@given(turn=turns)
def test_vectors_and_matrices_are_the_same_rotations(turn: tuple) -> None:
    np.testing.assert_allclose(rotation_vector(rotation_matrix(turn)), turn, atol=1e-12)


def test_what_is_no_rotation_vector_is_refused() -> None:
    for wrong in ((0.0, 1.0), (0.0, 0.0, math.nan), (None, 0.0, 0.0)):
        with pytest.raises(ModelError, match=r"rotation vector .*: expected three finite numbers"):
            rotation_matrix(wrong)


@given(normal=lines, singular=lines)
def test_tangents_are_a_right_handed_frame_and_turn_smoothly(normal: np.ndarray, singular: np.ndarray) -> None:
    away = 1 - singular @ normal
    if away < 0.02:
        return
    first, second = np.array(tangents_across(normal, singular))
    np.testing.assert_allclose([dot(first, first), dot(second, second)], 1.0, atol=1e-12)
    np.testing.assert_allclose([dot(first, normal), dot(second, normal), dot(first, second)], 0.0, atol=1e-12)
    np.testing.assert_allclose(cross_product(first, second), normal, atol=1e-12)
    h = 1e-5
    nearby = normal + h * first
    nearby /= np.linalg.norm(nearby)
    moved = np.array(tangents_across(nearby, singular))
    # The frame turns with the normal, and about it the faster the nearer the singular direction is.
    assert np.abs(moved - [first, second]).max() < 3 * h / away
