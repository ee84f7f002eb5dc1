"""C sources of this package as shared libraries: brought by a wheel, or compiled once and kept.

Loading a library runs what is in it. So a library is loaded only from a folder that nobody else can write to, and only
if its content has the hash that its name tells; its name also tells what it was compiled from and by what. A file of
an older version, of another compiler, half written or changed by others is thus never loaded, but replaced.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import logging
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from pyrobocop_pyomo.errors import BuildFailed

logger = logging.getLogger(__name__)

SWITCH_VARIABLE = "PYROBOCOP_NATIVE"
CACHE_VARIABLE = "PYROBOCOP_NATIVE_CACHE"

# No contraction of a product and a sum: the results are those of NumPy, on every processor.
FLAGS = (
    "-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared",
    "-fvisibility=hidden",
)  # fmt: skip
SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")

_COMPILERS = ("cc", "gcc", "clang")
_SECONDS_TO_COMPILE = 120.0
_SCRATCH = ".building-"
_lock = threading.Lock()


def native_allowed() -> bool:
    """Whether compiled parts are used at all: not where ``PYROBOCOP_NATIVE`` is ``off`` or ``0``."""
    return os.environ.get(SWITCH_VARIABLE, "").lower() not in ("off", "0", "no", "false")


def find_compiler() -> list[str] | None:
    """The command of a C compiler: ``$CC``, else ``cc``, ``gcc`` or ``clang``; None where there is none."""
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in [chosen] if chosen else [[name] for name in _COMPILERS]:
        found = shutil.which(command[0])
        if found is not None:
            return [found, *command[1:]]
    return None


def native_cache() -> Path:
    """The folder of compiled libraries: ``$PYROBOCOP_NATIVE_CACHE``, or a folder in the user's cache."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    caches = os.environ.get("XDG_CACHE_HOME")
    if caches and sys.platform != "darwin":
        return Path(caches) / "pyrobocop_pyomo"
    try:
        home = Path.home()
    except RuntimeError:  # a container whose user has neither HOME nor an entry among the system's users
        return Path(tempfile.gettempdir()) / f"pyrobocop_pyomo-{os.geteuid()}"
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "pyrobocop_pyomo"


def shared_library(
    name: str, sources: Sequence[Path], *, flags: Sequence[str] = FLAGS, force: bool = False
) -> Path | None:
    """The library compiled from these sources, or None where there is none and none can be made.

    Parameters
    ----------
    name : str
        Begins the name of the file.
    sources : sequence of paths
        C files, and the headers that they include.
    flags : sequence of str
        Of the compiler.
    force : bool
        Compile also where the library is there.

    Returns
    -------
    path or None
        None where ``PYROBOCOP_NATIVE=off``, where there is no compiler, where compiling failed, or where the library
        cannot be loaded, as from a folder that is mounted ``noexec``: the log says which.
    """
    if not native_allowed():
        return None
    try:
        with _lock:
            library = build_shared_library(name, sources, flags=flags, force=force)
            ctypes.CDLL(str(library))  # who is given its path, as Ipopt is, has no other library to go on with
            return library
    except BuildFailed as error:
        logger.info("without the compiled part '%s': %s", name, error)
    except OSError as error:
        logger.info("without the compiled part '%s', which cannot be loaded: %s", name, error)
    return None


