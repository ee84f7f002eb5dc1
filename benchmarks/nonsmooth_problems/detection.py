"""Switches that can only happen at element boundaries: pairs of sums over an element, in place of a pair per point.

With ``a_0, ..., a_s`` the continuous side of a pair on an element (a distance to a surface, a gap), its left end
included, and ``b_1, ..., b_s`` the other side (a share, a force) at its stages, the one pair

    0 <= a_0 + ... + a_s  ⟂  b_1 + ... + b_s >= 0

says that all products ``a_i b_j`` vanish: no element has a mode at one point and another mode at another. Where the
boundaries may move, they move to the switches, and the scheme keeps its order; on a fixed mesh the switches have to
happen at its boundaries.

Nurkanović, Sperl, Albrecht & Diehl, Finite Elements with Switch Detection for direct optimal control of nonsmooth
systems, Numer. Math. 156 (2024), doi:10.1007/s00211-024-01412-z
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# How much narrower and wider an element may become to meet a switch.
MOVING = (0.2, 3.0)


def detect_switches(m: pyo.ConcreteModel, at_start: Mapping[tuple[str, int | None], Any] | None = None) -> None:
    """Replace the pairs of ``m.phase``, whose first side has to be the continuous one, by pairs of sums per element.

    The pairs at the points stay on the phase, inactive: a trajectory is still verified by them.

    Parameters
    ----------
    m : ConcreteModel
        With a phase of a stiffly accurate scheme, ``m.phase``.
    at_start : mapping, optional
        The continuous side at the start of the phase, by the rule's name and the position of the pair in its answer;
        needed where a switch may happen before the first stage.
    """
    families: dict[tuple, list] = {}
    for pair in rcp.active_pairs(m):
        index = pair.source.index()
        label = index[1] if isinstance(index, tuple) else None
        families.setdefault((pair.source.parent_component().local_name, label), []).append(pair)
    m.side_rows = pyo.ConstraintList()
    sums = {}
    for family, pairs in families.items():
        known = (at_start or {}).get(family)
        first = [] if known is None else [known]
        for element, group in groupby(pairs, key=lambda pair: pair.group):
            here = list(group)
            sums[(*map(str, family), element)] = (
                sum(first) + sum(pair.a for pair in here),
                sum(pair.b for pair in here),
            )
            first = [here[-1].a]  # a stiffly accurate scheme has its last stage at the boundary
    for pair in (pair for pairs in families.values() for pair in pairs):
        for row in (pair.a_row, pair.b_row):
            if row is not None:
                m.side_rows.add(row)
        pair.source.deactivate()
    m.switches = rcp.Complementarity(
        list(sums), rule={index: rcp.complements(a >= 0, b >= 0) for index, (a, b) in sums.items()}
    )
