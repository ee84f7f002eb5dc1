"""Every way to Ipopt, each where it is there."""

from collections.abc import Iterable
from itertools import cycle
from typing import Any

import pytest

BACKENDS = [
    pytest.param("asl", marks=pytest.mark.asl),
    pytest.param("vectorised", marks=pytest.mark.casadi),
    pytest.param("executable", marks=pytest.mark.executable),
]
every_backend = pytest.mark.parametrize("backend", BACKENDS)


def backends_in_turn(names: str, cases: Iterable[tuple[Any, ...]]) -> pytest.MarkDecorator:
    """Each case with one backend, so that all of them have their turn; `names` are those of the case's parts."""
    turns = zip(cases, cycle(BACKENDS), strict=False)
    params = [pytest.param(*case, *backend.values, marks=backend.marks) for case, backend in turns]
    return pytest.mark.parametrize(f"{names},backend", params)
