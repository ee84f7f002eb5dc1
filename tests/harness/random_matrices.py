"""Symmetric matrices as interior-point methods make them: entries in either triangle, in an order without meaning."""

from typing import NamedTuple

import numpy as np


class Matrix(NamedTuple):
    n: int
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    def dense(self) -> np.ndarray:
        full = np.zeros((self.n, self.n))
        np.add.at(full, (self.rows, self.columns), self.values)
        return full + full.T - np.diag(np.diag(full))


def kkt_matrix(rng: np.random.Generator, *, largest: int = 40, scale: float = 0.0) -> Matrix:
    """[[H, J'], [J, 0]] with a sparse indefinite H, of whose diagonal a random part is zero."""
    n = int(rng.integers(1, largest))
    m = int(rng.integers(0, n + 1))
    density, empty = rng.uniform(0.02, 0.4), rng.uniform()
    full = np.zeros((n + m, n + m))
    full[:n, :n] = np.triu(rng.normal(size=(n, n)) * (rng.random((n, n)) < density), 1)
    full[np.arange(n), np.arange(n)] = rng.normal(size=n) * (rng.random(n) > empty)
    full[:n, n:] = rng.normal(size=(n, m)) * (rng.random((n, m)) < density)
    full[rng.integers(n, size=m), n + np.arange(m)] += 1
    if scale:
        sizes = 10 ** rng.uniform(-scale, scale, n + m)
        full *= sizes[:, None] * sizes
    return shuffled(rng, full)


def shuffled(rng: np.random.Generator, upper: np.ndarray) -> Matrix:
    """Entries of an upper triangle after a symmetric permutation, each in either triangle; some in two parts."""
    i, j = np.nonzero(upper)
    values = upper[i, j]
    again = rng.random(i.size) < 0.1
    part = values[again] * rng.uniform(-1, 2, again.sum())
    values[again] -= part
    i, j, values = np.r_[i, i[again]], np.r_[j, j[again]], np.r_[values, part]
    order, name, flip = rng.permutation(i.size), rng.permutation(len(upper)), rng.random(i.size) < 0.5
    i, j = np.where(flip, name[i], name[j]), np.where(flip, name[j], name[i])
    return Matrix(len(upper), i[order], j[order], values[order])


def trajectory_matrix(rng: np.random.Generator, steps: int, states: int = 4) -> Matrix:
    """The KKT matrix of a discretised motion: states and controls of each step, rows that join it with the next one."""
    width = states + 1
    n, m = steps * width, (steps - 1) * states
    i, j, values = [], [], []
    for step in range(steps):
        base = step * width
        for a in range(width):
            i.append(base + a), j.append(base + a), values.append(rng.uniform(0.1, 2) if a % 2 or a == states else 0.0)
        for row in range(states if step < steps - 1 else 0):
            for variable in (*range(base, base + width), base + width + row):
                i.append(n + step * states + row), j.append(variable), values.append(rng.normal())
    return Matrix(n + m, np.array(i), np.array(j), np.array(values))
