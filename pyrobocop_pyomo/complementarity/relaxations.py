"""How one product is bounded, and the penalty that stands in for a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Relaxation(Protocol):
    """What bounds the pairs of a group by rows ``residual(a, b, delta) <= 0``.

    Floats, arrays and Pyomo expressions all go through the same line, so a relaxation can be tested
    without a model and without a solver.
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive, for ``a, b >= 0``."""
        ...

    def shift(self, delta: Any) -> Any:
        """Return s(delta) if ``residual(a, b, delta) == residual(a, b, 0) - s(delta)``, else None.

        Such a row can follow delta inside a solve: only its bound moves, Jacobian and Hessian stay. And only
        such residuals can be added up over a group under one delta.
        """
        ...


@runtime_checkable
class ObjectiveTerm(Protocol):
    """What adds a term to the objective instead of rows to the model."""

    def coefficient(self, delta: Any) -> Any:
        """Return the factor before the weighted sum of products in a minimised objective."""
        ...


@dataclass(frozen=True)
class Scholtes:
    """Bound the product: ``a * b <= delta``.

    References
    ----------
    Scholtes (2001), Convergence properties of a regularization scheme for mathematical programs with
    complementarity constraints, doi:10.1137/S1052623499361233
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return ``a * b - delta``."""
        return a * b - delta

    def shift(self, delta: Any) -> Any:
        """Return delta: the row ``a * b <= delta`` moves by delta itself."""
        return delta


@dataclass(frozen=True)
class Penalty:
    """Charge the products: add ``(1 / delta) * sum_l w_l * a_l * b_l`` to a minimised objective.

    The sides stay constraints, and nothing bounds a product. Near a solution that is strongly stationary the
    penalty is exact: the products vanish at some positive delta already, which need not go to zero. The
    weights w_l measure the pairs, so that a finer mesh does not count as more violation.

    References
    ----------
    Ralph & Wright (2004), Some properties of regularization and penalization schemes for MPECs,
    doi:10.1080/10556780410001709439
    """

    def coefficient(self, delta: Any) -> Any:
        """Return ``1 / delta``."""
        return 1 / delta


RELAXATIONS: dict[str, type] = {"scholtes": Scholtes, "penalty": Penalty}


def as_relaxation(choice: str | Relaxation | ObjectiveTerm) -> Relaxation | ObjectiveTerm:
    """Turn "scholtes", "penalty" or a relaxation object into the object.

    Raises
    ------
    ValueError
        If it is neither a known word nor an object that can bound or charge a product.
    """
    if isinstance(choice, str):
        if choice not in RELAXATIONS:
            raise ValueError(f"unknown relaxation {choice!r}. Known: {', '.join(map(repr, RELAXATIONS))}.")
        return RELAXATIONS[choice]()
    if isinstance(choice, type) or not isinstance(choice, (Relaxation, ObjectiveTerm)):
        raise ValueError(
            f"{choice!r} is no relaxation: it needs the methods residual(a, b, delta) and shift(delta), "
            "or coefficient(delta). Pass an object or a word."
        )
    return choice
