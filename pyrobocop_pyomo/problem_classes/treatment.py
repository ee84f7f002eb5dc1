"""PyRoboCOP's options for scheme and complementarity, in the words of this package."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier
from pyrobocop_pyomo.errors import ProblemClassError
from pyrobocop_pyomo.numerics import Scheme, find_scheme

_ROOTS = {"radau": "radau", "legendre": "gauss", "explicit": "explicit_euler"}
_SMALLEST_DELTA = 1e-6  # below which an adaptive delta does not go in PyRoboCOP


def scheme_of(ncolloc: int, roots: str) -> Scheme:
    """The scheme that a number of points and a word for their kind mean.

    Raises
    ------
    ProblemClassError
    """
    if roots not in _ROOTS:
        raise ProblemClassError(f"roots = {roots!r}; known are {', '.join(map(repr, _ROOTS))}.")
    if isinstance(ncolloc, bool) or int(ncolloc) != ncolloc or ncolloc < 1:
        raise ProblemClassError(f"ncolloc = {ncolloc!r}; expected the number of points per element, at least 1.")
    if roots == "explicit":
        if ncolloc != 1:
            raise ProblemClassError(
                f"ncolloc = {ncolloc} with roots = 'explicit', which is explicit Euler: ncolloc = 1."
            )
        return find_scheme("explicit_euler")
    return find_scheme(_ROOTS[roots], int(ncolloc))


def solve_options_of(compl: int | None, compladapt: int | None, compleps: float | None, pairs: int) -> dict[str, Any]:
    """Keyword arguments of `solve` for what was asked; none where nothing was.

    Raises
    ------
    ProblemClassError
        When a choice is unknown.
    """
    if compl not in (None, 0, 1, 2):
        raise ProblemClassError(f"compl = {compl!r}; expected 0 (each pair), 1 (their sum per element) or 2 (penalty).")
    if compladapt not in (None, 0, 1):
        raise ProblemClassError(
            f"compladapt = {compladapt!r}; expected 0 (fixed) or 1 (follows the barrier parameter)."
        )
    if compleps is not None and not 0 < compleps < float("inf"):
        raise ProblemClassError(f"compleps = {compleps!r}; expected a positive number.")
    if compl is None and compladapt is None and compleps is None:
        return {}
    together = compl == 1
    share = max(pairs, 1) if together else 1  # PyRoboCOP bounds the sum by as many deltas
    if compladapt and compl != 2:
        schedule: Any = FollowBarrier(floor=_SMALLEST_DELTA * share, factor=float(share))
    else:
        schedule = Fixed((1e-4 if compleps is None else compleps) * share)
    return {
        "relaxation": "penalty" if compl == 2 else "scholtes",
        "grouping": "element" if together else "pair",
        "schedule": schedule,
    }
