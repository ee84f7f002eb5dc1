"""Collocation schemes as frozen data: a scheme is its points, from which everything else is computed.

The named families of schemes, and how one is found by the words that a user types, come after.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.presentation import Presented

from .arrays import Array
from .polynomials import evaluation_matrix, integration_matrix


@dataclass(frozen=True, eq=False)  # eq=False: comparing arrays has no single truth value
class Scheme(Presented):
    """Collocation method on one element, local time ``tau`` in [0, 1].

    Every scheme reaches the model in one form. With the state's values ``x`` at `state_nodes` (the element start
    first), the right-hand sides ``f`` at the stages, and the element width ``h``::

        D x = h F f                      one row per line of D
        x_end = end_weights @ x          only where the element end is no node

    Attributes
    ----------
    name : str
        As it is quoted in messages, for example ``"radau(3)"``.
    c : float array, shape (s,)
        Stage times, strictly increasing in [0, 1]. With ``c[0] = 0`` the first stage is the element start, with
        ``c[-1] = 1`` the last one its end.

    Raises
    ------
    ModelError
        When the stage times do not increase, or are too near to each other to be told apart.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5,
    doi:10.1007/978-3-642-05221-7
    """

    name: str
    c: Array

    def __post_init__(self) -> None:
        c = self.c
        if c.ndim != 1 or len(c) == 0 or not (np.all(np.diff(c) > 0) and c[0] >= 0.0 and c[-1] <= 1.0):
            raise ModelError(f"{self.name}: collocation points {c.tolist()} must strictly increase in [0, 1].")
        if np.linalg.cond(self._stage_matrix) > 1e12:
            raise ModelError(f"{self.name}: the stage equations are singular; the stages cannot be told apart.")

    @classmethod
    def from_points(cls, name: str, points: ArrayLike) -> Scheme:
        """The collocation method on given points in [0, 1]."""
        return cls(name, np.asarray(points, dtype=float))

    @cached_property
    def A(self) -> Array:
        """``x[stage i] = x_start + h sum_j A[i, j] f_j``, shape ``(s, s)``."""
        return integration_matrix(self.c, self.c)

    @cached_property
    def b(self) -> Array:
        """``x_end = x_start + h b @ f``, shape ``(s,)``; also the weights of running costs."""
        return integration_matrix(self.c, [1.0])[0]

    @property
    def stages(self) -> int:
        """Number of stages per element."""
        return len(self.c)

    @cached_property
    def starts_on_a_stage(self) -> bool:
        """True when the first stage is the element start, so that neighbouring elements share it."""
        return bool(self.c[0] == 0.0)

    @cached_property
    def stiffly_accurate(self) -> bool:
        """True when the last stage is the element end: no further row is needed for it."""
        return bool(self.c[-1] == 1.0)

    @cached_property
    def order(self) -> int:
        """Order of the method at element ends, which its quadrature has too (Hairer & Wanner, theorem IV.5.1)."""
        # The first Legendre polynomial whose integral, which is zero, the quadrature misses: by about one, where its
        # error on a monomial would drown in rounding.
        degrees = range(1, 2 * self.stages + 1)
        missed = (abs(self.b @ np.polynomial.legendre.Legendre.basis(k)(2.0 * self.c - 1.0)) > 1e-8 for k in degrees)
        return next(k for k, is_missed in zip(degrees, missed, strict=True) if is_missed)

    @cached_property
    def end_is_a_node(self) -> bool:
        """True when the state's value at the element end is one of `state_nodes`."""
        return self.stiffly_accurate or self._end_completes_the_rows

    @property
    def _end_completes_the_rows(self) -> bool:
        # An explicit first stage gives no row for a state of its own; without a last stage at the end the row of b
        # takes its place, and there are as many rows as stages again.
        return self.starts_on_a_stage and not self.stiffly_accurate

    @cached_property
    def _increments(self) -> Array:
        """Rows ``(x_node - x_start) / h`` in terms of the stages' right-hand sides."""
        rows = self.A[1:] if self.starts_on_a_stage else self.A
        return np.vstack([rows, self.b]) if self._end_completes_the_rows else rows

    @cached_property
    def _stage_matrix(self) -> Array:
        """The square part of the increments that is inverted."""
        rows = self._increments
        return rows if rows.shape[0] == self.stages else rows[:, 1:]

    @cached_property
    def state_nodes(self) -> Array:
        """Local times at which the state has a value: the element start, the stages, and the end where it is a row."""
        inner = self.c[1:] if self.starts_on_a_stage else self.c
        return np.concatenate([[0.0], inner, [1.0] if self._end_completes_the_rows else []])

    @cached_property
    def D(self) -> Array:
        """Coefficients of the state's values in the rows, shape ``(rows, len(state_nodes))``."""
        inverse = np.linalg.inv(self._stage_matrix)
        return np.hstack([-inverse.sum(axis=1, keepdims=True), inverse])

    @cached_property
    def F(self) -> Array:
        """Coefficients of the right-hand sides in the rows, shape ``(rows, s)``: one 1 per row, and the shared first
        stage of a scheme that starts and ends on stages."""
        matrix: Array = np.asarray(np.linalg.solve(self._stage_matrix, self._increments), dtype=np.float64)
        # Exact where it is exact: a coefficient that is zero by construction must not appear in a row.
        square = matrix[:, matrix.shape[1] - matrix.shape[0] :]
        square[...] = np.eye(len(square))
        return matrix

    @cached_property
    def row_stages(self) -> range:
        """The stage whose right-hand side a row is about: its coefficient in `F` is 1."""
        return range(self.stages - len(self.D), self.stages)

    @cached_property
    def end_weights(self) -> Array:
        """Value at the element end in terms of the values at `state_nodes`."""
        if self.end_is_a_node:
            return np.asarray(np.eye(len(self.state_nodes))[-1], dtype=np.float64)
        weights = np.linalg.solve(self._stage_matrix.T, self.b)
        return np.asarray([1.0 - weights.sum(), *weights], dtype=np.float64)

    def state_at(self, tau: ArrayLike) -> Array:
        """Weights of the values at `state_nodes` that give the state at local times, shape ``(len(tau), nodes)``.

        For a scheme that starts and ends on stages this polynomial has one degree less than the collocation
        polynomial, which also meets the derivative at the element start; see `increments_at`.
        """
        return evaluation_matrix(self.state_nodes, tau)

    def increments_at(self, tau: ArrayLike) -> Array:
        """Weights of ``h f`` at the stages that give ``x(tau) - x_start``, shape ``(len(tau), s)``."""
        return integration_matrix(self.c, tau)

    def stage_polynomial_at(self, tau: ArrayLike) -> Array:
        """Weights of the stage values that give a control or algebraic, shape ``(len(tau), s)``."""
        return evaluation_matrix(self.c, tau)

    def __str__(self) -> str:
        return self.name


