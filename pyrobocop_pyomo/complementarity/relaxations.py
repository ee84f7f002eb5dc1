"""How one product is bounded, and the penalties that stand in for a bound; an object has one of the protocols.

Which products share a bound: each has its own, or all products of an element have one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import Any, Protocol, runtime_checkable

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expressions import choose
from pyrobocop_pyomo.numerics.rounding import ROUNDING

from .forms import CanonicalPair


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
    not with their product. The rates are the same as with `Scholtes`.

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
    `Scholtes` does, but is nearly affine away from the corner. The rates are the same as with `Scholtes`.

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


# ------------------------------------------------------------------------------------------------------------ groupings


@runtime_checkable
class Grouping(Protocol):
    """Decides which pairs are relaxed together, and which products they form.

    One further member is optional:

    ``products(pairs)``
        The products of one group, each with a bound of its own, as tuples: a of the first pair times b of the second
        one. By default each pair is a product, and all of them share one bound.
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """Split the pairs into named lists; every pair comes once."""


@dataclass(frozen=True)
class PerPair:
    """Each product has a row of its own: ``a_l * b_l <= delta`` for each pair l."""

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per pair."""
        return [(None, [pair]) for pair in pairs]


@dataclass(frozen=True)
class PerElement:
    """The products of one element share a row: ``sum_l a_l * b_l <= delta``.

    The sum is bounded by delta itself and not by a multiple that grows with the number of pairs, so the bound
    on a single product is never looser than with `PerPair`.

    An element is what carries the same group label in the same block. A pair without a label belongs with the
    other unlabelled pairs of its block that have its index: in a block that is indexed by time, all pairs of
    that time.

    References
    ----------
    Raghunathan, Jha & Romeres (2022), PyRoboCOP, doi:10.48550/arXiv.2203.10013
    """

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per block and label, in the order of the first pair of each."""
        name = cache(attrgetter("name"))

        def label(pair: CanonicalPair) -> str:
            # A label and an index may be equal numbers and yet mean different things: keep them apart.
            own = f"index {pair.source.index()!r}" if pair.group is None else f"group {pair.group!r}"
            return f"{name(pair.source.parent_block())}, {own}"

        return _collected(pairs, label)


@dataclass(frozen=True)
class Crossed:
    """Every a of an element is complementary to every b of it: products ``a_i * b_j`` over its stages i and j.

    With several stages per element it keeps switches from happening inside an element: a side that is positive at
    one stage has a partner that is zero at all of them. Only pairs that state the same are crossed: the pairs of one
    family in one `Complementarity` component. In a phase that is the pairs at one position (or with one key) of
    what the rule returns; elsewhere, the pairs whose indices differ in the first part alone, unless ``family=`` says
    otherwise. An element is what carries the same group label; pairs without a label are elements of their own. The
    sides are taken as they are declared: the first ones with the second ones.

    Attributes
    ----------
    left_end : {None, "first", "second"} or callable
        Which side, if any, counts at the left end of an element as well, or a function that tells which of a pair:
        its value at the last pair of the element
        before stands beside the sides of the element's own stages. It has to be the side that is continuous in time (a
        distance, not the force that jumps), and the last stage has to be the end of the element, as it is for Radau
        and Lobatto. So no element can begin on one side of a switch and end on the other, and with moving boundaries
        these are where the switches are. Elements are then numbered by their labels, one by one; one whose
        predecessor has no pair, as the first of a phase, has no left end.

    References
    ----------
    Nurkanovic, Sperl, Albrecht & Diehl (2024), Finite elements with switch detection for direct optimal control of
    nonsmooth systems, doi:10.1007/s00211-024-01412-z
    """

    left_end: str | Callable[[CanonicalPair], str | None] | None = None

    def __post_init__(self) -> None:
        """Refuse unknown values."""
        if not callable(self.left_end) and self.left_end not in (None, "first", "second"):
            raise ComplementarityError(f"{self}: left_end is None, 'first' or 'second'.")

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
        """One group per family, role and element, in the order of the first pair of each.

        With left ends, the elements of a family form one group, since their products overlap.
        """
        name = cache(attrgetter("name"))

        def family(pair: CanonicalPair) -> Hashable:
            if pair.group is None:
                key: tuple[Hashable, ...] = ("index", pair.source.index())
            elif self._left_end_of(pair) is None:
                key = ("group", pair.group, pair.source.family)
            else:
                self._check_number(pair)
                key = ("family", pair.source.family)
            return (name(pair.source.parent_component()), *key, pair.role)

        return _collected(pairs, family)

    def products(self, pairs: Sequence[CanonicalPair]) -> list[tuple[CanonicalPair, CanonicalPair]]:
        """The products of a family, element by element."""
        left_end = self._left_end_of(pairs[0])
        if left_end is None or pairs[0].group is None:
            return list(itertools.product(pairs, pairs))
        # Targets come in any order: back to the order in which the component has them.
        positions = {index: n for n, index in enumerate(pairs[0].source.parent_component().keys())}
        elements: dict[Any, list[CanonicalPair]] = {}
        for pair in sorted(pairs, key=lambda pair: positions[pair.source.index()]):
            elements.setdefault(pair.group, []).append(pair)
        factors: list[tuple[CanonicalPair, CanonicalPair]] = []
        for number, members in elements.items():
            longer = [*elements.get(number - 1, [])[-1:], *members]
            factors += itertools.product(*((longer, members) if left_end == "first" else (members, longer)))
        return factors

    def _left_end_of(self, pair: CanonicalPair) -> str | None:
        return self.left_end(pair) if callable(self.left_end) else self.left_end

    def _check_number(self, pair: CanonicalPair) -> None:
        if not isinstance(pair.group, int):
            raise ComplementarityError(
                f"'{pair.name}': its group label is {pair.group!r}, and {self} looks for the element before by number. "
                "Number the elements, as phases do: group= gives 0, 1, 2, ..."
            )


def _collected(
    pairs: Sequence[CanonicalPair], key: Callable[[CanonicalPair], Hashable]
) -> list[tuple[Hashable | None, list[CanonicalPair]]]:
    """Pairs of one key together, in the order of the first pair of each."""
    found: dict[Hashable | None, list[CanonicalPair]] = {}
    for pair in pairs:
        found.setdefault(key(pair), []).append(pair)
    return list(found.items())


GROUPINGS: dict[str, type] = {"pair": PerPair, "element": PerElement, "crossed": Crossed}


def as_grouping(choice: str | Grouping) -> Grouping:
    """Return the grouping of a name such as "pair" or "element"; an object is returned as it is.

    Raises
    ------
    ValueError
        If it is neither a known name nor an object with a method ``groups(pairs)``.
    """
    if isinstance(choice, str):
        if choice not in GROUPINGS:
            raise ValueError(f"unknown grouping {choice!r}. Known: {', '.join(map(repr, GROUPINGS))}.")
        return GROUPINGS[choice]()
    if isinstance(choice, type) or not isinstance(choice, Grouping):
        raise ValueError(f"{choice!r} is not a grouping: it needs a method groups(pairs). Pass an object or a name.")
    return choice
