"""Where Ipopt is looked for, in which order, and what is said when there is none."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pyomo.environ as pyo
import pytest
from harness.small_problems import hock_schittkowski_71
from pyomo.contrib.pynumero.asl import AmplInterface
from pyomo.contrib.solver.common.factory import SolverFactory as NewSolverFactory

import build_asl
import pyrobocop_pyomo.__main__ as command_line
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt import backends, in_process
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.programs import asl_program, compiled_model

ENVIRONMENT = ("PYROBOCOP_IPOPT_LIBRARY", "PYROBOCOP_IPOPT_EXECUTABLE")


class Machine:
    """A machine without any Ipopt, to which a test adds files."""

    def __init__(self, folder: Path) -> None:
        self.prefix = folder / "prefix"
        self.home = folder / "home"
        self.found_by_pyomo: str | None = None

    def add(self, path: Path) -> str:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/sh\necho 'Ipopt 3.99.1 (a fake)'\n")
        path.chmod(0o755)
        return str(path)

    def executable(self, name: str) -> Machine:
        """Stands for pyomo.common.Executable."""
        return self

    def path(self) -> str | None:
        return self.found_by_pyomo

    def set_path(self, path: str) -> None:
        self.found_by_pyomo = path


@pytest.fixture
def machine(monkeypatch, tmp_path):
    for variable in ENVIRONMENT:
        monkeypatch.delenv(variable, raising=False)
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "casadi" else find_spec(name, *rest)
    )
    machine = Machine(tmp_path)
    monkeypatch.setattr(backends.ctypes.util, "find_library", lambda name: None)
    monkeypatch.setattr(sys, "prefix", str(machine.prefix))
    monkeypatch.setenv("HOME", str(machine.home))
    monkeypatch.setattr(AmplInterface, "libname", None)
    monkeypatch.setattr(backends, "Executable", machine.executable)
    return machine


def test_libraries_are_looked_for_in_order(machine, monkeypatch, tmp_path):
    assert backends.find_ipopt_library() is None
    monkeypatch.setattr(backends.ctypes.util, "find_library", lambda name: f"lib{name}.so.3")
    assert backends.find_ipopt_library() == "libipopt.so.3"
    name = backends._NAMES[0]
    in_prefix = machine.add(machine.prefix / "lib" / name)
    assert backends.find_ipopt_library() == in_prefix
    in_casadi = machine.add(tmp_path / "casadi" / name)
    spec = importlib.util.spec_from_file_location("casadi", tmp_path / "casadi" / "__init__.py")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: spec)
    assert backends.find_ipopt_library() == in_casadi
    chosen = machine.add(tmp_path / "chosen.so")
    monkeypatch.setenv("PYROBOCOP_IPOPT_LIBRARY", chosen)
    assert backends.find_ipopt_library() == chosen
    monkeypatch.setenv("PYROBOCOP_IPOPT_LIBRARY", chosen + ".gone")
    with pytest.raises(SolverNotFoundError, match=r"PYROBOCOP_IPOPT_LIBRARY is '.*gone', but there is no such file"):
        backends.find_ipopt_library()


def test_executables_are_looked_for_in_order(machine, monkeypatch, tmp_path):
    find = backends.find_ipopt_executable
    assert find() is None
    of_idaes = machine.add(machine.home / ".idaes" / "bin" / "ipopt")
    assert find() == of_idaes
    in_prefix = machine.add(machine.prefix / "bin" / "ipopt")
    assert find() == in_prefix
    machine.found_by_pyomo = machine.add(tmp_path / "path" / "ipopt")
    assert find() == machine.found_by_pyomo
    chosen = machine.add(tmp_path / "chosen")
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", chosen)
    assert find() == chosen
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", str(tmp_path))
    with pytest.raises(SolverNotFoundError, match="which is no executable file"):
        find()


def test_pyomo_keeps_the_executable_that_it_has(machine, monkeypatch, tmp_path):
    configure = backends.configure_ipopt_executable
    assert configure() is None
    in_prefix = machine.add(machine.prefix / "bin" / "ipopt")
    assert configure() == machine.found_by_pyomo == in_prefix
    machine.found_by_pyomo = own = machine.add(tmp_path / "path" / "ipopt")
    assert configure() == machine.found_by_pyomo == own
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", in_prefix)
    assert configure() == machine.found_by_pyomo == in_prefix
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", "/nowhere/ipopt")
    with pytest.raises(SolverNotFoundError, match="/nowhere/ipopt"):
        configure()
    assert machine.found_by_pyomo == in_prefix


def test_versions_are_asked_for_with_care(machine, tmp_path):
    version = backends.ipopt_executable_version
    assert version(machine.add(tmp_path / "ipopt")) == "Ipopt 3.99.1 (a fake)"
    assert version(str(tmp_path / "nothing")) is None
    other = tmp_path / "other"
    other.write_text("#!/bin/sh\necho 'Bonmin 1.8'\n")
    other.chmod(0o755)
    assert version(str(other)) is None


def test_a_file_that_is_no_library_is_named(tmp_path):
    path = tmp_path / "libipopt.so.3"
    path.write_text("text")
    with pytest.raises(SolverNotFoundError, match=r"libipopt\.so\.3' cannot be used as Ipopt's library"):
        backends.load_ipopt_library(str(path))


def test_a_library_that_cannot_tell_its_version_is_not_called_older_than_it_is():
    """Ipopt 3.14.11 in CasADi 3.7.0 cannot."""
    assert backends._version(object()) is None
    library = backends.IpoptLibrary("libipopt.so.3", None, object())
    assert str(library) == "Ipopt older than 3.14.19 (libipopt.so.3)"


def test_without_any_ipopt_one_message_lists_the_remedies(machine):
    assert backends.available_backends() == []
    with pytest.raises(SolverNotFoundError) as caught:
        backends.best_backend()
    for remedy in (
        "pip install 'pyrobocop_pyomo[ipopt]'", "conda install -c conda-forge ipopt",
        "python build_asl.py", "PYROBOCOP_IPOPT_EXECUTABLE",
    ):  # fmt: skip
        assert remedy in str(caught.value)


@pytest.mark.parametrize("name", ["pyrobocop.ipopt", "pyrobocop.mpcc"])
def test_without_any_ipopt_a_solver_says_so_and_does_not_fail_before(machine, name):
    solver = pyo.SolverFactory(name)
    assert not solver.available(exception_flag=False)
    assert not NewSolverFactory(name).available()
    assert in_process.InProcessIpopt().version() is None
    with pytest.raises(SolverNotFoundError, match=r"pip install 'pyrobocop_pyomo\[ipopt\]'"):
        solver.solve(hock_schittkowski_71()[0])


@pytest.mark.parametrize("derivatives", [None, "asl", "vectorised"])
def test_missing_derivatives_are_named_with_remedies(machine, derivatives):
    with pytest.raises(SolverNotFoundError, match=r"build_asl|pip install"):
        compiled_model.CompiledModel(hock_schittkowski_71()[0], derivatives)


def test_backends_are_ordered_by_preference(machine, monkeypatch):
    machine.add(machine.prefix / "bin" / "ipopt")
    assert backends.available_backends() == [Backend.EXECUTABLE]
    machine.add(machine.prefix / "lib" / backends._NAMES[0])
    assert backends.available_backends() == [Backend.EXECUTABLE]  # a library alone has no derivatives
    monkeypatch.setattr(backends, "casadi_available", lambda: True)
    assert backends.available_backends() == [Backend.IN_PROCESS_VECTORISED, Backend.EXECUTABLE]
    machine.add(machine.prefix / "lib" / "libpynumero_ASL.so")
    assert backends.available_backends() == list(Backend)
    assert backends.best_backend() is Backend.IN_PROCESS_CASADI is Backend.IN_PROCESS_VECTORISED
    assert [backend.derivatives for backend in Backend] == ["vectorised", "asl", None]


def test_finding_asl_does_not_touch_pyomo(machine):
    assert asl_program.find_asl_library() is None
    path = machine.add(machine.prefix / "lib" / "libpynumero_ASL.so")
    assert asl_program.find_asl_library() == path
    assert AmplInterface.libname is None


@pytest.mark.heavy
def test_importing_is_quick_and_quiet_without_any_extra():
    """In a fresh process, with every optional package hidden."""
    program = """
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("casadi", "highspy", "matplotlib", "pandas"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hidden())
import pyomo.environ
before = set(sys.modules)
import pyrobocop_pyomo.ipopt.in_process, pyrobocop_pyomo.ipopt.backends
assert "scipy.sparse" not in set(sys.modules) - before
assert pyomo.environ.SolverFactory("pyrobocop.ipopt") is not None
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def test_the_doctor_reports_every_backend_and_remedy(machine, capsys):
    assert command_line.main([]) == 1
    text = capsys.readouterr().out
    assert text.count(": not found") == 3
    assert "no Ipopt is found on this machine" in text


