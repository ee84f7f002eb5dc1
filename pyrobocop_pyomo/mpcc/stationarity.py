"""Kinds of stationary points of a complementarity problem, and the multipliers that show them."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray


class Stationarity(enum.Enum):
    """Kinds of stationary points, strongest first; the value is a sentence.

    With the Lagrangian ``f + multipliers @ g - nu @ a - xi @ b`` and nu, xi the multipliers of the two sides, every
    kind asks that nu vanish where a > 0 and xi where b > 0. They differ at biactive pairs, where a = b = 0.

    References
    ----------
    Scheel & Scholtes (2000), Mathematical programs with complementarity constraints: stationarity, optimality, and
    sensitivity, Math. Oper. Res. 25, doi:10.1287/moor.25.1.1.15213
    """

    S = "Strongly stationary: nu >= 0 and xi >= 0 at every biactive pair, so no direction descends."
    M = "M-stationary: at every biactive pair nu and xi are both positive, or one of them is zero."
    C = "C-stationary: nu * xi >= 0 at every biactive pair."
    A = "A-stationary: nu >= 0 or xi >= 0 at every biactive pair."
    W = "Weakly stationary: there are multipliers, but not with the signs of a stronger kind."
    NONE = "Not stationary: there are no multipliers."


@dataclass(frozen=True, eq=False)
class Multipliers(Presented):
    """Multipliers of the strongest kind of stationarity, or the nearest to weak stationarity where there are none.

    Attributes
    ----------
    kind : Stationarity
    nu, xi : float array, shape (k,)
        Of the sides a and b, in the units of the objective per unit of the side: by how much the minimised objective
        grows where the side is held at a small positive number instead of zero.
    rows : float array, shape (m,)
        Of the rows; positive where an upper bound holds back, negative where a lower one does.
    residual : float
        What they leave of the stationarity conditions, relative to the objective's gradient.
    """

    kind: Stationarity
    nu: FloatArray
    xi: FloatArray
    rows: FloatArray
    residual: float

    def _summary(self) -> str:
        return f"{self.kind.value}, residual {self.residual:.1e}, {len(self.nu)} pairs"
