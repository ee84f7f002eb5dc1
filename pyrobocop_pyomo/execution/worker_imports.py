"""What worker processes have in common: imported once by the server that starts them, and copied with it."""

import contextlib

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.ipopt.backends import find_ipopt_library
from pyrobocop_pyomo.optional_imports import scipy

# Libraries are loaded here, and nothing is solved: a copy is to find no state of any solver.
with contextlib.suppress(ImportError, OSError, PyRobocopError):
    _ = scipy.optimize.milp, scipy.sparse.csr_array
    find_ipopt_library()
