"""Results as text: tables of pairs, and the long report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pyrobocop_pyomo.motion import SafetyReport
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Multipliers

from .pair_report import ActiveSide, PairReport

CLEAR_START = (
    "There may be none. Otherwise start from a clear one: rcp.scenes.waypoint_initial_guess, sampled_path (arms) or "
    "hybrid_a_star (cars), or rcp.studies.multistart."
)


def pair_table(pairs: Sequence[PairReport], most: int | None = None) -> str:
    """A line per pair; beyond `most` lines, the number of those left out."""
    shown = list(pairs) if most is None else list(pairs[:most])
    width = max([len("pair"), *(len(pair.name) for pair in shown)])
    lines = [
        f"{'pair':<{width}} {'first':>12} {'second':>12} {'product':>9} {'min':>9}  {'zero':<8} "
        f"{'mult. first':>12} {'mult. second':>12}"
    ]
    lines += [
        f"{pair.name:<{width}} {pair.first:>12.6g} {pair.second:>12.6g} {pair.product:>9.1e} {pair.natural:>9.1e}  "
        f"{pair.active.value:<8} {_number(pair.first_multiplier):>12} {_number(pair.second_multiplier):>12}"
        for pair in shown
    ]
    if len(shown) < len(pairs):
        lines.append(f"... and {len(pairs) - len(shown)} more")
    return "\n".join(lines)


def component_table(pairs: Sequence[PairReport]) -> str:
    """A line per component: how many of its pairs have which side at zero, and the largest residual."""
    groups: dict[str, list[PairReport]] = {}
    for pair in pairs:
        groups.setdefault(pair.component, []).append(pair)
    width = max([len("component"), *map(len, groups)])
    words = [side.value for side in ActiveSide]
    lines = [f"{'component':<{width}} {'pairs':>6} {' '.join(f'{word:>8}' for word in words)} {'max |min|':>9}"]
    for name, members in groups.items():
        counts = Counter(pair.active for pair in members)
        numbers = " ".join(f"{counts[side]:>8}" for side in ActiveSide)
        lines.append(f"{name:<{width}} {len(members):>6} {numbers} {max(abs(pair.natural) for pair in members):>9.1e}")
    return "\n".join(lines)


def pair_sentence(pairs: Sequence[PairReport], multipliers: Multipliers | None, certificate: Certificate) -> str:
    """How many pairs, which sides are zero, and what is certified, in one line."""
    counts = Counter(pair.active for pair in pairs)
    sides = ", ".join(f"{counts[side]} {side.value}" for side in ActiveSide if counts[side])
    kind = "" if multipliers is None else f"; {multipliers.kind.value.partition(':')[0]}"
    return f"{len(pairs)} pairs (zero side: {sides}){kind}; {certificate.value}"


def advice_on_motion(safety: SafetyReport) -> str:
    """What a motion that is not safe lacks, and what may help."""
    if safety.safe:
        return "The motion keeps its clearances, but violates other constraints."
    if safety.is_settled:
        return f"The plan keeps its clearances, and what its equations make of it may not. {safety.equations}"
    closest = (
        f"No motion was found that keeps its clearances. In the closest one {safety.worst} (in the model's units)."
    )
    return f"{closest} {CLEAR_START}"


def long_report(
    summary: str,
    pairs: Sequence[PairReport],
    multipliers: Multipliers | None,
    certificate: Certificate,
    decided: int,
    worst: int,
) -> str:
    """Everything that is known about a result.

    Parameters
    ----------
    summary : str
        The short text.
    pairs : sequence of PairReport
    multipliers : Multipliers or None
    certificate : Certificate
    decided : int
        Pairs that bounds had decided.
    worst : int
        How many pairs to show in each list.
    """
    if not pairs:
        return summary
    kind = "not examined" if multipliers is None else multipliers.kind.value
    parts = [
        summary,
        component_table(pairs),
        f"Decided beforehand by bounds and fixed variables: {decided} of {len(pairs)} pairs.\n"
        f"Stationarity: {kind}\nCertificate: {certificate.value}",
        _worst(pairs, worst),
    ]
    biactive = [pair for pair in pairs if pair.active is ActiveSide.BIACTIVE]
    if biactive:
        parts.append("Biactive pairs, both sides zero:\n" + pair_table(biactive, worst))
    if multipliers is not None:
        cheapest = [pair for pair in pairs if _least_multiplier(pair) < 0.0]
        if cheapest:
            parts.append(
                "Pairs whose zero side would gain most by leaving zero, by multiplier:\n"
                + pair_table(sorted(cheapest, key=_least_multiplier)[:worst])
            )
    return "\n\n".join(parts)


def _worst(pairs: Sequence[PairReport], most: int) -> str:
    if not any(pair.natural for pair in pairs):
        return "All pairs are met exactly."
    ordered = sorted(pairs, key=lambda pair: -abs(pair.natural))[:most]
    return "Worst pairs, by |min(first, second)|:\n" + pair_table(ordered)


def _least_multiplier(pair: PairReport) -> float:
    return min(pair.first_multiplier or 0.0, pair.second_multiplier or 0.0)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"
