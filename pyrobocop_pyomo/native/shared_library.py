"""C sources of this package as shared libraries beside them, which setuptools compiles when the package is installed.

The name of a library tells its sources and how they are compiled: one that is older than they are is not loaded. This
file needs Python alone, since ``setup.py`` runs it before anything else is installed.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

logger = logging.getLogger(__name__)

SWITCH_VARIABLE = "PYROBOCOP_NATIVE"
# No contraction of a product and a sum: the results are those of NumPy, on every processor.
FLAGS = (
    "-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared",
    "-fvisibility=hidden",
)  # fmt: skip
_PACKAGE = Path(__file__).parents[1]
# Name of a library: the folder of its sources, and of itself.
LIBRARIES = {"linear_solver": _PACKAGE / "linear_solver" / "source", "term_evaluation": _PACKAGE / "programs"}


def native_allowed() -> bool:
    """Whether compiled parts are made and used at all: not where ``PYROBOCOP_NATIVE`` is ``off`` or ``0``."""
    return os.environ.get(SWITCH_VARIABLE, "").lower() not in ("off", "0", "no", "false")


def find_compiler() -> list[str] | None:
    """The command of a C compiler: ``$CC``, else ``cc``, ``gcc`` or ``clang``; None where there is none."""
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in [chosen] if chosen else [["cc"], ["gcc"], ["clang"]]:
        found = shutil.which(command[0])
        if found is not None:
            return [found, *command[1:]]
    return None


def library_sources(name: str) -> list[Path]:
    """The C files of a library, and then the headers that they include."""
    return [path for pattern in ("*.c", "*.h") for path in sorted(LIBRARIES[name].glob(pattern))]


def library_file(name: str) -> Path:
    """Where a library is, or would be."""
    key = hashlib.sha256(repr((name, *FLAGS, sys.platform, platform.machine())).encode())
    for source in library_sources(name):
        key.update(source.read_bytes())
    suffix = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
    return LIBRARIES[name] / f"{name}-{key.hexdigest()[:16]}{suffix}"


def shared_library(name: str) -> Path | None:
    """A library that can be loaded; None, and the reason in the log, where it is switched off or was not compiled."""
    library = library_file(name)
    try:
        if native_allowed():
            ctypes.CDLL(str(library))  # who is given its path, as Ipopt is, has no other library to go on with
            return library
    except OSError as error:
        logger.info("without the compiled part '%s': %s", name, error)
    return None


def compile_library(name: str) -> Path:
    """Compile a library, unless it is there.

    Raises
    ------
    OSError
        When there is no C compiler, when it fails, with its command and output, or where nothing can be written.
    """
    library = library_file(name)
    if library.is_file():
        return library
    compiler = find_compiler()
    if compiler is None:
        raise FileNotFoundError(
            "no C compiler is found (cc, gcc, clang). Install one, for example by: apt-get install gcc; or name it in "
            "the environment variable CC."
        )
    with tempfile.TemporaryDirectory(dir=library.parent) as scratch:
        built = Path(scratch) / library.name
        files = [str(source) for source in library_sources(name) if source.suffix == ".c"]
        command = [*compiler, *FLAGS, *files, "-o", str(built), *([] if sys.platform == "win32" else ["-lm"])]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            raise OSError(
                f"this command failed with code {run.returncode}: {shlex.join(command)}\n{run.stdout}{run.stderr}"
            )
        for older in library.parent.glob(f"{name}-*{library.suffix}"):
            older.unlink()
        built.replace(library)
    return library
