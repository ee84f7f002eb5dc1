"""All numbers of a compiled program, by names of variables and constraints, so that two programs can be compared."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix, csr_matrix, tril

from pyrobocop_pyomo.programs.compiled_model import CompiledModel


class InModelOrder:
    """A program's values by names of variables and constraints, so that two programs can be compared."""

    def __init__(self, compiled: CompiledModel) -> None:
        self.compiled = compiled
        self.nlp = compiled.nlp
        self.columns = np.argsort([v.name for v in compiled.variables])
        self.rows = np.argsort([c.name for c in compiled.constraints])
        self.names = sorted(v.name for v in compiled.variables), sorted(c.name for c in compiled.constraints)

    def own(self, x, multipliers):
        """Values in model order, in the order of the program."""
        inner, outer = np.empty(self.nlp.n), np.empty(self.nlp.m)
        inner[self.columns], outer[self.rows] = x, multipliers
        return inner, outer

    def everything(self, x, factor, multipliers):
        x, multipliers = self.own(x, multipliers)
        nlp = self.nlp
        values = nlp.constraints(x)
        hessian = matrix(nlp.hessian(x, factor, multipliers), nlp.hessian_structure, (nlp.n, nlp.n))
        hessian = hessian + tril(hessian, -1).T
        return {
            "objective": nlp.objective(x),
            "gradient": nlp.gradient(x)[self.columns],
            # A writer may move a row's constant into its bounds, so that only the distances are comparable.
            "to lower": finite(values - nlp.g_lower)[self.rows],
            "to upper": finite(nlp.g_upper - values)[self.rows],
            "jacobian": matrix(nlp.jacobian(x), nlp.jacobian_structure, (nlp.m, nlp.n))[self.rows][:, self.columns],
            "hessian": csr_matrix(hessian)[self.columns][:, self.columns],
            "bounds": finite(np.array([nlp.x_lower, nlp.x_upper])[:, self.columns]),
            "start": nlp.x_start[self.columns],
        }


def matrix(values, structure, shape):
    return coo_matrix((values, structure), shape).tocsr()


def finite(values):
    return np.where(np.isfinite(values), values, 1e30)


def assert_same(found: dict, expected: dict, within: float = 1e-9) -> None:
    for name, value in expected.items():
        if hasattr(value, "toarray"):
            scale = max(1.0, abs(value).max() if value.nnz else 0.0)
            assert abs(found[name] - value).max() <= within * scale, name
        else:
            assert found[name] == pytest.approx(value, rel=within, abs=within), name
