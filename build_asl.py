"""Build the ``ipopt`` executable and PyNumero's ASL library from packages of Debian or Ubuntu: ``python build_asl.py``.

No wheel carries an Ipopt with AMPL's solver library. But the pieces are at hand: casadi's wheel has the Ipopt
library and its headers, the distribution has the AMPL Solver Library (``libamplsolver-dev``) and, in its source
package ``coinor-ipopt``, the two C++ files of Ipopt's AMPL driver. Pyomo has the source of PyNumero's interface.
Compiling takes a few seconds; neither the distribution's own Ipopt nor the settings of apt are touched.

The library's reader is compiled anew, out of the distribution's source package ``libamplsolver``: as it is, some of its
derivatives are wrong (docs/developer/evaluation.md). Everything else of the library is linked as it is.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import ipopt_executable_version

PACKAGES = ("libamplsolver-dev", "g++")
ASL_HEADERS = Path("/usr/include/ampl-netlib-solvers")
ALTERNATIVE = "Elsewhere: conda install -c conda-forge ipopt pynumero_libraries"

_SOURCES = ("coinor-ipopt", "libamplsolver")
# The reader enters a new linear term into its hash table, which may then grow and put it into another chain; the line
# that is left out cuts that chain off. Two equal terms are then not recognised as one, and the second gets no adjoint.
_CUT_CHAIN = "asl->P.lalist = la;\n\t\tla->hnext = 0;\n"
_WHOLE_CHAIN = "asl->P.lalist = la;\n"
# What autotools would have found out; every compiler of this century has these headers.
_HEADER_MACROS = [
    f"-DHAVE_{name}" for name in ("CSTRING", "CSTDIO", "CSTDLIB", "CMATH", "CFLOAT", "CASSERT", "CSTDARG", "CSTDDEF")
]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--prefix", default=sys.prefix, help="install into PREFIX/bin and PREFIX/lib (%(default)s)")
    parser.add_argument("--force", action="store_true", help="build also what is there and works")
    options = parser.parse_args(arguments)
    try:
        build_asl(options.prefix, force=options.force)
    except SolverNotFoundError as error:
        sys.exit(f"build_asl: {error}")


def report(line: str) -> None:
    """Say which step comes next."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def build_asl(prefix: str | Path = sys.prefix, *, force: bool = False) -> tuple[Path, Path]:
    """Build what is missing, or does not run, and install it.

    Parameters
    ----------
    prefix : path
        Receives ``bin/ipopt`` and ``lib/libpynumero_ASL.so``; by default this Python environment, where both are
        found without further settings.
    force : bool
        Build also what is there and works.

    Returns
    -------
    executable, library : Path
        What was installed.

    Raises
    ------
    SolverNotFoundError
        When casadi, whose Ipopt is used, is not installed.
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
    if shutil.which("apt-get") is None:
        raise SolverNotFoundError(f"apt-get is not found: this builds on Debian and Ubuntu only. {ALTERNATIVE}")
    _require_packages()
    with tempfile.TemporaryDirectory(prefix="pyrobocop_build_") as name:
        folder = Path(name)
        _fetch_sources(folder)
        report("compiling the reader of .nl files")
        reader = _compiled_reader(folder)
        compile_with = ["g++", "-O2", "-w", f"-I{ASL_HEADERS}", str(reader)]
        if build_executable:
            driver = _unpacked(folder, "coinor-ipopt", "AmplTNLP.cpp")
            report("compiling the ipopt executable")
            _run([
                *compile_with, *_HEADER_MACROS, f"-I{casadi / 'include' / 'coin-or'}", f"-I{driver}",
                str(driver / "AmplTNLP.cpp"), str(driver / "ampl_ipopt.cpp"), "-o", str(folder / "ipopt"),
                f"-L{casadi}", "-l:libipopt.so.3", f"-Wl,-rpath,{casadi}", "-l:libamplsolver.a", "-ldl", "-lm",
            ])  # fmt: skip
            _install(folder / "ipopt", executable)
            version = ipopt_executable_version(str(executable))
            if version is None:
                raise SolverNotFoundError(f"'{executable}' was built, but '{executable} --version' does not run.")
            report(f"installed {executable}: {version}")
            report(
                "Pyomo's own SolverFactory('ipopt') finds it when its folder is on PATH, or after a call of "
                "pyrobocop_pyomo.ipopt.configure_ipopt_executable()"
            )
        if build_library:
            report("compiling PyNumero's library")
            source = Path(importlib.util.find_spec("pyomo.contrib.pynumero").origin).parent / "src"  # type: ignore[union-attr,arg-type]
            # One source file: Pyomo's own CMake project for it would only add CMake to what is needed. Its reader is
            # this one, also where another library of the process has a function of that name.
            _run([
                *compile_with, "-fPIC", "-shared", "-DBUILDING_PYNUMERO_ASL", f"-I{source}",
                str(source / "AmplInterface.cpp"), "-o", str(folder / library.name), "-Wl,-Bsymbolic-functions",
                "-lamplsolver", "-ldl",
            ])  # fmt: skip
            _install(folder / library.name, library)
            if not _loads(library):
                raise SolverNotFoundError(f"'{library}' was built, but cannot be loaded.")
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
        raise SolverNotFoundError(
            f"casadi in '{folder}' has no libipopt.so.3 or no headers in include/coin-or, which its wheels for "
            f"Linux have. Install the wheel: pip install --force-reinstall casadi. {ALTERNATIVE}"
        )
    return folder


def _require_packages() -> None:
    if (ASL_HEADERS / "asl.h").is_file() and shutil.which("g++"):
        return
    install = ["apt-get", "install", "--yes", *PACKAGES]
    prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
    if prefix and subprocess.run([*prefix, "true"], capture_output=True).returncode:
        raise SolverNotFoundError(
            f"the packages {' and '.join(PACKAGES)} are needed, and installing them needs root. "
            f"Run: sudo {shlex.join(install)}"
        )
    report(f"installing {' '.join(PACKAGES)}")
    try:
        _run([*prefix, *install])
    except SolverNotFoundError:
        _run([*prefix, "apt-get", "update"])  # a fresh container has no package lists yet
        _run([*prefix, *install])


def _fetch_sources(folder: Path) -> None:
    """Put the original archives of the distribution's source packages into a folder."""
    sources, state, cache = folder / "sources.list", folder / "state", folder / "cache"
    for path in (state / "lists" / "partial", cache / "archives" / "partial"):
        path.mkdir(parents=True)
    sources.write_text("\n".join(_source_lines()) + "\n", encoding="utf-8")
    # A list of sources of our own, in folders of our own: neither /etc/apt nor apt's caches notice.
    apt = ["apt-get", "-q", "-o", f"Dir::Etc::sourcelist={sources}", "-o", "Dir::Etc::sourceparts=-",
           "-o", f"Dir::State::lists={state / 'lists'}", "-o", f"Dir::Cache={cache}",
           "-o", "APT::Sandbox::User=root"]  # fmt: skip
    report(f"fetching the source packages {' and '.join(_SOURCES)}")
    _run([*apt, "update"])
    _run([*apt, "source", "--download-only", "--tar-only", *_SOURCES], cwd=folder)


