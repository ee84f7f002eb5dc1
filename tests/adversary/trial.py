"""One trial: a seed picks a problem and what spoils it, and says what became of the answer."""

import enum
import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import PyRobocopError

from .judge import BETTER, Judge
from .models import PROBLEMS, Problem, objective_of
from .outcome import Trial
from .spoilers import SPOILERS, Law, NothingToSpoil, Spoilt
from .statements import STATEMENTS, Statement, complaint

KINDS = (*SPOILERS, *STATEMENTS)


class Verdict(enum.Enum):
    """What became of a spoilt problem."""

    REFUSED = "refused"
    NOT_SOLVED = "not solved"
    NAMED = "named"
    AGREED = "agreed"
    FAULT = "fault"


def spoilt_by(seed: int, spoiler: str) -> tuple[Problem, Spoilt | PyRobocopError]:
    """What a seed stands for: the problem, and the model or its refusal.

    The problem is the first, in an order by chance, that has what is to be spoilt; chance may pick what a problem does
    not read, and is asked again.
    """
    random = np.random.default_rng(seed)
    for place in random.permutation(len(PROBLEMS)).tolist() * 5:
        problem = list(PROBLEMS.values())[place]
        try:
            return problem, SPOILERS[spoiler](problem, random)
        except NothingToSpoil:
            continue
        except PyRobocopError as error:
            return problem, error
    raise AssertionError(f"no problem has anything for '{spoiler}'")


def tried(seed: int, kind: str | None = None) -> Trial:
    """Spoil or state, solve and judge.

    The kinds take turns unless one is named, and a named one has the same case when another joins the list.
    """
    name, problem = kind or KINDS[seed % len(KINDS)], ""
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)  # Pyomo tells of each value out of bounds, and of each model that it cannot write
    try:
        if name in STATEMENTS:
            verdict, told = _compared(name, seed)
        else:
            of, spoilt = spoilt_by(seed, name)
            problem = of.name
            refused = isinstance(spoilt, PyRobocopError)
            verdict, told = (Verdict.REFUSED, str(spoilt)) if refused else _judged(of, spoilt, seed)
    finally:
        logging.disable(level)
    return Trial(seed, name, verdict, told, problem)


def _compared(name: str, seed: int) -> tuple[Verdict, str]:
    """What became of a statement whose answer is known from mathematics."""
    stated: list[Statement] = []

    def state_and_solve() -> tuple[Any, Any]:
        stated.append(STATEMENTS[name](np.random.default_rng(seed)))
        return stated[0].solve(stated[0].model)

    ended, result, model = _solved(state_and_solve)
    if ended is not None:
        return ended
    (statement,) = stated
    wrong = complaint(result, model, statement)
    if wrong is not None:
        return Verdict.FAULT, f"{wrong}: {_first_line(result)}"
    # Rightly so, or only since nothing is claimed.
    agreed = complaint(result, model, statement, claimed=False) is None
    return (Verdict.AGREED, _first_line(result)) if agreed else (Verdict.NAMED, result.report())


def _judged(problem: Problem, spoilt: Spoilt, seed: int) -> tuple[Verdict, str]:
    ended, result, _ = _solved(lambda: (spoilt.solve(spoilt.model), None))
    if ended is not None:
        return ended
    wrong = _complaint(problem, spoilt, result, seed)
    if wrong is None:
        return Verdict.AGREED, _first_line(result)
    # Where the mesh was too coarse before, that is no word on what was spoilt.
    if "COARSE MESH" in str(result) and "COARSE MESH" not in str(problem.answer):
        return Verdict.NAMED, result.report()
    return Verdict.FAULT, wrong


def _solved(solve: Callable[[], tuple[Any, Any]]) -> tuple[tuple[Verdict, str] | None, Any, Any]:
    """A result and its model, or before them what became of it where there is no clean report."""
    try:
        result, model = solve()
    except PyRobocopError as error:
        return (Verdict.REFUSED, str(error)), None, None
    except Exception as error:
        return (Verdict.FAULT, f"{type(error).__name__}: {error}"), None, None
    if not getattr(result, "solved", True):
        return (Verdict.NOT_SOLVED, result.report()), None, None
    if getattr(result, "doubts", ()) or "NOT SAFE" in _first_line(result):
        return (Verdict.NAMED, result.report()), None, None
    return None, result, model


def _complaint(problem: Problem, spoilt: Spoilt, result: Any, seed: int) -> str | None:
    """What is wrong with a solution, or None."""
    if spoilt.law is Law.DOUBTED:
        return f"a clean report: {_first_line(result)}"
    expected, found = spoilt.factor * problem.answer.objective, pyo.value(objective_of(spoilt.model), exception=False)
    size = abs(expected)
    if spoilt.law is Law.SAME and found is not None and abs(found - expected) <= BETTER * size:
        return None
    wrong = Judge(spoilt.model).complaint(size, seed)
    if wrong is None and spoilt.law is Law.SAME and problem.convex:
        return f"objective {found} in place of {expected}"
    return wrong


def _first_line(result: Any) -> str:
    return str(result).partition("\n")[0]


def executable_found() -> bool:
    """Whether the judge has its executable."""
    return rcp.ipopt.configure_ipopt_executable() is not None
