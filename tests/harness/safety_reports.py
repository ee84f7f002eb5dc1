"""Reports about motions that nobody has proven."""

import numpy as np

from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport


def report_of_a_collision() -> SafetyReport:
    """A cart one metre inside a wall from which it was to keep 0.1 m away."""
    return SafetyReport((measured_pair("cart", "wall", np.array([-1.0]), 0.1),))


def measured_pair(first: str, second: str, distances: np.ndarray, clearance: float) -> BodyPairSafety:
    """Distances of two parts in as many intervals of length one, each of which is proven."""
    ends = np.column_stack([np.arange(len(distances)), np.arange(len(distances)) + 1.0])
    required, apart = np.full(len(distances), clearance), np.zeros(len(distances))
    return BodyPairSafety(first, second, 0.001, 1, distances, distances, required, apart, ends.mean(axis=1), ends)
