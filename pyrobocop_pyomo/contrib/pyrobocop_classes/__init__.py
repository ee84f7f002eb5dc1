"""Problems written as classes with PyRoboCOP's methods, as models with a phase."""

from .from_pyrobocop import SolutionArrays, from_pyrobocop, solution_arrays

__all__ = ["SolutionArrays", "from_pyrobocop", "solution_arrays"]
