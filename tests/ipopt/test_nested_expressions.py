"""Derivatives of models whose Expressions use each other, through every door to the AMPL Solver Library."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.contrib.pynumero.asl import AmplInterface
from pyomo.contrib.pynumero.interfaces.pyomo_nlp import PyomoNLP

from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt import asl_derivatives, build_asl, doctor
from pyrobocop_pyomo.ipopt.asl_derivatives import EXPANDED, NESTED, DerivativeCheck, differ_from_differences
from pyrobocop_pyomo.ipopt.ipopt_executable import find_ipopt_executable
from pyrobocop_pyomo.ipopt.nested_models import LARGEST_VALUE, nested_model
from pyrobocop_pyomo.programs.asl_program import find_asl_library
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

# The first are those that the library of 2019 gets wrong.
SOME = [*NESTED, *EXPANDED, *range(20)]
MANY = range(3000, 4000)
BACKENDS = [
    pytest.param("asl", marks=pytest.mark.asl),
    pytest.param("casadi", marks=pytest.mark.casadi),
    pytest.param("vectorised", marks=pytest.mark.casadi),
]


class PyomosProgram:
    """PyNumero's own `PyomoNLP`, on the file that Pyomo's own writer makes."""

    def __init__(self, model):
        if not AmplInterface.available():
            AmplInterface.libname = find_asl_library()
        self._nlp = PyomoNLP(model)
        self.n, self.m = self._nlp.n_primals(), self._nlp.n_constraints()
        jacobian, hessian = self._nlp.evaluate_jacobian(), self._nlp.evaluate_hessian_lag()
        self.jacobian_structure = (jacobian.row, jacobian.col)
        self._lower = hessian.row >= hessian.col
        self.hessian_structure = (hessian.row[self._lower], hessian.col[self._lower])
        self.x_start = self._nlp.init_primals()

    def objective(self, x):
        self._nlp.set_primals(x)
        return self._nlp.evaluate_objective()

    def constraints(self, x):
        self._nlp.set_primals(x)
        return self._nlp.evaluate_constraints().copy()

    def gradient(self, x):
        self.objective(x)
        return self._nlp.evaluate_grad_objective().copy()

    def jacobian(self, x):
        self.constraints(x)
        return self._nlp.evaluate_jacobian().data.copy()

    def hessian(self, x, objective_factor, multipliers):
        self.gradient(x), self.jacobian(x)  # the library takes second derivatives where it was last
        self._nlp.set_obj_factor(objective_factor)
        self._nlp.set_duals(multipliers)
        return self._nlp.evaluate_hessian_lag().data[self._lower]


def _wrong_by_pyomo(seeds):
    programs = ((seed, PyomosProgram(nested_model(seed))) for seed in seeds)
    return {seed: wrong for seed, program in programs if (wrong := differ_from_differences(program, program.x_start))}


def _wrong_by_backend(seeds, derivatives):
    compiled = ((seed, CompiledModel(nested_model(seed), derivatives)) for seed in seeds)
    return {
        seed: wrong for seed, made in compiled if (wrong := differ_from_differences(made.nlp, made.current_point()))
    }


def _wrong_by_executable(seeds, folder, steps=(1e-8, 1e-7, 1e-6)):
    """Ipopt's own derivative test, asked for through Pyomo's solver.

    Its differences are one-sided: with one step too coarse where curvature is large, with another too much rounding
    where derivatives are small. What is wrong is so with each.
    """
    solver = pyo.SolverFactory("ipopt", executable=find_ipopt_executable())
    # OF_ stands for what the driver reads from a file of options.
    solver.options.update({
        "OF_derivative_test": "second-order", "OF_point_perturbation_radius": 0, "max_iter": 0,
        "OF_derivative_test_perturbation": steps[0],
    })  # fmt: skip
    wrong = []
    for seed in seeds:
        log = folder / "ipopt.log"
        solver.solve(nested_model(seed), logfile=str(log), load_solutions=False)
        if "No errors detected by derivative checker" not in log.read_text(encoding="utf-8"):
            wrong.append(seed)
    return _wrong_by_executable(wrong, folder, steps[1:]) if wrong and steps[1:] else wrong


def test_nested_models_are_what_they_promise():
    model, again, written_out = nested_model(15), nested_model(15), nested_model(15, named=False)
    assert str(model.objective.expr) == str(again.objective.expr) != str(nested_model(16).objective.expr)
    assert pyo.value(model.objective) == pyo.value(written_out.objective)
    assert all(abs(pyo.value(row.body)) < LARGEST_VALUE for row in model.rows.values())
    assert any(
        part is other for e in model.e.values() for part in e.expr.args for other in model.e.values()
        if e.expr.is_expression_type()
    )  # fmt: skip


@pytest.mark.asl
def test_derivatives_of_pyomos_program_are_right():
    assert _wrong_by_pyomo(SOME) == {}


@pytest.mark.heavy
@pytest.mark.parametrize("derivatives", BACKENDS)
def test_derivatives_of_this_package_are_right(derivatives):
    assert _wrong_by_backend(SOME, derivatives) == {}


@pytest.mark.executable
@pytest.mark.heavy
@pytest.mark.filterwarnings("ignore")
def test_derivatives_of_the_executable_are_right(tmp_path):
    assert _wrong_by_executable(SOME, tmp_path) == []


@pytest.mark.slow
@pytest.mark.asl
@pytest.mark.casadi
@pytest.mark.executable
def test_derivatives_of_a_thousand_models_are_right(tmp_path):
    logging.getLogger("pyomo").setLevel(logging.ERROR)
    assert _wrong_by_pyomo(MANY) == {}
    for derivatives in ("asl", "casadi", "vectorised"):
        assert _wrong_by_backend(MANY, derivatives) == {}
    assert _wrong_by_executable(MANY, tmp_path) == []


@pytest.mark.executable
def test_a_gradient_that_no_expression_touches_is_right(tmp_path):
    """The smallest case: the objective holds no Expression, and lost its gradient because of those of a row."""
    m = pyo.ConcreteModel()
    m.x0, m.x1 = pyo.Var(initialize=0.7), pyo.Var(initialize=1.1)
    m.e0 = pyo.Expression(expr=m.x0 * m.x1)
    m.e1 = pyo.Expression(expr=pyo.exp(m.x0) + m.e0)
    m.row = pyo.Constraint(expr=m.e1 - m.e1**2 + m.x0 == 1)
    m.cost = pyo.Objective(expr=m.x0**2)
    m.write(str(tmp_path / "m.nl"))
    assert "No errors detected" in _driven(tmp_path, derivative_test="second-order", point_perturbation_radius=0)


def _driven(folder, **options):
    """What the executable says of the file m.nl."""
    (folder / "ipopt.opt").write_text("".join(f"{name} {value}\n" for name, value in options.items()))
    run = subprocess.run([find_ipopt_executable(), "m.nl"], cwd=folder, capture_output=True, text=True, check=False)
    return run.stdout + run.stderr


@pytest.mark.executable
def test_definitions_that_cannot_be_written_out_are_refused(tmp_path):
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0.5), pyo.Var(initialize=0.5)
    m.e = pyo.Expression(range(40))
    m.e[0] = pyo.sin(m.x) * m.y
    for k in range(1, 40):
        m.e[k] = m.e[k - 1] * pyo.cos(m.e[k - 1])
    m.row = pyo.Constraint(expr=m.e[39] + m.e[38] <= 1)
    m.cost = pyo.Objective(expr=m.x**2 + m.y)
    m.write(str(tmp_path / "m.nl"))
    assert "written out they are longer than 128 MB" in _driven(tmp_path)
    text = (tmp_path / "m.nl").read_text()
    first, second = text.index("\nV2 "), text.index("\nV3 ")
    third = text.index("\nV4 ")
    (tmp_path / "m.nl").write_text(text[:first] + text[second:third] + text[first:second] + text[third:])
    assert "uses a defined variable that it has not defined before: v2" in _driven(tmp_path)
    (tmp_path / "m.nl").write_text(text.replace("\nV2 0", "\nV2", 1).replace("\nV2 0", "\nV2", 1))
    assert "cannot be written out" in _driven(tmp_path)


def _fake(folder, text):
    path = folder / "ipopt"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.skipif(sys.platform == "win32", reason="the executable of this test is a shell script")
def test_what_executables_say_of_their_derivatives_is_understood(tmp_path):
    check = asl_derivatives.check_executable
    assert check(_fake(tmp_path, "echo 'No errors detected by derivative checker.'")).right
    found = check(_fake(tmp_path, "echo 'Derivative checker detected 3 error(s).'"))
    assert found.wrong == (*NESTED, *EXPANDED)
    assert str(found) == "WRONG in 11 of 11 small models with nested Expressions"
    assert str(check(_fake(tmp_path, "echo 'no licence'; exit 3"))).endswith("does not run: no licence")
    assert "does not run" in check(str(tmp_path / "nothing")).trouble


@pytest.mark.heavy
def test_a_library_that_cannot_be_loaded_is_no_right_one(tmp_path):
    path = tmp_path / "libpynumero_ASL.so"
    path.write_text("text")
    found = asl_derivatives.check_library(str(path))
    assert not found.right
    assert "ended with code" in found.trouble


@pytest.mark.asl
@pytest.mark.heavy
def test_the_library_of_this_machine_is_right():
    assert asl_derivatives.check_library(find_asl_library()) == DerivativeCheck(())


@pytest.mark.skipif(sys.platform == "win32", reason="the executable of this test is a shell script")
def test_what_differentiates_wrongly_is_built_again(monkeypatch, tmp_path):
    wrong = DerivativeCheck((15,))
    (tmp_path / "bin").mkdir()
    executable = _fake(tmp_path / "bin", "echo 'Ipopt 3.99.1 (a fake)'")
    assert os.access(executable, os.X_OK)
    monkeypatch.setattr(build_asl, "_loads", lambda library: True)
    monkeypatch.setattr(build_asl, "check_executable", lambda path: wrong)
    monkeypatch.setattr(build_asl, "check_library", lambda path: wrong)
    monkeypatch.setattr(build_asl.importlib.util, "find_spec", lambda name: None)
    said = []
    with pytest.raises(SolverNotFoundError, match="casadi is not installed"):
        build_asl.build_asl(tmp_path, report=said.append)
    assert [line.partition(":")[0] for line in said] == ["to be replaced"] * 2
    with pytest.raises(build_asl.BuildFailed, match="its derivatives are WRONG in 1 of 11"):
        build_asl._require_right(wrong, tmp_path)


def test_the_doctor_tells_of_every_library(monkeypatch):
    monkeypatch.setattr(doctor, "_executables", lambda: ["/here/ipopt", "/there/ipopt"])
    monkeypatch.setattr(doctor, "_libraries", lambda: ["/here/libpynumero_ASL.so"])
    monkeypatch.setattr(doctor, "check_executable", lambda path: DerivativeCheck((15,) if "there" in path else ()))
    monkeypatch.setattr(doctor, "check_library", lambda path: DerivativeCheck((), "it is gone"))
    text = "\n".join(doctor._derivative_lines())
    assert text.count("right in 11") == text.count("WRONG in 1 of 11") == text.count("not known: it is gone") == 1
    assert text.count("remedy") == 2
    assert "build-asl" in text


def test_the_check_notices_each_kind_of_wrong_derivative():
    class Program:
        n, m = 2, 1
        jacobian_structure = (np.array([0, 0]), np.array([0, 1]))
        hessian_structure = (np.array([0, 1]), np.array([0, 0]))
        wrong = ""

        def objective(self, x):
            return x[0] ** 2

        def constraints(self, x):
            return np.array([x[0] * x[1]])

        def gradient(self, x):
            return np.array([(2 + 1e-3 * (self.wrong == "gradient")) * x[0], 0.0])

        def jacobian(self, x):
            return np.array([x[1], x[0] + 1e-3 * (self.wrong == "Jacobian")])

        def hessian(self, x, factor, multipliers):
            return np.array([2 * factor, multipliers[0] + 1e-3 * (self.wrong == "Hessian")])

    program = Program()
    assert differ_from_differences(program, np.array([0.7, 1.1])) == []
    for program.wrong in ("gradient", "Jacobian", "Hessian"):
        assert program.wrong in differ_from_differences(program, np.array([0.7, 1.1]))