def _unpacked(folder: Path, package: str, file: str) -> Path:
    """The folder of a file in the archive of a source package, after unpacking it."""
    archives = sorted(folder.glob(f"{package}_*.orig.tar.*"))
    if not archives:
        raise SolverNotFoundError(f"apt-get source {package} delivered no original archive. {ALTERNATIVE}")
    _run(["tar", "-xf", str(archives[0])], cwd=folder)
    place = next(folder.rglob(file), None)
    if place is None:
        raise SolverNotFoundError(f"'{archives[0].name}' holds no {file}. {ALTERNATIVE}")
    return place.parent


def _compiled_reader(folder: Path) -> Path:
    """The library's reader for second derivatives, without its fault, as an object file."""
    source = _unpacked(folder, "libamplsolver", "pfghread.c")
    text = source / "pfg_read.c"
    # A reader without that line is a newer one.
    text.write_text(text.read_text(encoding="latin-1").replace(_CUT_CHAIN, _WHOLE_CHAIN), encoding="latin-1")
    built = folder / "pfghread.o"
    _run(["gcc", "-O2", "-w", "-fPIC", "-c", f"-I{ASL_HEADERS}", str(source / "pfghread.c"), "-o", str(built)])
    return built


def _source_lines() -> list[str]:
    """deb-src lines for the mirrors that apt already uses, whatever format its own lists have."""
    listed = _run(
        ["apt-get", "indextargets", "--format", "$(REPO_URI) $(RELEASE) $(COMPONENT)", "Identifier: Packages"]
    )
    release = platform.freedesktop_os_release()
    distribution = "ubuntu" if "ubuntu" in release["ID"] + release.get("ID_LIKE", "") else "debian"
    codename = release.get("UBUNTU_CODENAME") or release.get("DEBIAN_CODENAME") or release.get("VERSION_CODENAME", "")
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


def _install(built: Path, target: Path) -> None:
    """Replace in one step: a program that uses the old file goes on undisturbed."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staged = target.with_name(target.name + ".new")
        shutil.copy2(built, staged)
        staged.replace(target)
    except OSError as error:
        raise SolverNotFoundError(f"cannot write '{target}': {error}. Choose another place with --prefix.") from error


def _run(command: Sequence[str], cwd: Path | None = None) -> str:
    """Output of a command; a failure is reported with everything that it said."""
    environment = {**os.environ, "LC_ALL": "C", "DEBIAN_FRONTEND": "noninteractive"}
    try:
        run = subprocess.run(
            command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
    except OSError as error:
        raise SolverNotFoundError(f"cannot run: {shlex.join(command)}\n{error}") from error
    if run.returncode != 0:
        raise SolverNotFoundError(
            f"this command failed with code {run.returncode}: {shlex.join(command)}\n{run.stdout}"
        )
    return run.stdout


if __name__ == "__main__":
    main()
