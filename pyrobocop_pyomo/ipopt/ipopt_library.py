"""Ipopt's shared library: where it is, what version it is, and its C interface for ctypes."""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import importlib.util
import logging
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyrobocop_pyomo.errors import SolverNotFoundError

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
