"""All problems, and one by its name."""

from __future__ import annotations

import difflib

from . import academic, bilevel, contact, degenerate, equilibrium, forms, generated, infeasible, mixed, obstacle
from .entries import MpccProblem

_FAMILIES = (academic, degenerate, bilevel, generated, equilibrium, forms, contact, obstacle, mixed, infeasible)


def mpcc_problems() -> tuple[MpccProblem, ...]:
    """Return all problems, family by family."""
    return tuple(problem for family in _FAMILIES for problem in family.PROBLEMS)


def mpcc_problem(name: str) -> MpccProblem:
    """Return the problem of this name.

    Raises
    ------
    KeyError
        If there is none; the message lists similar names.
    """
    known = {problem.name: problem for problem in mpcc_problems()}
    if name not in known:
        similar = ", ".join(map(repr, difflib.get_close_matches(name, known, n=5, cutoff=0.4))) or "none"
        raise KeyError(f"no problem is called {name!r}; similar names: {similar}. mpcc_problems() returns all.")
    return known[name]
