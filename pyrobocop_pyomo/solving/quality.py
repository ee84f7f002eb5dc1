"""How good a point is."""

from __future__ import annotations

import enum


class Quality(enum.Enum):
    """How good the returned point is, by residuals that were recomputed; the value is a sentence."""

    OPTIMAL = "Feasible and stationary, and every pair is complementary, within the tolerances."
    FEASIBLE = "Feasible, and every pair is complementary, but the point is not shown to be stationary."
    INFEASIBLE = "Constraints or complementarity are violated beyond the tolerances."
