"""Collocation schemes as frozen data: points are polynomial roots, facts are computed from the arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.errors import SchemeError
from pyrobocop_pyomo.optional_imports import scipy

from .lagrange import differentiation_matrix, evaluation_matrix, integration_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)  # eq=False: comparing arrays has no single truth value
class CollocationScheme:
    """Collocation Runge-Kutta method on one element, local time ``tau`` in [0, 1].

    Attributes
    ----------
    name : str
        As it is quoted in messages, for example ``"radau(3)"``.
    A : float array, shape (s, s)
        ``A[i, j]`` = integral of Lagrange polynomial ``j`` over ``[0, c[i]]``.
    b : float array, shape (s,)
        Quadrature weights: ``x_end = x_start + h * b @ xdot``; also the weights of running costs.
    c : float array, shape (s,)
        Collocation points, strictly increasing in (0, 1].

    Raises
    ------
    SchemeError
        When the points do not increase within [0, 1], or ``A`` and ``b`` do not belong to them.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5,
    doi:10.1007/978-3-642-05221-7
    """

    name: str
    A: Array
    b: Array
    c: Array

    def __post_init__(self) -> None:
        if not (np.all(np.diff(self.c) > 0) and self.c[0] > 0.0 and self.c[-1] <= 1.0):
            # A point at 0 would coincide with the element start, which is a node of the state of its own.
            raise SchemeError(f"{self.name}: collocation points {self.c.tolist()} must strictly increase in (0, 1].")
        gap = np.abs(np.vstack([self.A, self.b]) - integration_matrix(self.c, [*self.c, 1.0])).max(axis=1)
        if gap.max() > 1e-12:
            row = int(gap.argmax())
            where = "b" if row == self.stages else f"row {row} of A"
            raise SchemeError(
                f"{self.name}: {where} differs by {gap[row]:.1e} from the integrals of the Lagrange polynomials "
                "on c. Build the tableau with CollocationScheme.from_points(name, c)."
            )

    @classmethod
    def from_points(cls, name: str, points: ArrayLike) -> CollocationScheme:
        """The collocation method on given points in [0, 1]."""
        c = np.asarray(points, dtype=float)
        integrals = integration_matrix(c, [*c, 1.0])
        return cls(name, A=integrals[:-1], b=integrals[-1], c=c)

    @property
    def stages(self) -> int:
        """Number of collocation points per element."""
        return len(self.c)

    @property
    def stiffly_accurate(self) -> bool:
        """True when the element ends in its last stage: no continuity equation is needed."""
        return bool(self.c[-1] == 1.0)

    @cached_property
    def order(self) -> int:
        """Order of the method at element ends, which is the order of its quadrature ``(b, c)``."""
        # The quadrature has order s + k when the node polynomial is orthogonal to all polynomials of degree
        # below k (Hairer & Wanner, theorem IV.5.1). Normalised, the first inner product that does not vanish is
        # of size one: this decides sharply where the defect on a monomial would drown in rounding.
        gauss, weights = np.polynomial.legendre.leggauss(2 * self.stages + 2)
        tau, weights = (gauss + 1.0) / 2.0, weights / 2.0
        node_polynomial = np.prod(tau[:, None] - self.c[None, :], axis=1)
        node_polynomial /= np.sqrt(weights @ node_polynomial**2)
        for k in range(self.stages + 1):
            legendre = np.polynomial.legendre.Legendre.basis(k)(gauss) * np.sqrt(2 * k + 1)
            if abs(weights @ (node_polynomial * legendre)) > 1e-8:
                return self.stages + k
        raise SchemeError(f"{self.name}: {self.stages} points cannot be orthogonal beyond degree {self.stages}.")

    @cached_property
    def state_nodes(self) -> Array:
        """Nodes of the state polynomial: the element start and the stages, shape ``(s + 1,)``."""
        return np.concatenate([[0.0], self.c])

    @cached_property
    def D(self) -> Array:
        """Derivative of the state polynomial at the stages, shape ``(s, s + 1)``."""
        return differentiation_matrix(self.state_nodes)[1:]

    @cached_property
    def end_weights(self) -> Array:
        """Value of the state polynomial at the element end, shape ``(s + 1,)``."""
        return evaluation_matrix(self.state_nodes, [1.0])[0]

    def state_at(self, tau: ArrayLike) -> Array:
        """Weights of (start, stages) that give the state at local times, shape ``(len(tau), s + 1)``."""
        return evaluation_matrix(self.state_nodes, tau)

    def stage_polynomial_at(self, tau: ArrayLike) -> Array:
        """Weights of the stage values that give a control or algebraic, shape ``(len(tau), s)``."""
        return evaluation_matrix(self.c, tau)

    def __str__(self) -> str:
        return self.name


def radau(stages: int) -> CollocationScheme:
    """Radau IIA with any number of stages: stiffly accurate, order ``2 s - 1``; one stage is implicit Euler.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5, eq. (5.7),
    doi:10.1007/978-3-642-05221-7
    """
    _check_stages("radau", stages)
    # The inner points are the roots of the Jacobi polynomial P^(1,0) of degree s - 1, mapped to [0, 1].
    inner = (scipy.special.roots_jacobi(stages - 1, 1.0, 0.0)[0] + 1.0) / 2.0 if stages > 1 else np.empty(0)
    return CollocationScheme.from_points(f"radau({stages})", np.concatenate([inner, [1.0]]))


def gauss_legendre(stages: int) -> CollocationScheme:
    """Gauss-Legendre with any number of stages: symmetric, order ``2 s``; one stage is the implicit midpoint rule.

    References
    ----------
    Hairer & Wanner, Solving Ordinary Differential Equations II, sec. IV.5, eq. (5.2),
    doi:10.1007/978-3-642-05221-7
    """
    _check_stages("gauss", stages)
    return CollocationScheme.from_points(f"gauss({stages})", (scipy.special.roots_legendre(stages)[0] + 1.0) / 2.0)


def _check_stages(name: str, stages: int) -> None:
    if isinstance(stages, bool) or not isinstance(stages, (int, np.integer)) or stages < 1:
        raise SchemeError(f"{name}: stages = {stages!r}; expected an integer of at least 1.")


# Further names for the same thing are welcome here: a user types the one that the field taught them.
SCHEMES: dict[str, Callable[[int], CollocationScheme]] = {
    "radau": radau,
    "gauss": gauss_legendre,
    "legendre": gauss_legendre,
}

ONE_STAGE_NAMES: dict[str, Callable[[int], CollocationScheme]] = {
    "implicit_euler": radau,
    "implicit_midpoint": gauss_legendre,
}


def find_scheme(scheme: str | CollocationScheme, stages: int | None = None) -> CollocationScheme:
    """The scheme that a user's words name.

    Parameters
    ----------
    scheme : str or CollocationScheme
        ``"radau"``, ``"gauss"`` (also ``"legendre"``) with ``stages``; ``"implicit_euler"`` or
        ``"implicit_midpoint"``, which have one stage; or a scheme object, taken as it is.
    stages : int, optional
        Number of collocation points per element; 3 by default, 1 for the one-stage names.

    Raises
    ------
    SchemeError
        When the name is unknown or the number of stages does not fit.
    """
    if isinstance(scheme, CollocationScheme):
        if stages not in (None, scheme.stages):
            raise SchemeError(
                f"{scheme.name} has {scheme.stages} stages, but stages = {stages} was asked for. Leave 'stages' out."
            )
        return scheme
    if scheme in ONE_STAGE_NAMES:
        if stages not in (None, 1):
            raise SchemeError(f"'{scheme}' has one stage, but stages = {stages} was asked for. Leave 'stages' out.")
        return ONE_STAGE_NAMES[scheme](1)
    if scheme in SCHEMES:
        return SCHEMES[scheme](3 if stages is None else stages)
    known = ", ".join(f"'{name}'" for name in (*SCHEMES, *ONE_STAGE_NAMES))
    raise SchemeError(f"unknown scheme {scheme!r}; known are {known}, or pass a CollocationScheme.")