@pytest.mark.executable
@pytest.mark.asl
@pytest.mark.casadi
@pytest.mark.heavy
def test_the_doctor_solves_on_every_backend(capsys):
    assert command_line.main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert text.count(": works") == 3
    assert text.count("objective 17.0140") == 3


@pytest.mark.executable
def test_the_doctor_survives_a_broken_executable(machine):
    broken = machine.prefix / "bin" / "ipopt"
    machine.add(broken)
    broken.write_text("#!/bin/sh\nexit 3\n")
    text, works = command_line.report()
    assert not works
    assert f"the ipopt executable: fails\n  found       {broken}\n" in text


@pytest.mark.casadi
def test_building_without_rights_prints_the_command(monkeypatch, tmp_path):
    monkeypatch.setattr(build_asl, "ASL_HEADERS", tmp_path / "none")
    monkeypatch.setattr(build_asl.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(build_asl.subprocess, "run", lambda *_, **__: subprocess.CompletedProcess([], 1, "", ""))
    monkeypatch.setattr(build_asl.shutil, "which", lambda name: f"/usr/bin/{name}")
    with pytest.raises(SolverNotFoundError, match="Run: sudo apt-get install --yes libamplsolver-dev"):
        build_asl.build_asl(tmp_path)


@pytest.mark.slow
@pytest.mark.casadi
def test_both_are_built_from_packages(tmp_path):
    if not (build_asl.ASL_HEADERS / "asl.h").is_file() or not build_asl.shutil.which("g++"):
        pytest.skip("needs libamplsolver-dev and g++")
    executable, library = build_asl.build_asl(tmp_path)
    assert backends.ipopt_executable_version(str(executable)).startswith("Ipopt 3.")
    assert library.is_file()
    assert os.access(executable, os.X_OK)
