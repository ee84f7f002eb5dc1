"""How one product is bounded, and the penalties that stand in for a bound; an object has one of the protocols."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expressions import choose
from pyrobocop_pyomo.numerics.rounding import ROUNDING


@runtime_checkable
class Relaxation(Protocol):
    """Rows ``residual(a, b, delta) <= 0`` that bound the products of pairs.

    Floats, arrays and Pyomo expressions all go through the same line, so a relaxation can be tested
    without a model and without a solver.
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive, for sides within their signs."""

    def shift(self, delta: Any) -> Any:
        """Return s(delta) if ``residual(a, b, delta) == residual(a, b, 0) - s(delta)``, else None.

        Such a row can follow delta inside a solve: only its bound moves, Jacobian and Hessian stay. And such
        residuals are added up over a group under one delta; of others, each product is bounded by itself.
        """


@runtime_checkable
class ObjectiveTerm(Protocol):
    """The penalty term ``coefficient(delta) * sum_l w_l * a_l * b_l`` of a minimised objective.

    A further member is optional:

    ``excess_bound`` : float
        With it the objective has the penalty term ``coefficient(delta) * t`` of one generated variable t,
        ``0 <= t <= excess_bound``. The object is a `Relaxation` as well, and its rows get t for delta.
    """

    def coefficient(self, delta: Any) -> Any:
        """Return the factor before the sum."""


class _WithoutShift:
    """What those relaxations share in which delta does more than move a bound."""

    def shift(self, delta: Any) -> None:
        """Return None."""
        return


@dataclass(frozen=True)
class Scholtes:
    """Bound the product: ``a * b <= delta``.

    At a solution where one side of each pair is positive, the relaxed solution is off by O(delta); at a biactive
    one, where both vanish, by O(sqrt(delta)).

    References
    ----------
    Scholtes (2001), Convergence properties of a regularization scheme for mathematical programs with
    complementarity constraints, SIAM J. Optim. 11, doi:10.1137/S1052623499361233
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - delta``."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return delta: the row ``a * b <= delta`` moves by delta itself."""
        return delta


@dataclass(frozen=True)
class SteffensenUlbrich(_WithoutShift):
    """Round off the corner: ``a + b <= phi(a - b)`` with ``phi(z) = |z|`` where ``|z| >= delta``.

    Between, ``phi(z) = (-z^4 / delta^3 + 6 z^2 / delta + 3 delta) / 8``: the polynomial kink of the paper, which meets
    ``|z|`` with two continuous derivatives. (Its other kink is a sine, with the same properties.)
    Where the sides differ by delta or more, the pair is met exactly; so the relaxed solution is exact as soon as
    delta is below the larger side of each pair, and off by O(delta) at a biactive solution.

    References
    ----------
    Steffensen & Ulbrich (2010), A new relaxation scheme for mathematical programs with equilibrium constraints,
    SIAM J. Optim. 20, doi:10.1137/090748883
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - phi(a - b)``."""
        z = a - b
        kink = (6 * z**2 / delta - z**4 / delta**3 + 3 * delta) / 8
        return a + b - choose(delta - abs(z), kink, abs(z))


@dataclass(frozen=True)
class KanzowSchwartz(_WithoutShift):
    """Bound the smaller side: ``phi(a - delta, b - delta) <= 0`` with a smooth phi, which says ``min(a, b) <= delta``.

    ``phi(p, q) = p * q`` where ``p + q >= 0`` and ``-(p^2 + q^2) / 2`` elsewhere, once continuously differentiable.
    Relaxed solutions are off by O(delta).

    References
    ----------
    Kanzow & Schwartz (2013), A new regularization method for mathematical programs with complementarity constraints
    with strong convergence properties, SIAM J. Optim. 23, doi:10.1137/100802487
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``phi(a - delta, b - delta)``."""
        p, q = a - delta, b - delta
        return choose(p + q, p * q, -(p**2 + q**2) / 2)


@dataclass(frozen=True)
class FischerBurmeister(_WithoutShift):
    """Bound ``a + b - sqrt(a^2 + b^2 + 2 delta)`` by zero.

    For ``a + b >= 0`` this says ``a * b <= delta``, as `Scholtes` does; the residual grows linearly in the sides and
    not with their product. The rates are those of `Scholtes`.

    References
    ----------
    Fischer (1992), A special Newton-type optimization method, Optimization 24:269-284;
    with delta: Kanzow (1996), Some noninterior continuation methods for linear complementarity problems,
    SIAM J. Matrix Anal. Appl. 17:851-868
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - sqrt(a^2 + b^2 + 2 delta)``."""
        return a + b - (a**2 + b**2 + 2 * delta) ** 0.5  # a power, since math.sqrt refuses expressions


