"""One trial: a seed picks a problem and what spoils it, and says what became of the answer."""

from __future__ import annotations

import enum
import logging
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import PyRobocopError

from .judge import BETTER, Judge
from .models import PROBLEMS, Problem, objective_of
from .outcome import Trial
from .spoilers import SPOILERS, Law, Spoilt


class Verdict(enum.Enum):
    """What became of a spoilt problem."""

    REFUSED = "refused"
    NOT_SOLVED = "not solved"
    NAMED = "named"
    AGREED = "agreed"
    FAULT = "fault"


def spoilt_by(seed: int, spoiler: str | None = None) -> tuple[str, Problem, Spoilt | PyRobocopError]:
    """What a seed stands for: the spoiler, the problem, and the model or its refusal.

    The spoilers take turns unless one is named, and a named one has the same case when another joins the list. The
    problem is the first, in an order by chance, that has what is to be spoilt.
    """
    name = spoiler or list(SPOILERS)[seed % len(SPOILERS)]
    random = np.random.default_rng(seed)
    for place in random.permutation(len(PROBLEMS)):
        problem = list(PROBLEMS.values())[place]
        try:
            spoilt = SPOILERS[name](problem, random)
        except PyRobocopError as error:
            return name, problem, error
        if spoilt is not None:
            return name, problem, spoilt
    raise AssertionError(f"no problem has anything for '{name}'")


def tried(seed: int, spoiler: str | None = None) -> Trial:
    """Spoil, solve and judge."""
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)  # Pyomo tells of each value out of bounds, and of each model that it cannot write
    try:
        name, problem, spoilt = spoilt_by(seed, spoiler)
        verdict, told = (
            (Verdict.REFUSED, str(spoilt)) if isinstance(spoilt, PyRobocopError) else _judged(problem, spoilt, seed)
        )
    finally:
        logging.disable(level)
    return Trial(seed, name, verdict, told, problem.name)


def _judged(problem: Problem, spoilt: Spoilt, seed: int) -> tuple[Verdict, str]:
    try:
        result = spoilt.solve(spoilt.model)
    except PyRobocopError as error:
        return Verdict.REFUSED, str(error)
    except Exception as error:
        return Verdict.FAULT, f"{type(error).__name__}: {error}"
    if not getattr(result, "solved", True):
        return Verdict.NOT_SOLVED, result.report()
    if getattr(result, "doubts", ()) or "NOT SAFE" in _first_line(result):
        return Verdict.NAMED, result.report()
    complaint = _complaint(problem, spoilt, result, seed)
    if complaint is None:
        return Verdict.AGREED, _first_line(result)
    # Where the mesh was too coarse before, that is no word on what was spoilt.
    if "COARSE MESH" in str(result) and "COARSE MESH" not in str(problem.answer):
        return Verdict.NAMED, result.report()
    return Verdict.FAULT, complaint


def _complaint(problem: Problem, spoilt: Spoilt, result: Any, seed: int) -> str | None:
    """What is wrong with a solution, or None."""
    if spoilt.law is Law.DOUBTED:
        return f"a clean report: {_first_line(result)}"
    expected, found = spoilt.factor * problem.answer.objective, pyo.value(objective_of(spoilt.model), exception=False)
    size = abs(expected)
    if spoilt.law is Law.SAME and found is not None and abs(found - expected) <= BETTER * size:
        return None
    complaint = Judge(spoilt.model).complaint(size, seed)
    if complaint is None and spoilt.law is Law.SAME and problem.convex:
        return f"objective {found} in place of {expected}"
    return complaint


def _first_line(result: Any) -> str:
    return str(result).partition("\n")[0]


def executable_found() -> bool:
    """Whether the judge has its executable."""
    return rcp.ipopt.configure_ipopt_executable() is not None
