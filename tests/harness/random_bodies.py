"""Random bodies and poses for the tests of geometry and obstacles."""

import numpy as np

from pyrobocop_pyomo.geometry import Polytope, Pose, planar_pose, spatial_pose


def random_body(random: np.random.Generator, dimension: int) -> Polytope:
    """A box with every second draw (parallel faces are the hard case), else the hull of a few points."""
    if random.random() < 0.5:
        return Polytope.box(*random.uniform(0.2, 2.0, dimension))
    return Polytope.hull(random.normal(size=(random.integers(dimension + 1, 12), dimension)))


def random_pose(random: np.random.Generator, dimension: int, spread: float = 2.0) -> Pose:
    """Turned by quarter turns with every third draw, so that faces and edges are parallel."""
    angles = random.integers(-2, 3, 3) * np.pi / 2 if random.random() < 0.33 else random.uniform(-np.pi, np.pi, 3)
    position = random.uniform(-spread, spread, dimension)
    if dimension == 2:
        return planar_pose(*position.tolist(), float(angles[0]))
    return spatial_pose(position.tolist(), euler=angles.tolist())


def touching(random: np.random.Generator, first: Polytope, second: Polytope) -> tuple[Polytope, Polytope]:
    """The first moved along a random direction until their supporting planes there coincide: apart or touching."""
    normal = random.normal(size=first.dimension)
    normal /= np.linalg.norm(normal)
    low = first.vertices[np.argmin(first.vertices @ normal)]
    high = second.vertices[np.argmax(second.vertices @ normal)]
    return Polytope(first.vertices - low + high, first.rays), second


def gap(normal: np.ndarray, p: np.ndarray, q: np.ndarray, *rays: np.ndarray | None) -> float:
    """Width of the gap from q to p along a unit normal; minus infinity where a ray of p, or one of q, leads across."""
    for sign, directions in zip((1.0, -1.0), rays, strict=False):
        if directions is not None and len(directions) and (sign * directions @ normal).min() < -1e-8:
            return -np.inf
    return float((p @ normal).min() - (q @ normal).max())
