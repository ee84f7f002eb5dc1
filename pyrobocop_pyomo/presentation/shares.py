"""Shares as people write them."""

from __future__ import annotations

import math

# What is smaller is not worth more digits.
SMALLEST = 1e-9


def percent(share: float) -> str:
    """A share as people write it: "0.02 %", "below 1e-7 %"."""
    if not math.isfinite(share):
        return "not known"
    return f"{100 * share:.1g} %" if share > SMALLEST else f"below {100 * SMALLEST:.0e} %"
