"""The compiled solver, once for all tests of this folder."""

from __future__ import annotations

import pytest

from pyrobocop_pyomo.linear_solver.library import LINEAR_SOLVER_NAME, find_linear_solver, linear_solver_sources
from pyrobocop_pyomo.native.shared_library import build_shared_library, find_compiler


@pytest.fixture(scope="session")
def library():
    """Path of the solver, compiled from the sources as they are, here or by whoever built the wheel."""
    if find_compiler() is None and find_linear_solver() is None:
        pytest.skip("no C compiler is found")
    return str(build_shared_library(LINEAR_SOLVER_NAME, linear_solver_sources()))
