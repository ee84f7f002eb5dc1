"""The protocols of relaxations; an object has the methods of those that it needs."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Relaxation(Protocol):
    """Rows ``residual(a, b, delta) <= 0`` that bound the products of pairs.

    Floats, arrays and Pyomo expressions all go through the same line, so a relaxation can be tested
    without a model and without a solver.
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive, for sides within their signs."""
        ...

    def shift(self, delta: Any) -> Any:
        """Return s(delta) if ``residual(a, b, delta) == residual(a, b, 0) - s(delta)``, else None.

        Such a row can follow delta inside a solve: only its bound moves, Jacobian and Hessian stay. And such
        residuals are added up over a group under one delta; of others, each product is bounded by itself.
        """
        ...


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
        ...
