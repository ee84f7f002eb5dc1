"""A nonlinear program from arrays, for tests of what works on numbers."""

import numpy as np


class QuadraticProgram:
    """Minimise c @ x + x @ H @ x / 2 subject to g_lower <= A @ x <= g_upper and bounds."""

    derivatives = "by hand"

    def __init__(self, c, H=None, A=None, g_lower=None, g_upper=None, x_lower=None, x_upper=None):
        self.c = np.asarray(c, dtype=float)
        self.n = self.c.size
        self.H = np.zeros((self.n, self.n)) if H is None else np.asarray(H, dtype=float)
        self.A = np.zeros((0, self.n)) if A is None else np.asarray(A, dtype=float)
        self.m = self.A.shape[0]
        self.g_lower = np.full(self.m, -np.inf) if g_lower is None else np.asarray(g_lower, dtype=float)
        self.g_upper = np.full(self.m, np.inf) if g_upper is None else np.asarray(g_upper, dtype=float)
        self.x_lower = np.full(self.n, -np.inf) if x_lower is None else np.asarray(x_lower, dtype=float)
        self.x_upper = np.full(self.n, np.inf) if x_upper is None else np.asarray(x_upper, dtype=float)
        self.x_start = np.zeros(self.n)
        rows, columns = np.nonzero(np.ones_like(self.A))
        self.jacobian_structure = rows.astype(np.int32), columns.astype(np.int32)
        rows, columns = np.tril_indices(self.n)
        self.hessian_structure = rows.astype(np.int32), columns.astype(np.int32)

    def objective(self, x):
        return float(self.c @ x + x @ self.H @ x / 2)

    def gradient(self, x):
        return self.c + self.H @ x

    def constraints(self, x):
        return self.A @ x

    def jacobian(self, x):
        return self.A.ravel().copy()

    def hessian(self, x, objective_factor, multipliers):
        return objective_factor * self.H[self.hessian_structure]