@dataclass(frozen=True)
class ChenHarkerKanzowSmale(_WithoutShift):
    """Bound the smoothed natural residual ``a + b - sqrt((a - b)^2 + 4 delta)`` by zero.

    It is twice ``min(a, b)`` at ``delta = 0``. For ``a + b >= 0`` it says ``a * b <= delta``, as
    `Scholtes` does, but is nearly affine away from the corner. The rates are those of `Scholtes`.

    References
    ----------
    Chen & Harker (1993), A non-interior-point continuation method for linear complementarity problems,
    SIAM J. Matrix Anal. Appl. 14; Kanzow (1996), Some noninterior continuation methods for linear complementarity
    problems, SIAM J. Matrix Anal. Appl. 17:851-868
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a + b - sqrt((a - b)^2 + 4 delta)``."""
        return a + b - ((a - b) ** 2 + 4 * delta) ** 0.5


@dataclass(frozen=True)
class Penalty:
    """Penalise the products: add ``(1 / delta) * sum_l w_l * a_l * b_l`` to a minimised objective.

    The sides stay constraints, and nothing bounds a product. Near a solution that is strongly stationary the
    penalty is exact: the products vanish at some positive delta already, which need not go to zero. The
    weights w_l measure the pairs, so that a finer mesh does not count as more violation. Since the sides are not
    negative, the sum is the l1 norm of the products.

    References
    ----------
    Ralph & Wright (2004), Some properties of regularization and penalization schemes for MPECs,
    doi:10.1080/10556780410001709439
    """

    def coefficient(self, delta: Any) -> Any:
        """Return ``1 / delta``."""
        return 1 / delta


@dataclass(frozen=True)
class Elastic:
    """Bound all products by one variable with a penalty: ``a * b <= t`` and ``J + t / delta``.

    Here ``0 <= t <= excess_bound``: the penalty is the l-infinity norm of the products and not their sum. Near a
    strongly stationary solution it is exact: t vanishes at some positive delta already.

    Attributes
    ----------
    excess_bound : float
        Largest value of t; positive.

    References
    ----------
    Anitescu, Tseng & Wright (2007), Elastic-mode algorithms for mathematical programs with equilibrium constraints:
    global convergence and stationarity properties, Math. Program. 110, doi:10.1007/s10107-006-0005-4
    """

    excess_bound: float = 10.0

    def __post_init__(self) -> None:
        """Refuse a bound that leaves t no room."""
        if not self.excess_bound > 0:
            raise ComplementarityError(f"{self}: excess_bound must be positive.")

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - t``; the model passes t for delta."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return t, the bound of a product or of a sum of them."""
        return delta

    def coefficient(self, delta: Any) -> Any:
        """Return ``1 / delta``, the penalty coefficient of t."""
        return 1 / delta


RELAXATIONS: dict[str, Callable[[], Any]] = {
    "scholtes": Scholtes,
    "steffensen-ulbrich": SteffensenUlbrich,
    "kanzow-schwartz": KanzowSchwartz,
    "fischer-burmeister": FischerBurmeister,
    "chks": ChenHarkerKanzowSmale,
    "penalty": Penalty,
    "elastic": Elastic,
}


def as_relaxation(choice: str | Relaxation | ObjectiveTerm) -> Any:
    """Return the relaxation of a name such as "scholtes" or "penalty"; an object is returned as it is.

    Raises
    ------
    ValueError
        If it is neither a known name nor an object that can bound or penalise a product, or its shift is not what its
        residual changes by.
    """
    if isinstance(choice, str):
        name = choice.replace("_", "-")
        if name not in RELAXATIONS:
            raise ValueError(f"unknown relaxation {choice!r}. Known: {', '.join(map(repr, RELAXATIONS))}.")
        return RELAXATIONS[name]()
    if isinstance(choice, type) or not isinstance(choice, (Relaxation, ObjectiveTerm)):
        raise ValueError(
            f"{choice!r} is not a relaxation: it needs the methods residual(a, b, delta) and shift(delta), "
            "or coefficient(delta). Pass an object or a name."
        )
    if isinstance(choice, Relaxation):
        _refuse_wrong_shift(choice)
    return choice


def _refuse_wrong_shift(relaxation: Relaxation) -> None:
    """A row whose bound moves by something else than its residual would relax another set than it says."""
    a, b, delta = 0.5, 2.0, 0.25
    if (shift := relaxation.shift(delta)) is None:
        return
    changed = relaxation.residual(a, b, 0.0) - relaxation.residual(a, b, delta)
    if not math.isclose(changed, shift, rel_tol=ROUNDING):
        raise ValueError(
            f"{relaxation!r}: shift({delta}) is {shift}, but from delta = 0 to {delta} residual({a}, {b}, delta) falls "
            f"by {changed}. Return what it falls by, whatever a and b are, or None."
        )
