"""Rotations: turning a matrix by an angular velocity, rotation vectors, products, and frames across a normal.

Formulas are plain arithmetic: numbers give numbers, arrays give arrays, Pyomo expressions give expressions. In the
plane a vector has two entries, and an angle, an angular velocity or a moment has one.
"""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
from pyomo.core.expr import cos as expression_cos
from pyomo.core.expr import sin as expression_sin

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

# As many numbers, arrays or expressions as there are dimensions, and rows of these.
Vector = Any
Matrix = Any

# cos(x / 2) and sin(x / 2) / x are entire functions of x^2: their series have no seam at zero, and derivatives of any
# order. Eight terms leave 1e-13 at two radians, 1e-10 at half a turn.
_TERMS = 8
_HALF_COSINE = [(-0.25) ** k / factorial(2 * k) for k in range(_TERMS)]
_HALF_SINE = [(-0.25) ** k / factorial(2 * k + 1) / 2 for k in range(_TERMS)]


def turn_quaternion(turn: Vector) -> tuple[Any, Any, Any, Any]:
    """Unit quaternion ``(cos(x/2), sin(x/2)/x turn)`` of a rotation vector of length ``x``, by its series.

    Parameters
    ----------
    turn : three numbers, arrays or expressions
        Axis times angle, radians: an angular velocity times a duration.

    Returns
    -------
    (w, x, y, z) : tuple
        Of length one to 1e-13 for angles up to 2 rad, to 1e-10 up to half a turn. Derivatives of all orders are finite
        everywhere, also at rest.
    """
    square = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2
    cosine, sine = _polynomial(_HALF_COSINE, square), _polynomial(_HALF_SINE, square)
    return cosine, sine * turn[0], sine * turn[1], sine * turn[2]


def turn_matrix(quaternion: Vector, rotation: Matrix) -> list[list[Any]]:
    """A rotation matrix, turned further: ``exp([turn]x) R`` for the quaternion of the turn.

    Each column ``r`` becomes ``r + 2 w (v x r) + 2 v x (v x r)``, which is Rodrigues' formula in half angles.

    Parameters
    ----------
    quaternion : (w, x, y, z)
        See `turn_quaternion`.
    rotation : three rows of three entries

    Returns
    -------
    list of three rows

    References
    ----------
    Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, sec. 2.2, eq. (2.14)
    """
    w, v = quaternion[0], quaternion[1:]
    columns = []
    for column in zip(*rotation, strict=True):
        across = cross_product(v, column)
        columns.append([r + 2 * (w * a + b) for r, a, b in zip(column, across, cross_product(v, across), strict=True)])
    return [list(row) for row in zip(*columns, strict=True)]


def cross_product(a: Vector, b: Vector) -> list[Any]:
    """``a x b``; in the plane of two vectors, which gives one entry, or of one entry across the plane and a vector."""
    if len(a) == 3:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return [a[0] * b[1] - a[1] * b[0]] if len(a) == 2 else [-a[0] * b[1], a[0] * b[0]]


def rotation_rows(entries: Vector) -> list[list[Any]]:
    """Rows of the rotation matrix with nine entries, or of the matrix of one angle in the plane."""
    if len(entries) == 1:
        s, c = sine(entries[0]), cosine(entries[0])
        return [[c, -s], [s, c]]
    return [list(entries[i : i + 3]) for i in (0, 3, 6)]


def tangents_across(normal: Vector, singular: Vector) -> list[list[Any]]:
    """Two unit vectors across a unit normal and each other, which follow it smoothly but for one direction.

    The frame that belongs to ``-singular`` is turned with the normal along the shortest way. That has no answer where
    the normal is `singular` itself; no smooth choice of tangents is without such a direction (Poincare and Hopf).

    Parameters
    ----------
    normal : three numbers, arrays or expressions
        Of length one.
    singular : three numbers
        The direction that the normal never takes, of length one.

    Returns
    -------
    list of two lists of three entries

    References
    ----------
    Duff et al., Building an orthonormal basis, revisited, Journal of Computer Graphics Techniques 6(1), 2017, eq. (3)
    """
    pole = -np.asarray(singular, dtype=float)
    # The axis that is farthest from the pole gives the frame there.
    first = np.cross(pole, np.eye(3)[np.abs(pole).argmin()])
    first /= np.linalg.norm(first)
    frame = []
    nearness = 1 + dot(pole.tolist(), normal)
    for axis in (first, np.cross(pole, first)):
        share = dot(axis.tolist(), normal) / nearness
        frame.append([float(a) - share * (float(p) + n) for a, p, n in zip(axis, pole, normal, strict=True)])
    return frame


def rotation_matrix(vector: Vector) -> Array:
    """Rotation matrix, shape (3, 3), of a rotation vector (axis times angle, radians); of one angle shape (2, 2)."""
    numbers = np.asarray(vector, dtype=float)
    if numbers.shape == (1,):
        return np.array(rotation_rows(numbers))
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ModelError(f"rotation vector {vector!r}: expected three finite numbers, the axis times the angle.")
    matrix: Array = scipy.spatial.transform.Rotation.from_rotvec(numbers).as_matrix()
    return matrix


def rotation_vector(matrix: Array) -> Array:
    """Rotation vector of a rotation matrix: axis times angle, the angle at most half a turn; in the plane the angle."""
    if len(matrix) == 2:
        return np.array([np.arctan2(matrix[1, 0], matrix[0, 0])])
    vector: Array = scipy.spatial.transform.Rotation.from_matrix(matrix).as_rotvec()
    return vector


def sine(value: Any) -> Any:
    """Sine of a number, an array or an expression."""
    return np.sin(value) if isinstance(value, np.ndarray) else expression_sin(value)


def cosine(value: Any) -> Any:
    """Cosine of a number, an array or an expression."""
    return np.cos(value) if isinstance(value, np.ndarray) else expression_cos(value)


def _polynomial(coefficients: list[float], value: Any) -> Any:
    result = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        result = coefficient + value * result
    return result
