"""Car kinematics: with constant steering, the middle of the rear axle follows an arc of a circle."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.numerics import Array


def follow_arc(poses: Array, lengths: Array, curvatures: Array) -> Array:
    """Poses (x, y, heading) after one arc each (negative length: backwards); exact, and arrays broadcast.

    Parameters
    ----------
    poses : (..., 3) array
    lengths, curvatures : (...) arrays
        Curvature is positive to the left, ``tan(steering) / wheelbase``.
    """
    half = 0.5 * lengths * curvatures
    chord = lengths * np.sinc(half / np.pi)
    middle = poses[..., 2] + half
    return np.stack(
        [poses[..., 0] + chord * np.cos(middle), poses[..., 1] + chord * np.sin(middle), poses[..., 2] + 2.0 * half], -1
    )


def follow_arcs(poses: Array, lengths: Array, curvatures: Array) -> Array:
    """Poses along several arcs in a row, the first included: ``(..., s + 1, 3)`` from ``(..., 3)`` and ``(..., s)``."""
    half = 0.5 * lengths * curvatures
    chord = lengths * np.sinc(half / np.pi)
    shape = np.broadcast_shapes(poses.shape[:-1], chord.shape[:-1])
    start = np.broadcast_to(poses[..., None, :], (*shape, 1, 3))
    after = start[..., 2] + 2.0 * np.cumsum(half, axis=-1)
    middle = after - half
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)], -1)
    ends = np.concatenate([start[..., :2] + np.cumsum(steps, axis=-2), after[..., None]], -1)
    return np.concatenate([start, ends], -2)


def relative_pose(poses: Array, target: Array) -> Array:
    """The target pose in the frame of each pose, its heading in [-pi, pi), ``(n, 3)``."""
    offset = target[..., :2] - poses[..., :2]
    cosine, sine = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    turn = (target[..., 2] - poses[..., 2] + np.pi) % (2.0 * np.pi) - np.pi
    return np.stack(
        [cosine * offset[..., 0] + sine * offset[..., 1], cosine * offset[..., 1] - sine * offset[..., 0], turn], -1
    )
