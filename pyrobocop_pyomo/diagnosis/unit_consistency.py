"""Units of rows and objectives, where variables carry units."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.units_container import InconsistentUnitsError, UnitsError
from pyomo.core.base.var import Var
from pyomo.util.check_units import assert_units_consistent

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, Severity, Subject


def unit_findings(block: Any) -> Iterator[Finding]:
    """Rows and objectives whose terms have different units, one finding per component; nothing without units."""
    if not any(_has_units(component) for component in block.component_objects(Var, descend_into=Block)):
        return
    for component in block.component_objects((Constraint, Objective), active=True, descend_into=Block):
        try:
            assert_units_consistent(component)
        except (InconsistentUnitsError, UnitsError) as error:
            yield _finding(component, error)
    for component in block.component_objects(PAIR_TYPES, active=True, descend_into=Block):
        try:
            for data in component.values():
                for side in sides_of(data):
                    assert_units_consistent(side)
        except (InconsistentUnitsError, UnitsError) as error:
            yield _finding(component, error)


def _has_units(component: Any) -> bool:
    return any(data.get_units() is not None for data in component.values())


def _finding(component: Any, error: Exception) -> Finding:
    return Finding(
        Severity.ERROR,
        Subject.UNITS,
        f"'{component.name}': {str(error).strip().rstrip('.')}.",
        (component.name,),
        "Give constants their units (9.81 * units.m / units.s**2), or correct the units of a declaration.",
    )
