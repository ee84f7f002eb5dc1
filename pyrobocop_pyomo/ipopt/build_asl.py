"""Build the ``ipopt`` executable and PyNumero's ASL library from packages of Debian or Ubuntu.

No wheel carries an Ipopt with AMPL's solver library. But the pieces are at hand: casadi's wheel has the Ipopt
library and its headers, the distribution has the AMPL Solver Library (``libamplsolver-dev``) and, in its source
package ``coinor-ipopt``, the two C++ files of Ipopt's AMPL driver. Pyomo has the source of PyNumero's interface.
Compiling takes a few seconds; neither the distribution's own Ipopt nor the settings of apt are touched.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import logging
import os
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from pyrobocop_pyomo.errors import BuildFailed, SolverNotFoundError

from .ipopt_executable import ipopt_executable_version

logger = logging.getLogger(__name__)

PACKAGES = ("libamplsolver-dev", "g++")
ASL_HEADERS = Path("/usr/include/ampl-netlib-solvers")
ALTERNATIVE = "Elsewhere: conda install -c conda-forge ipopt pynumero_libraries"

# What autotools would have found out; every compiler of this century has these headers.
_HEADER_MACROS = [
    f"-DHAVE_{name}" for name in ("CSTRING", "CSTDIO", "CSTDLIB", "CMATH", "CFLOAT", "CASSERT", "CSTDARG", "CSTDDEF")
]


def build_asl(
    prefix: str | Path = sys.prefix, *, force: bool = False, report: Callable[[str], None] = logger.info
) -> tuple[Path, Path]:
    """Build what is missing and install it.

    Parameters
    ----------
    prefix : path
        Receives ``bin/ipopt`` and ``lib/libpynumero_ASL.so``; by default this Python environment, where both are
        found without further settings.
    force : bool
        Build also what is there and works.
    report : callable
        Receives one line per step.

    Returns
    -------
    executable, library : Path
        What was installed.

    Raises
    ------
    SolverNotFoundError
        When casadi, whose Ipopt is used, is not installed.
    BuildFailed
        When a step fails, with its command and output; when packages are missing and may not be installed.
    """
    executable = Path(prefix) / "bin" / "ipopt"
    library = Path(prefix) / "lib" / "libpynumero_ASL.so"
    build_executable = force or ipopt_executable_version(str(executable)) is None
    build_library = force or not _loads(library)
    if not build_executable and not build_library:
        report(f"already built: {executable}, {library}")
        return executable, library
    casadi = _casadi_folder()
    _require_packages(report)
    with tempfile.TemporaryDirectory(prefix="pyrobocop_build_") as folder:
        if build_executable:
            driver = _fetch_driver(Path(folder), report)
            report("compiling the ipopt executable")
            built = Path(folder) / "ipopt"
            _run([
                "g++", "-O2", "-w", *_HEADER_MACROS, f"-I{casadi / 'include' / 'coin-or'}", f"-I{driver}",
                f"-I{ASL_HEADERS}", str(driver / "AmplTNLP.cpp"), str(driver / "ampl_ipopt.cpp"), "-o", str(built),
                f"-L{casadi}", "-l:libipopt.so.3", f"-Wl,-rpath,{casadi}", "-l:libamplsolver.a", "-ldl", "-lm",
            ])  # fmt: skip
            _install(built, executable)
            version = ipopt_executable_version(str(executable))
            if version is None:
                raise BuildFailed(f"'{executable}' was built, but '{executable} --version' does not run.")
            report(f"installed {executable}: {version}")
            report(
                "Pyomo's own SolverFactory('ipopt') finds it when its folder is on PATH, or after a call of "
                "pyrobocop_pyomo.ipopt.configure_ipopt_executable()"
            )
        if build_library:
            report("compiling PyNumero's library")
            built = Path(folder) / "libpynumero_ASL.so"
            source = _pynumero_source()
            # One source file: Pyomo's own CMake project for it would only add CMake to what is needed.
            _run([
                "g++", "-O2", "-w", "-fPIC", "-shared", "-DBUILDING_PYNUMERO_ASL", f"-I{ASL_HEADERS}",
                f"-I{source}", str(source / "AmplInterface.cpp"), "-o", str(built), "-lamplsolver", "-ldl",
            ])  # fmt: skip
            _install(built, library)
            if not _loads(library):
                raise BuildFailed(f"'{library}' was built, but cannot be loaded.")
            report(f"installed {library}")
    return executable, library


def _loads(library: Path) -> bool:
    if not library.is_file():
        return False
    try:
        ctypes.CDLL(str(library))
    except OSError:
        return False
    return True


def _casadi_folder() -> Path:
    spec = importlib.util.find_spec("casadi")
    if spec is None or spec.origin is None:
        raise SolverNotFoundError(
            "casadi is not installed; the executable is linked with the Ipopt library inside it. "
            "Run: pip install 'pyrobocop_pyomo[ipopt]'"
        )
    folder = Path(spec.origin).parent
    if not (folder / "libipopt.so.3").is_file() or not (folder / "include" / "coin-or").is_dir():
        raise BuildFailed(
            f"casadi in '{folder}' has no libipopt.so.3 or no headers in include/coin-or, which its wheels for "
            f"Linux have. Install the wheel: pip install --force-reinstall casadi. {ALTERNATIVE}"
        )
    return folder


def _pynumero_source() -> Path:
    spec = importlib.util.find_spec("pyomo.contrib.pynumero")
    if spec is None or spec.origin is None or not (source := Path(spec.origin).parent / "src").is_dir():
        raise BuildFailed("Pyomo is installed without PyNumero's source. Reinstall it: pip install pyomo")
    return source


def _require_packages(report: Callable[[str], None]) -> None:
    if (ASL_HEADERS / "asl.h").is_file() and shutil.which("g++"):
        return
    install = ["apt-get", "install", "--yes", *PACKAGES]
    if shutil.which("apt-get") is None:
        raise BuildFailed(f"apt-get is not found: this builds on Debian and Ubuntu only. {ALTERNATIVE}")
    prefix = _privilege()
    if prefix is None:
        raise BuildFailed(
            f"the packages {' and '.join(PACKAGES)} are needed, and installing them needs root. "
            f"Run: sudo {shlex.join(install)}"
        )
    report(f"installing {' '.join(PACKAGES)}")
    try:
        _run([*prefix, *install])
    except BuildFailed:
        _run([*prefix, "apt-get", "update"])  # a fresh container has no package lists yet
        _run([*prefix, *install])


def _privilege() -> list[str] | None:
    """What to put before a command that needs root; None when there is no way without a password."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], capture_output=True).returncode == 0:
        return ["sudo", "-n"]
    return None


