"""The linear solver on matrices as Ipopt assembles them for models of the catalogue."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.dense_inertia import check
from harness.random_matrices import Matrix
from known_mpccs import mpcc_problems

from pyrobocop_pyomo.linear_solver import SymmetricFactorisation
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram

LARGEST = 150  # rows; dense eigenvalues of more cost too much
ENOUGH = 100


def interior(lower: np.ndarray, upper: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point pushed away from its bounds, and its distance from the nearer one."""
    width = np.where(np.isfinite(upper - lower), upper - lower, np.inf)
    push = np.minimum(1e-2, width / 4)
    x = np.clip(x, lower + push, upper - push)
    return x, np.minimum(x - lower, upper - x)


def barrier_matrix(nlp: NonlinearProgram, barrier: float, shift: float) -> Matrix:
    """[[H + S, J'], [J, -D]]: S of the bounds, D of the inequalities' slacks, with Ipopt's shift of the diagonal."""
    free = nlp.x_upper > nlp.x_lower
    x, gap = interior(np.where(free, nlp.x_lower, -np.inf), np.where(free, nlp.x_upper, np.inf), nlp.x_start)
    rows, columns = nlp.hessian_structure
    below, right = nlp.jacobian_structure
    g = nlp.constraints(x)
    equal = nlp.g_lower == nlp.g_upper
    _, slack = interior(np.where(equal, -np.inf, nlp.g_lower), np.where(equal, np.inf, nlp.g_upper), g)
    flexibility = np.where(equal, 0.0, np.minimum(slack, 1e4) ** 2 / barrier)
    diagonal = np.arange(nlp.n + nlp.m)
    return Matrix(
        nlp.n + nlp.m,
        np.r_[rows, below + nlp.n, diagonal],
        np.r_[columns, right, diagonal],
        np.r_[
            nlp.hessian(x, 1.0, np.ones(nlp.m)), nlp.jacobian(x), barrier / gap**2 + shift, -flexibility
        ],
    )  # fmt: skip


@pytest.mark.casadi
def test_inertia_of_the_matrices_of_real_models(library):
    rng = np.random.default_rng(0)
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")
    kinds: Counter[str] = Counter()
    for problem in mpcc_problems():
        if kinds["regular"] >= ENOUGH:
            break
        model = problem.build()
        relax.apply_to(model, delta=1e-3)
        nlp = CompiledModel(model, "vectorised").nlp
        if nlp.n + nlp.m > LARGEST:
            continue
        for barrier, shift in ((1.0, 0.0), (1e-4, 0.0), (1e-9, 0.0), (1e-4, 1e-4)):
            matrix = barrier_matrix(nlp, barrier, shift)
            kinds[check(matrix, SymmetricFactorisation(*matrix[:3], library), rng)] += 1
    assert kinds["regular"] >= ENOUGH