def build_shared_library(
    name: str, sources: Sequence[Path], *, flags: Sequence[str] = FLAGS, force: bool = False, beside: bool = False
) -> Path:
    """The library compiled from these sources; `shared_library` without its silence.

    Parameters
    ----------
    name, sources, flags, force
        See `shared_library`.
    beside : bool
        Put it beside its first source, where a wheel brings it, and not into the cache.

    Raises
    ------
    BuildFailed
        When the sources are no files; when there is no compiler; when it fails, with its command and output; when the
        folder of compiled libraries cannot be written to, or others can write to it.
    """
    if not sources or not all(source.is_file() for source in sources):
        raise BuildFailed(
            f"the C sources of '{name}' are no files here, as where the package is imported from a zip archive. "
            "Install the package, for example by: python -m pip install pyrobocop_pyomo"
        )
    texts = hashlib.sha256(repr((name, *flags, sys.platform, platform.machine())).encode())
    for source in sources:
        texts.update(source.read_bytes())
    brought = sources[0].with_name(f"{name}-{texts.hexdigest()[:16]}{SUFFIX}")
    if brought.is_file() and not force:
        return brought
    compiler = find_compiler()
    if compiler is None:
        raise BuildFailed(
            "no C compiler is found (cc, gcc, clang). Install one, for example by: apt-get install gcc; or name it in "
            "the environment variable CC."
        )
    if beside:
        return _compiled(name, sources, [*compiler, *flags], brought.parent, lambda _: brought.name)
    # The compiler's file stands for its version: asking it would take as long as many a solve.
    file = Path(compiler[0]).resolve().stat()
    texts.update(repr((compiler, file.st_size, file.st_mtime_ns)).encode())
    key = texts.hexdigest()[:16]
    folder = _private_folder(native_cache())
    if not force:
        for kept in sorted(folder.glob(f"{name}-{key}-*{SUFFIX}")):
            if _is_genuine(kept):
                return kept
    return _compiled(name, sources, [*compiler, *flags], folder, lambda built: f"{name}-{key}-{_digest(built)}{SUFFIX}")


def _private_folder(folder: Path) -> Path:
    """The folder, made where it is missing.

    Raises
    ------
    BuildFailed
        When it cannot be made, belongs to somebody else, or others may write to it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise BuildFailed(f"cannot make the folder '{folder}': {error}. Name another in {CACHE_VARIABLE}.") from error
    if not stat.S_ISDIR(found.st_mode) or not _only_ours(found):
        raise BuildFailed(
            f"others may write to '{folder}', or it is not a folder of this user: nothing is loaded from there. "
            f"Run: chmod go-w '{folder}', or name another folder in {CACHE_VARIABLE}."
        )
    return folder


def _only_ours(found: os.stat_result) -> bool:
    if sys.platform == "win32":
        return True  # a user's own folders are private there, and modes do not tell
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _is_genuine(library: Path) -> bool:
    """Whether a kept library is an ordinary file of this user whose content is what its name tells."""
    try:
        found = library.lstat()
        if not stat.S_ISREG(found.st_mode) or not _only_ours(found):
            return False
        return library.stem.rpartition("-")[2] == _digest(library)
    except OSError:
        return False


def _digest(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()[:32]


def _compiled(
    name: str, sources: Sequence[Path], compiler: Sequence[str], folder: Path, name_of: Callable[[Path], str]
) -> Path:
    """Compile into a folder, under a name that may depend on what came out."""
    files = [str(source) for source in sources if source.suffix == ".c"]
    try:
        _remove_abandoned(folder)
        with tempfile.TemporaryDirectory(prefix=_SCRATCH, dir=folder) as scratch:
            built = Path(scratch) / f"{name}{SUFFIX}"
            command = [*compiler, *files, "-o", str(built), *([] if sys.platform == "win32" else ["-lm"])]
            logger.info("compiling '%s', once on this machine: %s", name, shlex.join(command))
            _run_compiler(command, built)
            built.chmod(0o755)
            # Whoever has loaded an older file of that name keeps it: the new one takes the name, not the place.
            kept = folder / name_of(built)
            built.replace(kept)
            return kept
    except OSError as error:
        raise BuildFailed(f"cannot write to '{folder}': {error}. Name another folder in {CACHE_VARIABLE}.") from error


def _remove_abandoned(folder: Path) -> None:
    """Remove the scratch folders of processes that were killed: none that still compiles is that old."""
    for scratch in folder.glob(f"{_SCRATCH}*"):
        with contextlib.suppress(OSError):  # another process may remove it too
            if time.time() - scratch.stat().st_mtime > 2 * _SECONDS_TO_COMPILE:
                shutil.rmtree(scratch)


def _run_compiler(command: Sequence[str], built: Path) -> None:
    try:
        run = subprocess.run(
            command, capture_output=True, text=True, timeout=_SECONDS_TO_COMPILE, check=False,
            # A compiler that is killed leaves its temporary files: they vanish with the scratch folder.
            env={**os.environ, "LC_ALL": "C", "TMPDIR": str(built.parent)},
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BuildFailed(f"cannot run: {shlex.join(command)}\n{error}") from error
    if run.returncode != 0 or not built.is_file():
        raise BuildFailed(
            f"this command failed with code {run.returncode}: {shlex.join(command)}\n{run.stdout}{run.stderr}"
        )
