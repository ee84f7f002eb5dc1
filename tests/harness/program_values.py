"""All numbers of a compiled program, by names of variables and constraints, so that two programs can be compared."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix, csr_matrix, tril

from pyrobocop_pyomo.programs.compiled_model import CompiledModel


class InModelOrder:
    """A program's values by names of variables and constraints, so that two programs can be compared.

    Variables and rows that are on no model, as those of calls, are eliminated: the rows give the variables, and the
    multipliers that take the variables out of the Lagrangian.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        self.compiled = compiled
        self.nlp = compiled.nlp
        self.columns, self.further = in_order(compiled.variables)
        self.rows, self.ties = in_order(compiled.constraints)
        self.names = tuple(
            [parts[place].name for place in places]
            for parts, places in ((compiled.variables, self.columns), (compiled.constraints, self.rows))
        )

    def own(self, x, multipliers):
        """Values in model order, in the order of the program."""
        inner, outer = np.zeros(self.nlp.n), np.zeros(self.nlp.m)
        inner[self.columns], outer[self.rows] = x, multipliers
        return (self.nlp.completed(inner) if self.further.size else inner), outer

    def slopes(self, x):
        """Jacobian of everything, and derivatives of all variables by those of the model."""
        nlp, (own, further) = self.nlp, (self.columns, self.further)
        jacobian = matrix(nlp.jacobian(x), nlp.jacobian_structure, (nlp.m, nlp.n)).toarray()
        by_own = np.zeros((nlp.n, own.size))
        by_own[own] = np.eye(own.size)
        ties = jacobian[self.ties]
        by_own[further] = -np.linalg.solve(ties[:, further], ties[:, own])
        return jacobian, by_own

    def everything(self, x, factor, multipliers):
        x, multipliers = self.own(x, multipliers)
        nlp = self.nlp
        values, (jacobian, by_own) = nlp.constraints(x), self.slopes(x)
        of_further = factor * nlp.gradient(x) + jacobian.T @ multipliers
        multipliers[self.ties] = -np.linalg.solve(jacobian[self.ties][:, self.further].T, of_further[self.further])
        hessian = matrix(nlp.hessian(x, factor, multipliers), nlp.hessian_structure, (nlp.n, nlp.n))
        hessian = hessian + tril(hessian, -1).T
        return {
            "objective": nlp.objective(x),
            "gradient": by_own.T @ nlp.gradient(x),
            # A writer may move a row's constant into its bounds, so that only the distances are comparable.
            "to lower": finite(values - nlp.g_lower)[self.rows],
            "to upper": finite(nlp.g_upper - values)[self.rows],
            "jacobian": csr_matrix(jacobian[self.rows] @ by_own),
            "hessian": csr_matrix(by_own.T @ (hessian @ by_own)),
            "bounds": finite(np.array([nlp.x_lower, nlp.x_upper])[:, self.columns]),
            "start": nlp.x_start[self.columns],
        }


def in_order(parts):
    """Places of what is on the model, by name, and of what is not."""
    is_own = np.array([part.parent_block() is not None for part in parts], dtype=bool)
    own = sorted(np.flatnonzero(is_own), key=lambda place: parts[place].name)
    return np.array(own, dtype=np.intp), np.flatnonzero(~is_own)


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
