"""Which backends are present and work on this machine, and how to get the others."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib.metadata
import logging
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pyomo.environ as pyo
from pyomo.common import Executable
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory

from pyrobocop_pyomo._version import __version__
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.linear_solver.factorisation import SymmetricFactorisation
from pyrobocop_pyomo.linear_solver.library import find_linear_solver
from pyrobocop_pyomo.programs.asl_program import ASL_REMEDY, find_asl_library
from pyrobocop_pyomo.programs.casadi_program import casadi_available
from pyrobocop_pyomo.programs.compiled_terms import how_terms_are_evaluated

from .asl_derivatives import check_executable, check_library
from .backends import NO_IPOPT
from .in_process import InProcessIpopt
from .ipopt_executable import find_ipopt_executable, ipopt_executable_version
from .ipopt_library import load_ipopt_library
from .linear_solvers import OWN_SOLVER

OPTIMUM = 17.0140172891520542  # of Hock and Schittkowski's problem 71

_EXECUTABLE_REMEDY = (
    "conda install -c conda-forge ipopt, or (Debian, Ubuntu) python -m pyrobocop_pyomo build-asl, or set "
    "PYROBOCOP_IPOPT_EXECUTABLE"
)
_CASADI_REMEDY = "pip install 'pyrobocop_pyomo[ipopt]'"
_DERIVATIVES_REMEDY = (
    "python -m pyrobocop_pyomo build-asl (Debian, Ubuntu); or let Pyomo write Expressions out: "
    "model.write(..., io_options={'export_defined_variables': False})"
)
_COMPILER_REMEDY = "any C compiler, for example: apt-get install gcc (without it Ipopt uses MUMPS, as always)"
# Importing this package leaves Pyomo as it is: an executable outside of PATH is shown to Pyomo on request only.
_NOT_ON_PATH = "Pyomo's own SolverFactory finds it after pyrobocop_pyomo.ipopt.configure_ipopt_executable()"


@dataclasses.dataclass(frozen=True)
class BackendDiagnosis:
    """What is known of one backend to Ipopt.

    Attributes
    ----------
    name : str
        As the user asks for it.
    where : str
        Path and version, empty when it is not found.
    works : bool
        Whether it solved a small problem to 1e-6.
    result : str
        What the small problem gave, or why it failed.
    remedy : str
        How to get it, when it does not work.
    note : str
        What has to be done before it is used, or how it evaluates.
    """

    name: str
    where: str
    works: bool
    result: str
    remedy: str
    note: str = ""


def examine_backends() -> list[BackendDiagnosis]:
    """Look for every backend to Ipopt and solve a small problem on it."""
    casadi = _installed("casadi") if casadi_available() else ""
    return [
        *(_executable_backend(name) for name in ("ipopt", "ipopt_v2")),
        _in_process_backend("asl", find_asl_library() or "", ASL_REMEDY),
        *(_in_process_backend(derivatives, casadi, _CASADI_REMEDY) for derivatives in ("casadi", "vectorised")),
    ]


def report() -> tuple[str, bool]:
    """The diagnosis as text, and whether at least one backend works."""
    lines = [f"pyrobocop_pyomo {__version__}", ""]
    lines.append(f"  {'python':<12}{platform.python_version()}  {sys.executable}")
    packages = ["pyomo", "numpy", "scipy", "networkx", "casadi", "highspy", "matplotlib", "pandas"]
    lines += [f"  {package:<12}{_installed(package) or 'not installed'}" for package in packages]
    backends = examine_backends()
    for backend in backends:
        verdict = "works" if backend.works else "fails" if backend.where else "not found"
        lines += ["", f"{backend.name}: {verdict}"]
        facts = {"found": backend.where, "solve": backend.result, "note": backend.note}
        lines += [f"  {label:<12}{text}" for label, text in facts.items() if text]
        if not backend.works:
            lines.append(f"  {'remedy':<12}{backend.remedy}")
    lines += _derivative_lines()
    lines += _linear_solver_lines()
    works = any(backend.works for backend in backends)
    lines += ["", "At least one backend to Ipopt works." if works else NO_IPOPT]
    return "\n".join(lines), works


def _derivative_lines() -> list[str]:
    """Whether each AMPL Solver Library on this machine, wherever it comes from, differentiates rightly."""
    lines = []
    for title, paths, check in (
        ("the ipopt executable", _executables(), check_executable),
        ("PyNumero's library", _libraries(), check_library),
    ):
        for path in paths:
            found = check(path)
            lines += ["", f"derivatives of {title}", f"  {'found':<12}{path}", f"  {'derivatives':<12}{found}"]
            if not found.right:
                lines.append(f"  {'remedy':<12}{_DERIVATIVES_REMEDY}")
    return lines


def _executables() -> list[str]:
    """The one that this package takes, the one that Pyomo takes, and what build-asl installed."""
    chosen = ""
    with contextlib.suppress(SolverNotFoundError):
        chosen = find_ipopt_executable() or ""
    return _different(chosen, Executable("ipopt").path(), Path(sys.prefix) / "bin" / "ipopt")


def _libraries() -> list[str]:
    """The one that Pyomo or this package takes, and what build-asl installed."""
    return _different(find_asl_library(), Path(sys.prefix) / "lib" / "libpynumero_ASL.so")


def _different(*paths: str | Path | None) -> list[str]:
    files = {Path(path).resolve(): str(path) for path in reversed(paths) if path and Path(path).is_file()}
    return list(reversed(files.values()))


def _linear_solver_lines() -> list[str]:
    """The linear solver of this package: no backend, and nothing is missing without it."""
    name = f"linear solver '{OWN_SOLVER}'"
    try:
        library = find_linear_solver()
        if library is None:
            return ["", f"{name}: not compiled", f"  {'to get it':<12}{_COMPILER_REMEDY}"]
        diagonal = SymmetricFactorisation(3, [0, 1, 0], [1, 2, 0], library).factor([1.0, 1.0, 1.0]).negative
    except Exception as error:  # a diagnosis reports whatever goes wrong
        return ["", f"{name}: fails", f"  {'found':<12}{type(error).__name__}: {error}"]
    verdict = "works" if diagonal == 1 else "fails"
    return ["", f"{name}: {verdict}", f"  {'found':<12}{library}"]


def _installed(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _executable_backend(name: str) -> BackendDiagnosis:
    title = f'SolverFactory("{name}")'
    try:
        path = find_ipopt_executable()
    except SolverNotFoundError as error:
        return BackendDiagnosis(title, "", False, str(error), _EXECUTABLE_REMEDY)
    if path is None:
        return BackendDiagnosis(title, "", False, "", _EXECUTABLE_REMEDY)
    version = ipopt_executable_version(path)
    if version is None:
        return BackendDiagnosis(title, path, False, f"'{path} --version' does not run", _EXECUTABLE_REMEDY)
    solve = functools.partial(_solve_legacy if name == "ipopt" else _solve_new, path)
    found = _tried(title, f"{path}  {version}", _EXECUTABLE_REMEDY, solve)
    return found if Executable("ipopt").path() == path else dataclasses.replace(found, note=_NOT_ON_PATH)


def _in_process_backend(derivatives: str, found: str, remedy: str) -> BackendDiagnosis:
    title = f'SolverFactory("pyrobocop.ipopt"), derivatives="{derivatives}"'
    if not found:
        return BackendDiagnosis(title, "", False, "", remedy)
    try:
        where = f"{load_ipopt_library()}, {derivatives} {found}"
    except Exception as error:
        return BackendDiagnosis(title, "", False, str(error), _CASADI_REMEDY)

    def solve(model: pyo.ConcreteModel) -> int:
        return InProcessIpopt(derivatives=derivatives).solve(model).extra_info.iteration_count

    found_out = _tried(title, where, remedy, solve)
    return dataclasses.replace(found_out, note=how_terms_are_evaluated()) if derivatives == "vectorised" else found_out


def _tried(title: str, where: str, remedy: str, solve: Callable[[pyo.ConcreteModel], int]) -> BackendDiagnosis:
    model = _small_problem()
    started = time.perf_counter()
    try:
        iterations = solve(model)
    except Exception as error:  # a diagnosis reports whatever goes wrong
        return BackendDiagnosis(title, where, False, f"{type(error).__name__}: {error}", remedy)
    seconds = time.perf_counter() - started
    objective = pyo.value(model.objective)
    result = f"objective {objective:.7f}, {iterations} iterations, {seconds:.3f} s"
    if abs(objective - OPTIMUM) > 1e-6:
        return BackendDiagnosis(title, where, False, f"{result}; {OPTIMUM:.7f} was expected", remedy)
    return BackendDiagnosis(title, where, True, result, remedy)


def _solve_legacy(executable: str, model: pyo.ConcreteModel) -> int:
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "ipopt.log"
        pyo.SolverFactory("ipopt", executable=executable).solve(model, logfile=str(log))
        found = re.search(r"Number of Iterations\.*: *(\d+)", log.read_text(encoding="utf-8"))
    return int(found.group(1)) if found else -1


def _solve_new(executable: str, model: pyo.ConcreteModel) -> int:
    # Registered as "ipopt" there; "ipopt_v2" is its name in the older factory.
    return NewSolverFactory("ipopt", executable=executable).solve(model).extra_info.iteration_count


def _small_problem() -> pyo.ConcreteModel:
    """Problem 71 of Hock & Schittkowski, Test Examples for Nonlinear Programming Codes (1981)."""
    model = pyo.ConcreteModel("hock_schittkowski_71")
    model.x = pyo.Var([1, 2, 3, 4], bounds=(1, 5), initialize={1: 1, 2: 5, 3: 5, 4: 1})
    x = model.x
    model.objective = pyo.Objective(expr=x[1] * x[4] * (x[1] + x[2] + x[3]) + x[3])
    model.product = pyo.Constraint(expr=x[1] * x[2] * x[3] * x[4] >= 25)
    model.sphere = pyo.Constraint(expr=sum(x[i] ** 2 for i in (1, 2, 3, 4)) == 40)
    return model


@contextlib.contextmanager
def pyomo_warnings_off() -> Iterator[None]:
    """Keep Pyomo's warnings about solvers out of the report, which says the same in its own words."""
    logger = logging.getLogger("pyomo")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)
