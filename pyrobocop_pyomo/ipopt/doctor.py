"""Which backends are present and work on this machine, and how to get the others."""

from __future__ import annotations

import importlib.metadata
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pyomo.environ as pyo
from pyomo.common import Executable
from pyomo.common.log import LoggingIntercept
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.linear_solver.factorisation import SymmetricFactorisation
from pyrobocop_pyomo.linear_solver.library import find_linear_solver
from pyrobocop_pyomo.programs.asl_program import find_asl_library
from pyrobocop_pyomo.programs.compiled_terms import how_terms_are_evaluated
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

from .backends import NO_IPOPT, WAYS_TO_IPOPT, find_ipopt_executable, ipopt_executable_version
from .in_process import InProcessIpopt
from .ipopt_library import load_ipopt_library
from .linear_solvers import OWN_SOLVER


def report() -> tuple[str, bool]:
    """What every backend makes of a small problem, as text, and whether at least one of them works."""
    lines = [f"pyrobocop_pyomo {__version__}", "", f"  {'python':<12}{platform.python_version()}  {sys.executable}"]
    packages = ["pyomo", "numpy", "scipy", "networkx", "casadi", "matplotlib", "pandas"]
    lines += [f"  {package:<12}{_installed(package) or 'not installed'}" for package in packages]
    in_process = 'SolverFactory("pyrobocop.ipopt"), derivatives="{}"'.format
    *backends, solver = (
        _examined("the ipopt executable", find_ipopt_executable, _solved_by_executable),
        _examined(in_process("asl"), find_asl_library, partial(_solved_in_process, "asl")),
        _examined(in_process("vectorised"), _find_casadi, partial(_solved_in_process, "vectorised")),
        # No backend, and nothing is missing without it.
        _examined(f"linear solver '{OWN_SOLVER}'", find_linear_solver, _factored),
    )
    works = any(fine for fine, _ in backends)
    lines += [line for _, examined in (*backends, solver) for line in examined]
    others = "" if all(fine for fine, _ in backends) else f" {WAYS_TO_IPOPT}"
    lines += ["", f"At least one backend to Ipopt works.{others}" if works else NO_IPOPT]
    return "\n".join(lines), works


def _examined(title: str, find: Callable[[], str | None], use: Callable[[str], list[str]]) -> tuple[bool, list[str]]:
    """Whether what is found can be used, and lines that say so."""
    lines: list[str] = []
    verdict = "not found"
    try:
        found = find()
        if found:
            lines.append(f"  found       {found}")
            with LoggingIntercept(module="pyomo"):  # Pyomo's warnings say the same in other words
                lines += [f"  result      {line}" for line in use(found)]
            verdict = "works"
    except Exception as error:  # a diagnosis reports whatever goes wrong
        lines.append(f"  result      {type(error).__name__}: {error}")
        verdict = "fails"
    return verdict == "works", ["", f"{title}: {verdict}", *lines]


def _installed(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _find_casadi() -> str | None:
    return f"casadi {_installed('casadi')}" if casadi_available() else None


def _solved_by_executable(path: str) -> list[str]:
    version = ipopt_executable_version(path)
    if version is None:
        raise SolverNotFoundError(f"'{path} --version' does not run")
    lines = [version, _solved(NewSolverFactory("ipopt", executable=path))]
    if Executable("ipopt").path() != path:
        # Importing this package leaves Pyomo as it is: an executable outside of PATH is shown to Pyomo on request only.
        lines.append("Pyomo's own SolverFactory finds it after pyrobocop_pyomo.ipopt.configure_ipopt_executable()")
    return lines


def _solved_in_process(derivatives: str, found: str) -> list[str]:
    notes = [how_terms_are_evaluated()] if derivatives == "vectorised" else []
    return [str(load_ipopt_library()), _solved(InProcessIpopt(derivatives=derivatives)), *notes]


def _factored(library: str) -> list[str]:
    negative = SymmetricFactorisation(3, [0, 1, 0], [1, 2, 0], library).factor([1.0, 1.0, 1.0]).negative
    if negative != 1:
        raise ArithmeticError(f"{negative} negative eigenvalues of a matrix with 1")
    return []


def _solved(solver: Any) -> str:
    """What a solver makes of Hock & Schittkowski, Test Examples for Nonlinear Programming Codes (1981), no. 71."""
    optimum = 17.0140172891520542
    model = pyo.ConcreteModel("hock_schittkowski_71")
    model.x = pyo.Var([1, 2, 3, 4], bounds=(1, 5), initialize={1: 1, 2: 5, 3: 5, 4: 1})
    x = model.x
    model.objective = pyo.Objective(expr=x[1] * x[4] * (x[1] + x[2] + x[3]) + x[3])
    model.product = pyo.Constraint(expr=x[1] * x[2] * x[3] * x[4] >= 25)
    model.sphere = pyo.Constraint(expr=sum(x[i] ** 2 for i in (1, 2, 3, 4)) == 40)
    started = time.perf_counter()
    results = solver.solve(model)
    seconds, objective = time.perf_counter() - started, pyo.value(model.objective)
    if abs(objective - optimum) > 1e-6:
        raise ArithmeticError(f"objective {objective:.7f}; {optimum:.7f} was expected")
    return f"objective {objective:.7f}, {results.extra_info.iteration_count} iterations, {seconds:.3f} s"
