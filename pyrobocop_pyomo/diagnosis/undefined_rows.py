"""Where a model has no value or no derivative at its current values: expression, component, time; and a way out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.complementarity import generating_pairs
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.undefined_values import UndefinedPart, moved_into_domain, undefined_part
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .places import at_point, place_in_words

# So often are all expressions gone through, until each has a value.
_SWEEPS = 10


@dataclass(frozen=True, eq=False)
class UndefinedRow:
    """An expression of a model without a value.

    Attributes
    ----------
    component : str
        Its name; of a right-hand side that of the state.
    where : str
        The component and, in a phase, the time.
    part : UndefinedPart
    """

    component: str
    where: str
    part: UndefinedPart

    @property
    def is_fixed(self) -> bool:
        """Whether what is undefined reads variables, and all of them are fixed."""
        read = list(variables_in(self.part.argument))
        return bool(read) and all(variable.fixed for variable in read)

    def __str__(self) -> str:
        return f"{self.part.what}{', which is fixed' if self.is_fixed else ''}, in {self.where}"


def undefined_rows(model: Any) -> Iterator[UndefinedRow]:
    """Active rows, sides of pairs and objectives that have no finite value or derivative at the current values.

    Parameters
    ----------
    model : Block
    """
    for component, where, expression in _expressions(model):
        part = undefined_part(expression)
        if part is not None:
            yield UndefinedRow(component, where, part)


def named_undefined_rows(model: Any) -> str:
    """The first undefined row, in words, and whether there are more; empty where there is none."""
    found = list(islice(undefined_rows(model), 2))
    return f"{found[0]}{'; and elsewhere' if found[1:] else ''}" if found else ""


def move_into_domain(model: Any) -> list[UndefinedRow]:
    """Move variables, as little as it takes, until all rows and objectives have values.

    Parameters
    ----------
    model : Block
        Its free variables get other values.

    Returns
    -------
    list of UndefinedRow
        What could not be given a value.
    """
    for _ in range(_SWEEPS):
        # One after the other: what is moved for one row may have moved the next one too.
        moved = [moved_into_domain(row.part) for row in undefined_rows(model)]
        if not moved or not any(moved):
            break
    return list(undefined_rows(model)) if moved else []


def _place(row: Any) -> str:
    """The place of a row; of one that stands for sides of pairs while these are relaxed, the first of them."""
    sources = generating_pairs(row)
    return f"a side of {place_in_words(sources[0])}" if sources else place_in_words(row)


def _expressions(model: Any) -> Iterator[tuple[str, str, Any]]:
    """Every expression with its component and the words for its place; right-hand sides stand for generated rows."""
    generated: set[int] = set()
    for phase in phases_of(model):
        for state, rates in phase.record.rates.items():
            for time, rate in rates.items():
                where = f"right-hand side of '{state}' of phase '{phase.name}'{at_point(phase, time)}"
                yield f"{phase.name}.{state}", where, rate
        rows = (phase.component(name) for name in phase.record.generated_rows)
        generated.update(id(component) for component in rows if component is not None)
    for row in model.component_data_objects(Constraint, active=True, descend_into=Block):
        if id(row.parent_component()) not in generated:
            yield row.parent_component().name, _place(row), row.body
    for data in model.component_data_objects((*PAIR_TYPES, Objective), active=True, descend_into=Block):
        place = f"objective '{data.name}'" if data.ctype is Objective else f"a side of {place_in_words(data)}"
        yield from ((data.parent_component().name, place, side) for side in sides_of(data))