def _fetch_driver(folder: Path, report: Callable[[str], None]) -> Path:
    """Folder with the sources of Ipopt's AMPL driver, out of the distribution's source package."""
    if shutil.which("apt-get") is None:
        raise BuildFailed(f"apt-get is not found: this builds on Debian and Ubuntu only. {ALTERNATIVE}")
    sources, state, cache = folder / "driver.list", folder / "state", folder / "cache"
    for path in (state / "lists" / "partial", cache / "archives" / "partial"):
        path.mkdir(parents=True)
    sources.write_text("\n".join(_source_lines()) + "\n", encoding="utf-8")
    # A list of sources of our own, in folders of our own: neither /etc/apt nor apt's caches notice.
    apt = ["apt-get", "-q", "-o", f"Dir::Etc::sourcelist={sources}", "-o", "Dir::Etc::sourceparts=-",
           "-o", f"Dir::State::lists={state / 'lists'}", "-o", f"Dir::Cache={cache}",
           "-o", "APT::Sandbox::User=root"]  # fmt: skip
    report("fetching the source of Ipopt's AMPL driver (package coinor-ipopt)")
    _run([*apt, "update"])
    _run([*apt, "source", "--download-only", "--tar-only", "coinor-ipopt"], cwd=folder)
    archives = sorted(folder.glob("coinor-ipopt_*.orig.tar.*"))
    if not archives:
        raise BuildFailed(f"apt-get source coinor-ipopt delivered no original archive. {ALTERNATIVE}")
    with tarfile.open(archives[0]) as archive:
        wanted = [member for member in archive.getmembers() if "/src/Apps/AmplSolver/" in member.name]
        # Safe extraction filters exist from the patch releases of 3.10 and 3.11 on, hence the check.
        if hasattr(tarfile, "data_filter"):
            archive.extractall(folder, members=wanted, filter="data")
        else:
            archive.extractall(folder, members=wanted)
    drivers = list(folder.rglob("AmplTNLP.cpp"))
    if not drivers:
        raise BuildFailed(f"'{archives[0].name}' holds no src/Apps/AmplSolver/AmplTNLP.cpp. {ALTERNATIVE}")
    return drivers[0].parent


def _source_lines() -> list[str]:
    """deb-src lines for the mirrors that apt already uses, whatever format its own lists have."""
    listed = _run(
        ["apt-get", "indextargets", "--format", "$(REPO_URI) $(RELEASE) $(COMPONENT)", "Identifier: Packages"]
    )
    release = _os_release()
    codename, distribution = release.get("VERSION_CODENAME", ""), release.get("ID", "")
    if distribution not in ("debian", "ubuntu"):
        distribution = "ubuntu" if "ubuntu" in release.get("ID_LIKE", "") else "debian"
        codename = release.get("UBUNTU_CODENAME") or release.get("DEBIAN_CODENAME") or codename
    component = "universe" if distribution == "ubuntu" else "main"
    keyring = Path(f"/usr/share/keyrings/{distribution}-archive-keyring.gpg")
    signed = f"[signed-by={keyring}] " if keyring.is_file() else ""
    mirrors = sorted({
        uri for uri, suite, part in (line.split() for line in listed.splitlines() if len(line.split()) == 3)
        if suite == codename and part == component
    })  # fmt: skip
    if not mirrors:
        default = "http://archive.ubuntu.com/ubuntu" if distribution == "ubuntu" else "http://deb.debian.org/debian"
        mirrors = [default]
    return [f"deb-src {signed}{mirror} {codename} {component}" for mirror in mirrors]


def _os_release() -> dict[str, str]:
    with contextlib.suppress(OSError):
        lines = Path("/etc/os-release").read_text(encoding="utf-8").splitlines()
        return {key: value.strip("\"'") for key, _, value in (line.partition("=") for line in lines)}
    return {}


def _install(built: Path, target: Path) -> None:
    """Replace in one step: a program that uses the old file goes on undisturbed."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staged = target.with_name(target.name + ".new")
        shutil.copy2(built, staged)
        staged.replace(target)
    except OSError as error:
        raise BuildFailed(f"cannot write '{target}': {error}. Choose another place with --prefix.") from error


def _run(command: Sequence[str], cwd: Path | None = None) -> str:
    """Output of a command; a failure is reported with everything that it said."""
    environment = {**os.environ, "LC_ALL": "C", "DEBIAN_FRONTEND": "noninteractive"}
    try:
        run = subprocess.run(
            command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
    except OSError as error:
        raise BuildFailed(f"cannot run: {shlex.join(command)}\n{error}") from error
    if run.returncode != 0:
        raise BuildFailed(f"this command failed with code {run.returncode}: {shlex.join(command)}\n{run.stdout}")
    return run.stdout
