"""Finding the ``ipopt`` executable, also where Pyomo does not look."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from pyomo.common import Executable

from pyrobocop_pyomo.errors import SolverNotFoundError

EXECUTABLE_VARIABLE = "PYROBOCOP_IPOPT_EXECUTABLE"

_NAME = "ipopt.exe" if sys.platform == "win32" else "ipopt"


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
    folders = [Path(sys.prefix) / "bin", Path(sys.prefix) / "Library" / "bin"]
    with contextlib.suppress(RuntimeError):  # a container's user may have no home
        folders.append(Path.home() / ".idaes" / "bin")
    for folder in folders:
        path = folder / _NAME
        if path.is_file() and os.access(path, os.X_OK):
            return str(path)
    return None


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
