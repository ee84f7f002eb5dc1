"""Shares as people write them."""

from __future__ import annotations

import math
from decimal import Decimal

# What is smaller is not worth more digits.
SMALLEST = 1e-9


def percent(share: float) -> str:
    """A share as people write it: "13 %", "0.02 %", "below 1e-7 %"."""
    if not math.isfinite(share):
        return "not known"
    if share <= SMALLEST:
        return "below 1e-7 %"
    value = 100 * share
    return f"{value:.0f} %" if value >= 1 else f"{Decimal(f'{value:.1g}'):f} %"
