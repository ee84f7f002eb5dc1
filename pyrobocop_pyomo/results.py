"""Types of what the functions and methods of this package return."""

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.motion import BodyPairSafety, SafetyReport
from pyrobocop_pyomo.mpcc import Certificate, Multipliers, Stationarity
from pyrobocop_pyomo.phases import Verification
from pyrobocop_pyomo.solving import ActiveSide, Iterate, PairReport, Standing
from pyrobocop_pyomo.trajectories import JoinedTrajectory

__all__ = [
    "ActiveSide",
    "BodyPairSafety",
    "Certificate",
    "Diagnosis",
    "Iterate",
    "JoinedTrajectory",
    "Multipliers",
    "PairReport",
    "SafetyReport",
    "Standing",
    "Stationarity",
    "Verification",
]
