"""Mathematical programs with complementarity constraints whose solutions are known, for tests and benchmarks.

For scripts of this folder, and for tests::

    from known_mpccs import mpcc_problem, mpcc_problems

    problem = mpcc_problem("ralph1")
    model = problem.build()
"""

from .catalogue import mpcc_problem, mpcc_problems
from .entries import MpccProblem

__all__ = ["MpccProblem", "mpcc_problem", "mpcc_problems"]
