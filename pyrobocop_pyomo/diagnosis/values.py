"""Numbers at the initial guess: what has no value, ends that contradict equations, decided rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import canonical_form, pairs_of, sources_of
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.complementarity.relaxed_model import SIDES_HOLD
from pyrobocop_pyomo.continuous.discretisation import discretisations_on
from pyrobocop_pyomo.modeling.row_violations import UndefinedPart, bound_violation, relation_violation, undefined_part
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.boundary_conditions import KINDS, EndViolation, end_violations, values_given, violations_of
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, error_about
from .places import at_time, place_in_words

REMEDY = "Change the initial guess or the data, or keep the expression away from its edge by bounds."


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


def _expressions(model: Any) -> Iterator[tuple[str, str, Any]]:
    """Every expression with its component and the words for its place; right-hand sides stand for generated rows."""
    generated: set[int] = set()
    for phase in phases_of(model):
        for state, rates in phase.record.rates.items():
            for time, rate in rates.items():
                where = f"right-hand side of '{state}' of phase '{phase.name}'{at_time(phase, time)}"
                yield f"{phase.name}.{state}", where, rate
        generated.update(id(phase.component(name)) for name in phase.record.generated_rows)
    for kinds in ((Constraint,), (*PAIR_TYPES, Objective)):
        for data in model.component_data_objects(kinds, active=True, descend_into=Block):
            component = data.parent_component()
            if id(component) in generated:
                continue
            # Of a row that stands for sides of pairs while these are relaxed, the first of them.
            pairs = [data] if data.ctype in PAIR_TYPES else sources_of(data)
            place = f"a side of {place_in_words(pairs[0])}" if pairs else place_in_words(data)
            sides = data.to_bounded_expression() if data.ctype is Constraint else sides_of(data)
            yield from ((component.name, place, side) for side in sides if side is not None)


def undefined_findings(block: Any) -> Iterator[Finding]:
    """What has no finite value or derivative at the initial guess, the first place of each component."""
    found: dict[str, list[UndefinedRow]] = {}
    for row in undefined_rows(block):
        found.setdefault(row.component, []).append(row)
    for name, rows in found.items():
        message = f"no finite value or derivative at the initial guess: {rows[0]}{_and_more(len(rows), 'point')}."
        yield error_about(message, (name,), REMEDY)


def _and_more(count: int, noun: str) -> str:
    plural = noun if count == 2 else "indices" if noun == "index" else f"{noun}s"
    return "" if count == 1 else f", and at {count - 1} more {plural}"


def boundary_findings(phase: Any, remarks: list[str]) -> Iterator[Finding]:
    """Fixed start or end values that violate what is stated, the worst row of each rule."""
    record = phase.record
    for time, where in ((record.grid.times[0], "initial"), (record.grid.times[-1], "final")):
        values = values_given(phase, time)
        statements = [each for each in record.statements if each.kind in KINDS]
        statements = [each for each in statements if values and _is_stated(phase.component(each.name), time)]
        if not statements:
            continue
        try:
            formulas = RuleFormulas(phase, real_grid(phase))
        except (ValueError, TypeError):
            return  # the horizon has no values yet
        worst: dict[str, EndViolation] = {}
        for found in end_violations(formulas, time, values, statements, remarks):
            if found.amount > max(MET, worst[found.statement].amount if found.statement in worst else 0.0):
                worst[found.statement] = found
        for found in worst.values():
            sides_hold = f" {SIDES_HOLD}" if found.kind == "complementarity" else ""
            known = ", ".join(f"{key} = {number:g}" for key, number in found.values.items())
            yield error_about(
                f"phase '{phase.name}': the {where} values violate {_KINDS.get(found.kind, found.kind)} '{found.row}' "
                f"by {found.amount:.3g} at t = {time:g}: {known}.",
                (f"{phase.name}.{found.statement}",),
                f"Give {where} values that satisfy it, or leave one of them free.{sides_hold} Where nothing is meant "
                "at that instant, let the rule return Skip there.",
            )


_KINDS = {"complementarity": "a side of the pair", "bounds": "the bounds of"}


def _is_stated(rows: Any, time: float) -> bool:
    """Whether the rows of a rule are meant at a time: neither removed nor deactivated, unless they were relaxed."""
    if rows is None:
        return False
    if not rows.active:
        return any(pair.source.parent_component() is rows for pair in pairs_of(rows.model()))
    there = [row for index, row in rows.items() if time == (index[0] if isinstance(index, tuple) else index)]
    return not there or any(row.active for row in there)


def discretised_start_findings(block: Any) -> Iterator[Finding]:
    """Fixed values that violate what is stated where a continuous set starts, and no collocation point is.

    The transformation has deactivated these rows and pairs, as far as they hold what nothing determines there.
    """
    for discretisation in discretisations_on(block):
        for data in discretisation.deactivated:
            pair = data.parent_component().ctype in PAIR_TYPES
            for relation, gap in violations_of(canonical_form(data) if pair else data.expr):
                if gap > MET and next(variables_in(relation, include_fixed=False), None) is None:
                    yield error_about(
                        f"the given values violate {'a side of the pair ' if pair else ''}'{data.name}' by {gap:.3g}.",
                        (data.parent_component().name,),
                        "Give values that satisfy it, or leave one of them free.",
                    )


def bound_findings(block: Any) -> Iterator[Finding]:
    """Fixed values outside their bounds, and bounds that cross: the first of each component."""
    for component in block.component_objects(Var, active=True, descend_into=Block):
        outside, crossed = [], []
        for data in component.values():
            lower, upper = data.bounds
            if data.fixed and data.value is not None and bound_violation(data.value, lower, upper) > MET:
                outside.append(f"'{data.name}' is fixed to {data.value:g}, outside its bounds ({lower}, {upper})")
            elif not data.fixed and lower is not None and upper is not None and lower > upper:
                crossed.append(f"'{data.name}' has the lower bound {lower:g} above the upper {upper:g}")
        for wrong, remedy in (outside, "Change the value or widen the bounds."), (crossed, "Swap or widen them."):
            if wrong:
                yield error_about(f"{wrong[0]}{_and_more(len(wrong), 'index')}.", (component.name,), remedy)


def decided_findings(block: Any) -> Iterator[Finding]:
    """Rows without a variable that may move, which do not hold; fixed values outside their bounds, crossed bounds."""
    yield from bound_findings(block)
    for row in block.component_data_objects(Constraint, active=True, descend_into=Block):
        if next(variables_in(row.body, include_fixed=False), None) is None:
            gap = relation_violation(row.expr, unknown=0.0)
            if gap > MET:
                yield error_about(
                    f"'{row.name}' holds no variable that may move and is violated by {gap:.3g}.",
                    (row.name,),
                    "Unfix a variable in it, or correct the fixed values.",
                )
