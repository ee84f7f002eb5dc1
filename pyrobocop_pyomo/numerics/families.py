"""The named families of schemes, and finding one by the words that a user types."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.optional_imports import scipy

from .schemes import Scheme


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


def explicit(stages: int) -> Scheme:
    """Explicit Runge-Kutta methods of order one to three: Euler, midpoint, Heun's third-order method.

    For coarse rollouts: each stage depends on the ones before it only, so a forward pass solves the rows.

    References
    ----------
    Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, sec. II.1, table 1.1,
    doi:10.1007/978-3-540-78862-1
    """
    _check_stages("explicit", stages)
    tableaux = {
        1: ([[0.0]], [1.0]),
        2: ([[0.0, 0.0], [0.5, 0.0]], [0.0, 1.0]),
        3: ([[0.0, 0.0, 0.0], [1 / 3, 0.0, 0.0], [0.0, 2 / 3, 0.0]], [0.25, 0.0, 0.75]),
    }
    if stages not in tableaux:
        raise ModelError(
            f"explicit: stages = {stages}; there are one to three. With four, order four needs a stage at the element "
            "end beside the end value itself. Use radau or gauss for higher orders."
        )
    A, b = (np.array(coefficients) for coefficients in tableaux[stages])
    return Scheme(f"explicit({stages})", A=A, b=b, c=A.sum(axis=1))


def _check_stages(name: str, stages: int, least: int = 1) -> None:
    if isinstance(stages, bool) or not isinstance(stages, (int, np.integer)) or stages < least:
        raise ModelError(f"{name}: stages = {stages!r}; expected an integer of at least {least}.")


# Further names for the same thing are welcome here: a user types the one that the field taught them.
FAMILIES: dict[str, Callable[[int], Scheme]] = {
    "radau": radau,
    "gauss": gauss_legendre,
    "legendre": gauss_legendre,
    "lobatto": lobatto,
    "explicit": explicit,
}

SINGLE_SCHEMES: dict[str, tuple[Callable[[int], Scheme], int]] = {
    "implicit_euler": (radau, 1),
    "implicit_midpoint": (gauss_legendre, 1),
    "trapezoid": (lobatto, 2),
    "hermite_simpson": (lobatto, 3),
    "explicit_euler": (explicit, 1),
}


def find_scheme(scheme: str | Scheme, stages: int | None = None) -> Scheme:
    """The scheme that a user's words name.

    Parameters
    ----------
    scheme : str or Scheme
        A family with a number of ``stages``: ``"radau"``, ``"gauss"`` (also ``"legendre"``), ``"lobatto"``,
        ``"explicit"``; a single scheme: ``"implicit_euler"``, ``"implicit_midpoint"``, ``"trapezoid"``,
        ``"hermite_simpson"``, ``"explicit_euler"``; or a scheme object, taken as it is.
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
        family, own = SINGLE_SCHEMES[scheme]
        made = family(own)
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
