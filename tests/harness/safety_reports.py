"""Reports about motions that nobody has proven."""

import numpy as np

from pyrobocop_pyomo.motion.safety_report import BodyPairSafety, SafetyReport


def report_of_a_collision() -> SafetyReport:
    """A cart one metre inside a wall from which it was to keep 0.1 m away."""
    pair = BodyPairSafety.at_points("cart", "wall", [0.0], np.array([-1.0]), np.array([0.1]), 0.001)
    return SafetyReport((pair,))
