"""Types of what the functions and methods of this package return."""

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.discretisation import DiscretisationEstimate, PhaseEstimate
from pyrobocop_pyomo.motion import BodyPairSafety, SafetyReport
from pyrobocop_pyomo.mpcc import Certificate, Multipliers, Stationarity
from pyrobocop_pyomo.phases import Verification
from pyrobocop_pyomo.solving import (
    ActiveSide,
    Iterate,
    LeastViolation,
    Obstruction,
    PairReport,
    ScalingRecord,
    Standing,
    Violation,
)
from pyrobocop_pyomo.trajectories import JoinedTrajectory

__all__ = [
    "ActiveSide",
    "BodyPairSafety",
    "Certificate",
    "Diagnosis",
    "DiscretisationEstimate",
    "Iterate",
    "JoinedTrajectory",
    "LeastViolation",
    "Multipliers",
    "Obstruction",
    "PairReport",
    "PhaseEstimate",
    "SafetyReport",
    "ScalingRecord",
    "Standing",
    "Stationarity",
    "Verification",
    "Violation",
]
