"""Every way to Ipopt, each where it is there."""

import pytest

BACKENDS = [
    pytest.param("asl", marks=pytest.mark.asl),
    pytest.param("vectorised", marks=pytest.mark.casadi),
    pytest.param("executable", marks=pytest.mark.executable),
]
every_backend = pytest.mark.parametrize("backend", BACKENDS)
