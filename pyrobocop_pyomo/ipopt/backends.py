"""The backends to Ipopt that are present on this machine, best first.

Ipopt's shared library: where it is, what version it is, and its C interface for ctypes.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import enum
import functools
import importlib.util
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyomo.common import Executable
from pyomo.common.fileutils import find_executable

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.native.shared_library import HOW_TO_COMPILE
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.vectorised_program import casadi_available

# ------------------------------------------------------------------------------------------------- the library of Ipopt


logger = logging.getLogger(__name__)

LIBRARY_VARIABLE = "PYROBOCOP_IPOPT_LIBRARY"

# The names differ by system and by who built it; a bare "libipopt.so" is a development link and comes last.
_NAMES = {
    "win32": ("ipopt-3.dll", "libipopt-3.dll", "ipopt.dll", "libipopt.dll"),
    "darwin": ("libipopt.3.dylib", "libipopt.dylib"),
}.get(sys.platform, ("libipopt.so.3", "libipopt.so.1", "libipopt.so"))

# ipnumber is double and ipindex is int in every build that casadi, conda-forge and Debian ship.
_number = ctypes.c_double
_index = ctypes.c_int
# Addresses are taken as plain integers: making a NumPy view of one is cheaper than going through POINTER.
_address = ctypes.c_void_p

# Callbacks return C int and take `new_x` as C int: `bool` since 3.14 and `int` before read it alike.
EvalF = ctypes.CFUNCTYPE(_index, _index, _address, _index, _address, _address)
EvalGradF = ctypes.CFUNCTYPE(_index, _index, _address, _index, _address, _address)
EvalG = ctypes.CFUNCTYPE(_index, _index, _address, _index, _index, _address, _address)
EvalJacG = ctypes.CFUNCTYPE(_index, _index, _address, _index, _index, _index, _address, _address, _address, _address)
EvalH = ctypes.CFUNCTYPE(
    _index, _index, _address, _index, _number, _index, _address, _index, _index,
    _address, _address, _address, _address,
)  # fmt: skip
Intermediate = ctypes.CFUNCTYPE(
    _index, _index, _index, _number, _number, _number, _number, _number, _number, _number, _number,
    _index, _address,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class IpoptLibrary:
    """A loaded Ipopt library.

    Attributes
    ----------
    path : str
        File that was loaded.
    version : tuple of int, or None
        ``(3, 14, 19)``; None where the library is too old to tell (before 3.14.19), as in CasADi 3.7.0.
    functions : ctypes.CDLL
        The C interface, with argument types declared.
    """

    path: str
    version: tuple[int, int, int] | None
    functions: ctypes.CDLL

    def __str__(self) -> str:
        """Name, version and file, for logs and messages."""
        version = ".".join(map(str, self.version)) if self.version else "older than 3.14.19"
        return f"Ipopt {version} ({self.path})"


def find_ipopt_library() -> str | None:
    """Path (or name, where only the system's loader knows it) of an Ipopt library, or None.

    The order: the environment variable ``PYROBOCOP_IPOPT_LIBRARY``; the library inside the casadi package, which
    is not imported for that; the library folder of this Python environment (conda); the system's loader.
    """
    chosen = os.environ.get(LIBRARY_VARIABLE)
    if chosen:
        if not Path(chosen).is_file():
            raise SolverNotFoundError(
                f"{LIBRARY_VARIABLE} is '{chosen}', but there is no such file. Correct the variable or unset it."
            )
        return chosen
    folders = []
    casadi = importlib.util.find_spec("casadi")
    if casadi is not None and casadi.origin is not None:
        folders.append(Path(casadi.origin).parent)
    folders += [Path(sys.prefix) / "lib", Path(sys.prefix) / "Library" / "bin"]
    for folder in folders:
        for name in _NAMES:
            if (folder / name).is_file():
                return str(folder / name)
    return ctypes.util.find_library("ipopt")


def load_ipopt_library(path: str | None = None) -> IpoptLibrary:
    """Load an Ipopt library and declare its functions.

    Parameters
    ----------
    path : str, optional
        File to load; by default what `find_ipopt_library` finds.

    Raises
    ------
    SolverNotFoundError
        When none is found, or the file cannot be loaded or is no Ipopt.
    """
    path = path or find_ipopt_library()
    if path is None:
        raise SolverNotFoundError(
            "no Ipopt library is found: casadi is not installed, and neither this Python environment nor the "
            "system has one. Run: pip install 'pyrobocop_pyomo[ipopt]', or set the environment variable "
            f"{LIBRARY_VARIABLE} to the file."
        )
    return _load(path)


@functools.cache
def _load(path: str) -> IpoptLibrary:
    try:
        functions = ctypes.CDLL(path)
        _declare(functions)
    except (OSError, AttributeError) as error:
        raise SolverNotFoundError(
            f"'{path}' cannot be used as Ipopt's library: {error}. Install another one, for example by "
            f"pip install 'pyrobocop_pyomo[ipopt]', or set {LIBRARY_VARIABLE} to the file."
        ) from error
    version = _version(functions)
    logger.debug("loaded Ipopt %s from %s", version, path)
    return IpoptLibrary(path, version, functions)


def _declare(functions: ctypes.CDLL) -> None:
    problem, name, truth = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_bool
    sizes_and_bounds = [_index, _address, _address, _index, _address, _address, _index, _index, _index]
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "CreateIpoptProblem": (problem, [*sizes_and_bounds, EvalF, EvalG, EvalGradF, EvalJacG, EvalH]),
        "FreeIpoptProblem": (None, [problem]),
        "AddIpoptStrOption": (truth, [problem, name, ctypes.c_char_p]),
        "OpenIpoptOutputFile": (truth, [problem, name, _index]),
        "AddIpoptNumOption": (truth, [problem, name, _number]),
        "AddIpoptIntOption": (truth, [problem, name, _index]),
        "SetIntermediateCallback": (truth, [problem, Intermediate]),
        "SetIpoptProblemScaling": (truth, [problem, _number, _address, _address]),
        "IpoptSolve": (_index, [problem] + [_address] * 7),
    }
    for function, (returned, arguments) in signatures.items():
        declared = getattr(functions, function)
        declared.restype, declared.argtypes = returned, arguments


def _version(functions: ctypes.CDLL) -> tuple[int, int, int] | None:
    if not hasattr(functions, "GetIpoptVersion"):
        return None
    numbers = [ctypes.c_int() for _ in range(3)]
    functions.GetIpoptVersion(*map(ctypes.byref, numbers))
    major, minor, release = (number.value for number in numbers)
    return major, minor, release


# ------------------------------------------------------------------------------------------------------------- backends


EXECUTABLE_VARIABLE = "PYROBOCOP_IPOPT_EXECUTABLE"


def find_ipopt_executable() -> str | None:
    """Path of an ``ipopt`` executable, or None; nothing is started.

    The order: the environment variable ``PYROBOCOP_IPOPT_EXECUTABLE``; where Pyomo looks (PATH, ``~/.pyomo/bin``, a
    path set before); the ``bin`` folder of this Python environment, where ``build_asl.py`` puts it; the folder of
    IDAES.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that cannot be executed.
    """
    chosen = os.environ.get(EXECUTABLE_VARIABLE)
    if chosen:
        if not os.access(chosen, os.X_OK) or Path(chosen).is_dir():
            raise SolverNotFoundError(
                f"{EXECUTABLE_VARIABLE} is '{chosen}', which is no executable file. Correct the variable or unset it."
            )
        return chosen
    known = Executable("ipopt").path()
    if known:
        return str(known)
    folders = [
        os.path.join(sys.prefix, "bin"),
        os.path.join(sys.prefix, "Library", "bin"),
        os.path.expanduser("~/.idaes/bin"),
    ]
    found: str | None = find_executable("ipopt", cwd=False, include_PATH=False, pathlist=folders)
    return found


def configure_ipopt_executable() -> str | None:
    """Let Pyomo's own solvers ``ipopt`` and ``ipopt_v2`` find the executable of this Python environment.

    Importing this package changes nothing of Pyomo, and the solvers of this package need no call: this function is
    for ``SolverFactory("ipopt")`` in a Python environment where ``build_asl.py`` or conda has put the executable,
    without its folder being on PATH. An executable that Pyomo finds by itself stays the one that it uses, unless the
    environment variable ``PYROBOCOP_IPOPT_EXECUTABLE`` asks for another.

    Returns
    -------
    str or None
        Path of the executable that Pyomo uses from now on; None when there is none.

    Raises
    ------
    SolverNotFoundError
        When the variable names a file that cannot be executed.
    """
    path = find_ipopt_executable()
    if path is not None and path != Executable("ipopt").path():
        Executable("ipopt").set_path(path)
    return path


def ipopt_executable_version(path: str) -> str | None:
    """First line of ``ipopt --version``, or None when it cannot be run or is no Ipopt."""
    try:
        run = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    line = run.stdout.strip().partition("\n")[0]
    return line if run.returncode == 0 and line.lower().startswith("ipopt") else None


WAYS_TO_IPOPT = f"""\
Any one of these brings Ipopt, and derivatives for it:
  pip install 'pyrobocop_pyomo[ipopt]'      CasADi's Ipopt, used in this process: works at once
  conda install -c conda-forge ipopt        the ipopt executable
  python build_asl.py, in a clone           Debian, Ubuntu: the executable, and ASL for use in this process
or, for an Ipopt that is there already, one of these environment variables:
  {EXECUTABLE_VARIABLE}=/path/to/ipopt
  {LIBRARY_VARIABLE}=/path/to/libipopt.so
The linear solver of this package: {HOW_TO_COMPILE}.
'python -m pyrobocop_pyomo doctor' shows what is found and what is missing."""


NO_IPOPT = f"no Ipopt is found on this machine. {WAYS_TO_IPOPT}"


class Backend(enum.Enum):
    """Where Ipopt runs, and where its derivatives come from; the value is a description."""

    IN_PROCESS_VECTORISED = "Ipopt in this process, derivatives by CasADi on vectorised expressions"
    IN_PROCESS_CASADI = IN_PROCESS_VECTORISED  # another name of the same
    IN_PROCESS_ASL = "Ipopt in this process, derivatives by ASL through PyNumero"
    EXECUTABLE = "the ipopt executable, derivatives by ASL"

    @property
    def derivatives(self) -> str | None:
        """What `CompiledModel` calls the source of derivatives; None for the executable."""
        return {Backend.IN_PROCESS_VECTORISED: "vectorised", Backend.IN_PROCESS_ASL: "asl"}.get(self)


def available_backends() -> list[Backend]:
    """Backends that are present, best first; nothing is loaded or started."""
    in_process = _found(find_ipopt_library)
    present = {
        Backend.IN_PROCESS_VECTORISED: in_process and casadi_available(),
        Backend.IN_PROCESS_ASL: in_process and asl_available(),
        Backend.EXECUTABLE: _found(find_ipopt_executable),
    }
    return [backend for backend in Backend if present[backend]]


def best_backend() -> Backend:
    """The best backend that is present.

    Raises
    ------
    SolverNotFoundError
        When there is none; the message lists the remedies.
    """
    backends = available_backends()
    if not backends:
        raise SolverNotFoundError(NO_IPOPT)
    return backends[0]


def _found(find: Callable[[], str | None]) -> bool:
    """A variable that names a missing file means: not found. Whoever then asks for that backend gets the message."""
    try:
        return find() is not None
    except SolverNotFoundError:
        return False
