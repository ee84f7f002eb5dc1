"""Factorisations compared with dense algebra."""

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.linear_solver import SymmetricFactorisation

from .random_matrices import Matrix

ROUNDED = 1e-11  # smallest eigenvalue of a matrix with unit rows that is told from zero


def equilibrated_eigenvalues(full: np.ndarray) -> np.ndarray | None:
    """Eigenvalues with the same signs, of a matrix whose rows have a largest entry of one; None with a zero row."""
    if len(full) and not np.abs(full).max(axis=0).all():
        return None
    for _ in range(4):
        factors = 1 / np.sqrt(np.abs(full).max(axis=0))
        full = full * factors[:, None] * factors
    return np.linalg.eigvalsh(full)


def check(matrix: Matrix, solver: SymmetricFactorisation, rng: np.random.Generator) -> str:
    """Compare a factorisation with dense algebra; tells what kind of matrix it was."""
    full = matrix.dense()
    eigenvalues = equilibrated_eigenvalues(full)
    try:
        found = solver.factor(matrix.values)
    except EvaluationError:
        assert eigenvalues is None or np.abs(eigenvalues).min() < ROUNDED
        return "singular"
    assert eigenvalues is not None
    if np.abs(eigenvalues).min() < ROUNDED:
        return "nearly singular"
    assert found.negative == (eigenvalues < 0).sum()
    b = full @ rng.normal(size=matrix.n)
    x = solver.solve(b)
    x += solver.solve(b - full @ x)  # as Ipopt does it: pivots may be as small as 1e-8 of their column
    assert np.abs(full @ x - b).max() <= 1e-10 * (np.abs(full).max() * np.abs(x).max() + np.abs(b).max())
    return "regular"
