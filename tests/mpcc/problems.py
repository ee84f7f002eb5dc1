"""Small complementarity programs whose stationary points are known by hand."""

import numpy as np
from harness.quadratic_program import QuadraticProgram

from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.mpcc.active_set import BranchPoint
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram, Sides
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint


def sides(index, sign=1.0, offset=0.0):
    index = np.atleast_1d(np.asarray(index, dtype=np.intp))
    return Sides(index, np.full(index.size, sign), np.full(index.size, offset))


def paired(c, pairs=1, **parts):
    """A quadratic program whose first variables are paired with those after them."""
    k = np.arange(pairs)
    return ComplementarityProgram(QuadraticProgram(c, **parts), sides(k), sides(pairs + k))


def trap():
    """Minimise x^2 + (y - 1)^2 over 0 <= x ⟂ y >= 0: the origin is M-stationary, and y descends from it."""
    return paired([0, -2], H=[[2, 0], [0, 2]], x_lower=[0, 0])


def at_origin(program, branch=None):
    nlp = program.nlp
    point = PrimalDualPoint(np.zeros(nlp.n), np.zeros(nlp.m), np.zeros(nlp.n), np.zeros(nlp.n))
    return BranchPoint.at(program, point, branch)


def ipopt(nlp, start, iterations=None):
    options = {"bound_relax_factor": 0.0, "warm_start_init_point": "yes", "mu_init": 1e-4}
    return run_ipopt(nlp, options, start)
