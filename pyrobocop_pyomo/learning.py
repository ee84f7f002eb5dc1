"""Models learned from data, as functions that rules may call."""

from pyrobocop_pyomo.numerics.gaussian_process import GaussianProcessMean

__all__ = ["GaussianProcessMean"]
