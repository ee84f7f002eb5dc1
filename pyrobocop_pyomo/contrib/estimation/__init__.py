"""Parameters from data, with pairs or without, and how sure they are.

`rcp.label_measurements` states an experiment as `pyomo.contrib.parmest` reads it; `rcp.estimate` fits it, also with
pairs, and parmest where there are none. `EstimationProblem` is the same fit with data that may be exchanged, for
`rcp.sweep`. `MovingHorizon` estimates while measurements arrive.
"""

from .estimate import EstimationResult, statistics_of
from .moving_horizon import MovingHorizon
from .problem import EstimationProblem

__all__ = [
    "EstimationProblem",
    "EstimationResult",
    "MovingHorizon",
    "statistics_of",
]
