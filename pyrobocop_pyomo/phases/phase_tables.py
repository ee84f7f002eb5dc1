"""A phase at a glance: what was declared and stated on it, in one line and as tables for notebooks."""

from __future__ import annotations

from collections import Counter
from typing import Any

from pyrobocop_pyomo.presentation import facts_table, table

from .declarations import Declaration
from .record import PhaseRecord


def phase_in_words(record: PhaseRecord) -> str:
    """Counts of the declarations by kind, and the grid."""
    kinds = Counter(type(declaration).__name__.lower() for declaration in record.declarations.values())
    counts = [f"{count} {kind}{'s' if count != 1 else ''}" for kind, count in kinds.items()]
    return f": {', '.join([*counts, f'{record.grid.mesh.elements} elements'])} of {record.grid.scheme.name}"


def phase_tables(record: PhaseRecord) -> list[str]:
    """Two tables: the declarations with bounds, ends and units; the rules by kind, the duration and the grid."""
    members = {member for family in record.families.values() for member in family.members}
    rows = [_row(name, of) for name, of in record.declarations.items() if name not in members]
    for name, family in record.families.items():
        first = record.declarations[family.members[0]]
        rows.append((f"{name}, shape {family.shape}", type(first).__name__.lower(), "", "", "", _units(first)))
    kinds = dict.fromkeys(statement.kind for statement in record.statements)
    facts: dict[str, object] = {
        "duration": _shown(record.duration),
        "grid": f"{record.grid.mesh.elements} elements of {record.grid.scheme.name}",
    }
    facts |= {kind: ", ".join(statement.name for statement in record.statements_of(kind)) for kind in kinds}
    return [table(("name", "kind", "bounds", "initial", "final", "units"), rows), facts_table(facts)]


def _row(name: str, of: Declaration) -> tuple[str, ...]:
    bounds = of.bounds
    within = "a function of time" if callable(bounds) else "" if bounds == (None, None) else _interval(bounds)
    ends = (_shown(getattr(of, end, None)) for end in ("initial", "final"))
    return (name, type(of).__name__.lower(), within, *ends, _units(of))


def _interval(bounds: Any) -> str:
    low, high = bounds
    return f"{'-inf' if low is None else f'{low:g}'} .. {'inf' if high is None else f'{high:g}'}"


def _shown(value: Any) -> str:
    if value is None:
        return ""
    bounds = getattr(value, "bounds", None)
    if isinstance(value, Declaration) and bounds is not None:
        return f"free in {_interval(bounds)}"
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def _units(of: Declaration) -> str:
    return "" if of.units is None else str(of.units)
