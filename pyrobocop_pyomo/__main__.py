"""Command line: ``python -m pyrobocop_pyomo [doctor]`` says which backends are present and work on this machine."""

from __future__ import annotations

import argparse
import importlib.metadata
import platform
import sys
import time
from collections.abc import Sequence
from typing import Any

import pyomo.environ as pyo
from pyomo.common.log import LoggingIntercept
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.ipopt.backends import NO_IPOPT, WAYS_TO_IPOPT, find_ipopt_executable, load_ipopt_library
from pyrobocop_pyomo.ipopt.in_process import InProcessIpopt
from pyrobocop_pyomo.ipopt.linear_solvers import OWN_SOLVER
from pyrobocop_pyomo.linear_solver.factorisation import find_linear_solver
from pyrobocop_pyomo.programs.asl_program import find_asl_library
from pyrobocop_pyomo.programs.summed_terms import how_terms_are_evaluated
from pyrobocop_pyomo.programs.vectorised_program import casadi_available


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pyrobocop_pyomo", description="The solvers of pyrobocop_pyomo.")
    commands = parser.add_subparsers(dest="command", metavar="command")
    commands.add_parser("doctor", help="show which backends to Ipopt work here, and how to get the others (default)")
    parser.parse_args(arguments)
    text, works = report()
    sys.stdout.write(text + "\n")
    return 0 if works else 1


def report() -> tuple[str, bool]:
    """What every backend makes of a small problem, as text, and whether at least one of them works."""
    lines = [f"pyrobocop_pyomo {__version__}", "", f"  {'python':<12}{platform.python_version()}  {sys.executable}"]
    packages = ["pyomo", "numpy", "scipy", "networkx", "casadi", "matplotlib", "pandas"]
    lines += [f"  {package:<12}{_installed(package) or 'not installed'}" for package in packages]
    lines += [
        f"  {OWN_SOLVER:<12}{find_linear_solver() or 'not compiled'}",
        f"  terms       {how_terms_are_evaluated()}",
    ]
    verdicts = []
    for derivatives in (None, "asl", "vectorised"):
        in_process = f'SolverFactory("pyrobocop.ipopt"), derivatives="{derivatives}"'
        verdict, details = _examined(derivatives)
        verdicts.append(verdict)
        lines += ["", f"{in_process if derivatives else 'the ipopt executable'}: {verdict}", *details]
    works = "works" in verdicts
    others = "" if set(verdicts) == {"works"} else f" {WAYS_TO_IPOPT}"
    lines += ["", f"At least one backend to Ipopt works.{others}" if works else NO_IPOPT]
    return "\n".join(lines), works


def _installed(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _examined(derivatives: str | None) -> tuple[str, list[str]]:
    """Whether Ipopt in process, or the executable for None, is found and can be used, and lines that say so."""
    lines: list[str] = []
    try:
        if derivatives is None:
            source = find_ipopt_executable()
        else:
            source = find_asl_library() if derivatives == "asl" else "CasADi" if casadi_available() else None
        if not source:
            return "not found", []
        lines.append(f"  found       {source}")
        with LoggingIntercept(module="pyomo"):  # Pyomo's warnings say the same in other words
            if derivatives is None:
                result = _solved(NewSolverFactory("ipopt", executable=source))
            else:
                lines.append(f"  found       {load_ipopt_library()}")
                result = _solved(InProcessIpopt(derivatives=derivatives))
        return "works", [*lines, f"  result      {result}"]
    except Exception as error:  # a diagnosis reports whatever goes wrong
        return "fails", [*lines, f"  result      {type(error).__name__}: {error}"]


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
    version = ".".join(map(str, results.solver_version or ("of an older version",)))
    iterations = results.extra_info.iteration_count
    return f"Ipopt {version}: objective {objective:.7f}, {iterations} iterations, {seconds:.3f} s"


if __name__ == "__main__":
    sys.exit(main())
