"""Whether an installation of the AMPL Solver Library differentiates rightly, tried on small models.

Run with the path of a PyNumero library it prints the numbers of the models that the library differentiates wrongly: in
a process of its own, since a process loads one such library only, and a faulty one may end it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pyomo.contrib.pynumero.asl import AmplInterface

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.programs.asl_program import AslProgram
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

from .nested_models import nested_model

# Of 3000 random models with nested Expressions, ten of those that the library of 2019 differentiates wrongly:
# gradients, Hessians, both; and one that it does when the expressions are written out.
NESTED = (15, 165, 256, 285, 464, 737, 856, 1784, 2195, 2905)
EXPANDED = (871,)

_SECONDS = 60.0


class DerivativeCheck(NamedTuple):
    """What a library made of the models.

    Attributes
    ----------
    wrong : tuple of int
        Numbers of the models with wrong derivatives.
    trouble : str
        Why the models could not be tried; empty when they were.
    """

    wrong: tuple[int, ...]
    trouble: str = ""

    @property
    def right(self) -> bool:
        """Whether all derivatives are right."""
        return not self.wrong and not self.trouble

    def __str__(self) -> str:
        tried = len(NESTED) + len(EXPANDED)
        if self.trouble:
            return f"not known: {self.trouble}"
        if self.wrong:
            return f"WRONG in {len(self.wrong)} of {tried} small models with nested Expressions"
        return f"right in {tried} small models with nested Expressions"


def check_executable(path: str) -> DerivativeCheck:
    """Let an ``ipopt`` executable compare its derivatives with differences."""
    wrong = []
    with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
        # The driver knows few options as arguments, all of them from a file of this name in its folder.
        (Path(folder) / "ipopt.opt").write_text(
            "derivative_test second-order\npoint_perturbation_radius 0\nmax_iter 0\n", encoding="utf-8"
        )
        for number, file in _files(Path(folder)):
            try:
                run = subprocess.run(
                    [path, str(file)], cwd=folder, capture_output=True, text=True, timeout=_SECONDS, check=False
                )
            except (OSError, subprocess.TimeoutExpired) as error:
                return DerivativeCheck((), f"'{path}' does not run: {error}")
            if "derivative checker detected" in run.stdout.lower():
                wrong.append(number)
            elif "No errors detected by derivative checker" not in run.stdout:
                said = (run.stdout + run.stderr).strip().splitlines()
                return DerivativeCheck((), f"its derivative test does not run: {said[-1] if said else 'no output'}")
    return DerivativeCheck(tuple(wrong))


def check_library(path: str) -> DerivativeCheck:
    """Compare the derivatives of a PyNumero library with differences, in another process."""
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    try:
        run = subprocess.run(
            [sys.executable, "-m", __name__, path], env=environment, capture_output=True, text=True, timeout=_SECONDS,
            check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return DerivativeCheck((), str(error))
    if run.returncode != 0:
        said = run.stderr.strip().splitlines()
        return DerivativeCheck((), f"a process with it ended with code {run.returncode}: {said[-1] if said else ''}")
    return DerivativeCheck(tuple(json.loads(run.stdout.splitlines()[-1])))


def differ_from_differences(program: NonlinearProgram, x: FloatArray) -> list[str]:
    """Which derivatives are not those of the functions: by central differences, to five digits of the largest.

    A long step is wrong where the function bends, a short one where it is rounded; a wrong derivative is so with each.
    """
    multipliers = np.linspace(0.7, 1.9, program.m)
    gradient, jacobian = program.gradient(x), _jacobian(program, x)
    hessian = np.zeros((program.n, program.n))
    np.add.at(hessian, program.hessian_structure, program.hessian(x, 1.0, multipliers))
    hessian += np.tril(hessian, -1).T

    def functions(at: FloatArray) -> FloatArray:
        return np.append(program.objective(at), program.constraints(at))

    def lagrangian_gradient(at: FloatArray) -> FloatArray:
        return program.gradient(at) + multipliers @ _jacobian(program, at)

    differ = ["gradient", "Jacobian", "Hessian"]
    for length in (1e-5, 1e-6, 1e-7):
        steps = length * np.eye(program.n)
        first = np.array([functions(x + step) - functions(x - step) for step in steps]).T / (2 * length)
        second = np.array([lagrangian_gradient(x + step) - lagrangian_gradient(x - step) for step in steps])
        compared = {
            "gradient": (gradient, first[0]), "Jacobian": (jacobian, first[1:]),
            "Hessian": (hessian, second / (2 * length)),
        }  # fmt: skip
        differ = [name for name in differ if not _agree(*compared[name])]
        if not differ:
            break
    return differ


def _agree(given: FloatArray, found: FloatArray) -> bool:
    return bool(np.max(np.abs(given - found), initial=0.0) < 1e-5 * (1.0 + np.max(np.abs(found), initial=0.0)))


def _jacobian(program: NonlinearProgram, x: FloatArray) -> FloatArray:
    values = np.zeros((program.m, program.n))
    np.add.at(values, program.jacobian_structure, program.jacobian(x))
    return values


def _files(folder: Path) -> Iterator[tuple[int, Path]]:
    """The models as Pyomo writes them when it is not told otherwise, with defined variables."""
    for number in (*NESTED, *EXPANDED):
        path = folder / f"model_{number}.nl"
        nested_model(number, named=number in NESTED).write(str(path), format="nl")
        yield number, path


def _wrong_in_library() -> list[int]:
    with tempfile.TemporaryDirectory(prefix="pyrobocop_") as folder:
        programs = [(number, AslProgram(path)) for number, path in _files(Path(folder))]
    return [number for number, program in programs if _is_wrong(program)]


def _is_wrong(program: NonlinearProgram) -> bool:
    try:
        return bool(differ_from_differences(program, program.x_start))
    except EvaluationError:
        return True


if __name__ == "__main__":
    AmplInterface.libname = sys.argv[1]
    sys.stdout.write(json.dumps(_wrong_in_library()) + "\n")
