"""Discontinuous functions, stated with complementarity: the Heaviside step, and Stewart's convex combination of modes.

At a discontinuity Filippov's convention holds: the step may take any value between 0 and 1, and on a surface that
attracts from both sides it takes the one value that keeps the motion there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pyrobocop_pyomo as rcp

Rule = Callable[[Any, float], Any]


def add_pair(b: rcp.PhaseBlock, name: str, continuous: Rule, other: Rule) -> None:
    """State ``0 <= continuous ⟂ other >= 0`` as a component of its own."""

    def pair(b, t):
        return rcp.complements(continuous(b, t) >= 0, other(b, t) >= 0)

    pair.__name__ = name
    b.complementarity(pair)


def add_step(b: rcp.PhaseBlock, name: str, switching: Rule, initial_guess: float = 0.5) -> None:
    """Declare ``b.<name>[t]``: 1 where ``switching(b, t) > 0``, 0 where it is negative, anything between at zero.

    The step is the solution of ``min -psi w`` over ``0 <= w <= 1``; the multipliers of the two bounds are the
    positive and the negative part of psi.

    References
    ----------
    Nurkanović, Frey, Pozharskiy & Diehl, Finite Elements with Switch Detection for Direct Optimal Control of Nonsmooth
    Systems with Set-Valued Step Functions (2023), doi:10.48550/arXiv.2303.18066
    """
    above, below = f"{name}_above", f"{name}_below"
    b.declare(name, rcp.Algebraic(bounds=(0, 1), initial_guess=initial_guess))
    b.declare(above, rcp.Algebraic(bounds=(0, None)))
    b.declare(below, rcp.Algebraic(bounds=(0, None)))

    def parts(b, t):
        return switching(b, t) == getattr(b, above)[t] - getattr(b, below)[t]

    parts.__name__ = f"{name}_parts"
    b.residual(parts)
    add_pair(b, f"{name}_on", lambda b, t: getattr(b, above)[t], lambda b, t: 1 - getattr(b, name)[t])
    add_pair(b, f"{name}_off", lambda b, t: getattr(b, below)[t], lambda b, t: getattr(b, name)[t])


def add_modes(b: rcp.PhaseBlock, name: str, indicators: Sequence[Rule]) -> None:
    """Declare ``b.<name>_<i>[t]``: shares, summing up to one, of the modes whose indicator is the smallest.

    The shares are the solution of ``min sum g_i theta_i`` over the simplex: mode i is active where ``g_i`` is the
    smallest of the indicators, and the regions meet where two are equal.

    References
    ----------
    Stewart, A high accuracy method for solving ODEs with discontinuous right-hand side, Numer. Math. 58 (1990),
    doi:10.1007/BF01385627
    """
    shares = [f"{name}_{i}" for i in range(len(indicators))]
    excesses = [f"{name}_excess_{i}" for i in range(len(indicators))]
    smallest = f"{name}_smallest"
    for share, excess in zip(shares, excesses, strict=True):
        b.declare(share, rcp.Algebraic(bounds=(0, 1), initial_guess=1 / len(indicators)))
        b.declare(excess, rcp.Algebraic(bounds=(0, None)))
    b.declare(smallest, rcp.Algebraic())

    def simplex(b, t):
        return [
            *(
                indicator(b, t) == getattr(b, smallest)[t] + getattr(b, excess)[t]
                for indicator, excess in zip(indicators, excesses, strict=True)
            ),
            sum(getattr(b, share)[t] for share in shares) == 1,
        ]

    simplex.__name__ = f"{name}_simplex"
    b.residual(simplex)
    for share, excess in zip(shares, excesses, strict=True):
        add_pair(b, f"{share}_chosen", lambda b, t, e=excess: getattr(b, e)[t], lambda b, t, s=share: getattr(b, s)[t])
