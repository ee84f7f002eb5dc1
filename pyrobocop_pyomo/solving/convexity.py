"""Whether a program has linear rows and a convex quadratic objective: then no other start leads to a better optimum."""

from __future__ import annotations

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, SingularMatrix
from pyrobocop_pyomo.ipopt.linear_solvers import suits
from pyrobocop_pyomo.linear_solver import SymmetricFactorisation
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

# Relative to the largest second derivative: less is rounding.
ROUNDING = 1e-9


def is_convex(nlp: NonlinearProgram, x: FloatArray) -> bool:
    """Whether second derivatives say so at a point and at a random one beside it.

    Derivatives that are constant agree at any two points; others differ at almost all.

    Parameters
    ----------
    nlp : NonlinearProgram
    x : float array, shape (n,)
        A point at which all functions have values.
    """
    random = np.random.default_rng(0)
    beside = np.clip(x + np.maximum(1.0, np.abs(x)) * random.uniform(-0.5, 0.5, x.size), nlp.x_lower, nlp.x_upper)
    try:
        if any(nlp.hessian(at, 0.0, random.uniform(0.5, 1.0, nlp.m)).any() for at in (x, beside)):
            return False
        here, there = (nlp.hessian(at, 1.0, np.zeros(nlp.m)) for at in (x, beside))
    except EvaluationError:
        return False
    size = float(np.abs(here).max(initial=0.0))
    if not np.allclose(here, there, rtol=0.0, atol=ROUNDING * size):
        return False
    if size == 0.0:
        return True
    return suits(nlp) and _is_semidefinite(nlp, here / size)


def _is_semidefinite(nlp: NonlinearProgram, entries: FloatArray) -> bool:
    """Whether no curvature of a matrix of size one is negative beyond rounding."""
    diagonal = np.arange(nlp.n)
    rows, columns = nlp.hessian_structure
    factors = SymmetricFactorisation(nlp.n, np.concatenate([rows, diagonal]), np.concatenate([columns, diagonal]))
    try:
        shifted = np.concatenate([entries, np.full(nlp.n, ROUNDING)])
        return factors.factor(shifted).negative == 0
    except SingularMatrix:
        return False
