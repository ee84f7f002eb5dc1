"""The compiled solver, once for all tests of this folder."""

import pytest

from pyrobocop_pyomo.linear_solver.factorisation import LINEAR_SOLVER_NAME
from pyrobocop_pyomo.native.shared_library import shared_library


@pytest.fixture(scope="session")
def library():
    """Path of the solver, compiled from the sources as they are."""
    found = shared_library(LINEAR_SOLVER_NAME)
    if found is None:
        pytest.skip("the linear solver is not compiled here")
    return str(found)