def radau(stages: int) -> Scheme:
    """Radau IIA with any number of stages: stiffly accurate, order ``2 s - 1``; one stage is implicit Euler.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5, eq. (5.7),
    doi:10.1007/978-3-642-05221-7
    """
    _check_stages("radau", stages)
    # The inner points are the roots of the Jacobi polynomial P^(1,0) of degree s - 1, vectorised to [0, 1].
    inner = (scipy.special.roots_jacobi(stages - 1, 1.0, 0.0)[0] + 1.0) / 2.0 if stages > 1 else np.empty(0)
    return Scheme.from_points(f"radau({stages})", np.concatenate([inner, [1.0]]))


def gauss_legendre(stages: int) -> Scheme:
    """Gauss-Legendre with any number of stages: symmetric, order ``2 s``; one stage is the implicit midpoint rule.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5, eq. (5.2),
    doi:10.1007/978-3-642-05221-7
    """
    _check_stages("gauss", stages)
    return Scheme.from_points(f"gauss({stages})", (scipy.special.roots_legendre(stages)[0] + 1.0) / 2.0)


def lobatto(stages: int) -> Scheme:
    """Lobatto IIIA with two stages or more: symmetric, order ``2 s - 2``; elements share their end points.

    Two stages are the trapezoidal rule, three are Hermite-Simpson.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5, table 5.7,
    doi:10.1007/978-3-642-05221-7
    """
    _check_stages("lobatto", stages, least=2)
    # The inner points are the roots of the Jacobi polynomial P^(1,1) of degree s - 2, vectorised to [0, 1].
    inner = (scipy.special.roots_jacobi(stages - 2, 1.0, 1.0)[0] + 1.0) / 2.0 if stages > 2 else np.empty(0)
    return Scheme.from_points(f"lobatto({stages})", np.concatenate([[0.0], inner, [1.0]]))


def _check_stages(name: str, stages: int, least: int = 1) -> None:
    if isinstance(stages, bool) or not isinstance(stages, (int, np.integer)) or stages < least:
        raise ModelError(f"{name}: stages = {stages!r}; expected an integer of at least {least}.")


# Further names for the same thing are welcome here: a user types the one that the field taught them.
FAMILIES: dict[str, Callable[[int], Scheme]] = {
    "radau": radau,
    "gauss": gauss_legendre,
    "legendre": gauss_legendre,
    "lobatto": lobatto,
}

SINGLE_SCHEMES: dict[str, Callable[[], Scheme]] = {
    "implicit_euler": partial(radau, 1),
    "implicit_midpoint": partial(gauss_legendre, 1),
    "trapezoid": partial(lobatto, 2),
    "hermite_simpson": partial(lobatto, 3),
    "explicit_euler": partial(Scheme.from_points, "explicit_euler", [0.0]),
}


def find_scheme(scheme: str | Scheme, stages: int | None = None) -> Scheme:
    """The scheme that a user's words name.

    Parameters
    ----------
    scheme : str or Scheme
        A family with a number of ``stages``: ``"radau"``, ``"gauss"`` (also ``"legendre"``), ``"lobatto"``; a
        single scheme: ``"implicit_euler"``, ``"implicit_midpoint"``, ``"trapezoid"``, ``"hermite_simpson"``,
        ``"explicit_euler"``; or a scheme object, taken as it is.
    stages : int, optional
        Number of stages per element; 3 by default in a family.

    Raises
    ------
    ModelError
        When the name is unknown or the number of stages does not fit.
    """
    if not isinstance(scheme, Scheme) and scheme in FAMILIES:
        return FAMILIES[scheme](3 if stages is None else stages)
    if isinstance(scheme, Scheme):
        made = scheme
    elif scheme in SINGLE_SCHEMES:
        made = SINGLE_SCHEMES[scheme]()
    else:
        known = ", ".join(f"'{name}'" for name in (*FAMILIES, *SINGLE_SCHEMES))
        raise ModelError(f"unknown scheme {scheme!r}; known are {known}, or pass a Scheme.")
    if stages not in (None, made.stages):
        said = scheme if made is scheme else repr(scheme)
        raise ModelError(
            f"{said} has {made.stages} stage{'s' if made.stages > 1 else ''}, but "
            f"stages = {stages} was asked for. Leave 'stages' out."
        )
    return made
