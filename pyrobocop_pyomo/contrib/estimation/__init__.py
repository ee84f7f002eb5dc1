"""Parameters from data: data sets, estimates with their uncertainty, and what measurements can say at all.

`rcp.estimate` is the way in; these are the types that it takes and gives, and `EstimationProblem`, which is the same
problem with data that may be exchanged, for `rcp.sweep`. `MovingHorizon` estimates while measurements arrive.
"""

from .data_sets import DataSet
from .fit_statistics import FitStatistics, statistics_of
from .moving_horizon import MovingHorizon
from .problem import EstimationProblem

__all__ = [
    "DataSet",
    "EstimationProblem",
    "FitStatistics",
    "MovingHorizon",
    "statistics_of",
]
