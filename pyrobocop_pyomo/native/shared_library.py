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
import sys
from pathlib import Path

logger = logging.getLogger(__name__)

SWITCH_VARIABLE = "PYROBOCOP_NATIVE"
HOW_TO_COMPILE = (
    "with a C compiler, run pip install --force-reinstall --no-deps --no-binary pyrobocop_pyomo pyrobocop_pyomo, or in "
    "a clone python setup.py build_ext --inplace"
)
# No contraction of a product and a sum: the results are the same as NumPy's, on every processor.
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
