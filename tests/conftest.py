"""Which ways to Ipopt the tests may use."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

from pyrobocop_pyomo.ipopt.ipopt_executable import configure_ipopt_executable
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.casadi_program import casadi_available

# A time limit per example fails on a busy machine, not on a wrong law.
settings.register_profile("laws", deadline=None)
settings.load_profile("laws")

FINDERS = {
    "executable": lambda: configure_ipopt_executable() is not None,
    "asl": lambda: asl_available() and find_ipopt_library() is not None,
    "casadi": lambda: casadi_available() and find_ipopt_library() is not None,
}


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a backend that is missing; fail instead where all backends are promised, as in our CI."""
    for backend, found in FINDERS.items():
        if item.get_closest_marker(backend) is not None and not found():
            message = f"no backend '{backend}' on this machine; see: python -m pyrobocop_pyomo doctor"
            if os.environ.get("PYROBOCOP_REQUIRE_ALL_BACKENDS") == "1":
                pytest.fail(message, pytrace=False)
            pytest.skip(message)
