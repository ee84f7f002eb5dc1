"""Solves that have to succeed, refusals that have to leave everything as it was, and what Pyomo tells of times."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from pyomo.common.timing import report_timing

import pyrobocop_pyomo as rcp


def solution(model: Any, **options: Any) -> rcp.SolveResult:
    """The result of a solve that succeeds."""
    result = rcp.solve(model, **{"progress": False, **options})
    assert result.solved, str(result)
    return result


def timing_report(act: Callable[[], Any]) -> str:
    """What Pyomo tells of times while something is done."""
    text = io.StringIO()
    report_timing(text)
    try:
        act()
    finally:
        report_timing(False)
    return text.getvalue()


@contextmanager
def unchanged(look: Callable[[Any], Any], of: Any) -> Iterator[None]:
    """What a look shows before is what it shows after, whatever was tried in between."""
    before = look(of)
    yield
    assert look(of) == before
