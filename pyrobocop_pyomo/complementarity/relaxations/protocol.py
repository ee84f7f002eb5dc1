"""The protocols of relaxations; an object has the methods of those that it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Relaxation(Protocol):
    """Rows ``residual(a, b, delta) <= 0`` that bound the products of pairs.

    Floats, arrays and Pyomo expressions all go through the same line, so a relaxation can be tested
    without a model and without a solver. Three further members are optional:

    ``equality`` : bool
        True when the row is ``residual(a, b, delta) == 0``; default False.
    ``further_residuals(a, b, delta)`` : tuple
        Further expressions that must not be positive; default none.
    ``side_slack(delta)``
        How far below zero a side may fall, or None when no row is to keep its sign; default 0. A bound that the
        user put on a variable is never touched: where it keeps the sign already, it keeps it exactly.
    """

    def residual(self, a: Any, b: Any, delta: Any) -> Any:
        """Return what must not be positive, for sides within their signs."""
        ...

    def shift(self, delta: Any) -> Any:
        """Return s(delta) if ``residual(a, b, delta) == residual(a, b, 0) - s(delta)``, else None.

        Such a row can follow delta inside a solve: only its bound moves, Jacobian and Hessian stay. And such
        residuals are added up over a group under one delta; of others, each product gets a share of delta.
        """
        ...


@runtime_checkable
class ObjectiveTerm(Protocol):
    """The penalty term ``coefficient(delta) * sum_l w_l * a_l * b_l`` of a minimised objective.

    Two further members are optional:

    ``penalty(product, multiplier)``
        Replaces the product in the sum; it comes with `next_multiplier`.
    ``excess_bound`` : float
        With it the objective has the penalty term ``coefficient(delta) * t`` of one generated variable t,
        ``0 <= t <= excess_bound``. The object is a `Relaxation` as well, and its rows get t for delta.
    """

    def coefficient(self, delta: Any) -> Any:
        """Return the factor before the sum."""
        ...


@runtime_checkable
class KeepsMultipliers(Protocol):
    """An objective term with a number for each product that is updated after each solve."""

    def penalty(self, product: Any, multiplier: Any) -> Any:
        """Return the penalty of one product, before the coefficient."""
        ...

    def next_multiplier(self, multiplier: float, product: float, delta: float, next_delta: float) -> float:
        """Return the number for the solve with `next_delta`, given the product after the one with `delta`."""
        ...


@runtime_checkable
class KeepsBounds(Protocol):
    """A relaxation with a bound for each row and a slack for each side, updated after each solve."""

    def next_bound(self, bound: float, delta: float, products: list[tuple[float, float]], multiplier: float) -> float:
        """Return the bound of a row for the solve with `delta`, given the values of its sides and its multiplier."""
        ...

    def next_slack(self, slack: float, delta: float, side: float, partner: float, multiplier: float) -> float:
        """Return how far a side may be negative in the solve with `delta`."""
        ...


@dataclass(frozen=True)
class Abilities:
    """What a relaxation can do. It is evaluated once: a check of the protocols for each pair would be slow.

    Attributes
    ----------
    equality : bool
        Its rows are equalities.
    several_rows : bool
        A product has further rows.
    has_penalty : bool
        It adds a term to the objective.
    penalises_products : bool
        The term holds the products themselves.
    keeps_multipliers, keeps_bounds : bool
        It has numbers that are updated between solves.
    shifts : bool
        delta moves the bounds of the rows and nothing else of the model.
    """

    equality: bool
    several_rows: bool
    has_penalty: bool
    penalises_products: bool
    keeps_multipliers: bool
    keeps_bounds: bool
    shifts: bool

    @classmethod
    def of(cls, relaxation: Any, delta: Any) -> Abilities:
        """Ask a relaxation; `delta` is the parameter of the model."""
        penalty = isinstance(relaxation, ObjectiveTerm)
        several = hasattr(relaxation, "further_residuals")
        keeps_bounds = isinstance(relaxation, KeepsBounds)
        elsewhere = penalty or several or keeps_bounds or hasattr(relaxation, "side_slack")
        return cls(
            equality=bool(getattr(relaxation, "equality", False)),
            several_rows=several,
            has_penalty=penalty,
            penalises_products=penalty and not hasattr(relaxation, "excess_bound"),
            keeps_multipliers=isinstance(relaxation, KeepsMultipliers),
            keeps_bounds=keeps_bounds,
            shifts=not elsewhere and isinstance(relaxation, Relaxation) and relaxation.shift(delta) is not None,
        )


def side_slack(relaxation: Any, delta: Any) -> Any:
    """How far a side may be negative; None when nothing keeps its sign."""
    slack = getattr(relaxation, "side_slack", None)
    return 0 if slack is None else slack(delta)
