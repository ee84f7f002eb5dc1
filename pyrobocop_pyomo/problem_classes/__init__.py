"""Problems written as classes with PyRoboCOP's methods, as models with a phase."""

from .from_pyrobocop import from_pyrobocop
from .solution_arrays import SolutionArrays, solution_arrays
from .stated_problem import StatedProblem

__all__ = ["SolutionArrays", "StatedProblem", "from_pyrobocop", "solution_arrays"]
