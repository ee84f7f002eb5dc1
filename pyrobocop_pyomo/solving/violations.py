"""What a point does not meet, by name: the worst row, bound or pair of each component."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any

from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.diagnosis.places import place_in_words
from pyrobocop_pyomo.modeling.row_violations import bound_violation, number_or_nan
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import Control, Parameter, phases_of

from .iterates import Tolerances

_NAMED = 3
# A variable that is so many times as large as where it started, as its bounds and as 1 goes to no solution; where that
# is known, those are named that are on the way there.
GROWN, GROWING = 1e8, 1e5


@dataclass(frozen=True)
class Violation:
    """The worst violation of one component.

    Attributes
    ----------
    name : str
        Of the row, variable or pair in the model.
    where : str
        The same in words, with the time.
    what : str
        The numbers.
    amount : float
        How far it is from being met; infinite where it has no value.
    others : int
        How many more of the same component are violated.
    """

    name: str
    where: str
    what: str
    amount: float
    others: int = 0

    def __str__(self) -> str:
        time, times = ("time", "times") if " t = " in self.where else ("index", "indices")
        others = f" (and at {self.others} other {time if self.others == 1 else times})" if self.others else ""
        return f"{self.where}: {self.what}{others}"


def violation_of(data: Any, body: Any, lower: float | None, upper: float | None) -> Violation:
    """Of a violated constraint with its body, or of a variable, at the values that are on the model."""
    number = number_or_nan(body)
    what = "has no value" if number != number else f"{number:.6g} is {_wanted(number, lower, upper)}"
    return Violation(data.name, place_in_words(data), what, bound_violation(number, lower, upper))


def violations_of_pairs(
    residuals: Iterable[PairResidual], tolerances: Tolerances, sizes: Iterable[float] = repeat(1.0)
) -> Iterator[Violation]:
    """Pairs whose sides are both positive, or negative.

    Parameters
    ----------
    residuals : iterable of PairResidual
    tolerances : Tolerances
    sizes : iterable of float
        Of the product of each.
    """
    for pair, size in zip(residuals, sizes, strict=False):
        # What has no value is not met either.
        if not (pair.product <= tolerances.complementarity * size and -pair.natural <= tolerances.feasibility):
            amount = float("inf") if pair.product != pair.product else abs(pair.natural)
            what = f"its sides are {pair.a:.3g} and {pair.b:.3g} at the best point found, and one of them has to be 0"
            yield Violation(pair.name, f"pair '{pair.name}'", what, amount)


def worst_of_each_component(violations: Iterable[Violation]) -> tuple[Violation, ...]:
    """One violation per component, the worst first."""
    groups: dict[str, list[Violation]] = {}
    for violation in violations:
        component = violation.name.rpartition("[")[0] if violation.name.endswith("]") else violation.name
        groups.setdefault(component, []).append(violation)
    worst = [replace(max(some, key=lambda one: one.amount), others=len(some) - 1) for some in groups.values()]
    return tuple(sorted(worst, key=lambda violation: -violation.amount))


def _wanted(number: float, lower: float | None, upper: float | None) -> str:
    """What a number has to be and is not."""
    if lower is not None and lower == upper:
        return f"not {upper:.6g}"
    return f"not >= {lower:.6g}" if lower is not None and number < lower else f"not <= {upper:.6g}"


def diverging_variables(values: VariableValues, least: float = GROWN) -> str:
    """The components that have grown most beyond start and bounds, in words; empty where none by this factor.

    Parameters
    ----------
    values : VariableValues
        Taken at the start.
    least : float
    """
    largest: dict[str, tuple[float, float]] = {}
    for data, start in zip(values.variables, values.taken, strict=True):
        size, known = abs(data.value or 0.0), max(1.0, abs(start or 0.0))
        if size >= least * known:  # to read bounds takes longer
            growth = size / max([known, *(abs(bound) for bound in data.bounds if bound is not None)])
            name = data.parent_component().name
            if growth >= max(least, largest.get(name, (0.0, 0.0))[0]):
                largest[name] = growth, size
    named = sorted(largest, key=lambda name: -largest[name][0])[:_NAMED]
    return ", ".join(f"'{name}' ({largest[name][1]:.1e})" for name in named)


def remarks_on_phases_with_pairs(model: Any) -> Iterator[str]:
    """What to say of phases with pairs of which nothing can be chosen, or whose elements have several stages."""
    with_pairs = [p for p in phases_of(model) if any(True for _ in p.component_data_objects(PAIR_TYPES, active=True))]
    if several := [f"'{phase.name}'" for phase in with_pairs if phase.grid.scheme.stages > 1]:
        yield (
            f"Phase {', '.join(several)} has pairs and several stages per element, whose forces cannot make a velocity "
            "jump. If there are impacts, take stages=1, or two phases with a jump between them."
        )
    for phase in with_pairs:
        if not (phase.record.names(Control) or phase.record.names(Parameter) or phase.has_normalised_time):
            yield (
                f"Phase '{phase.name}' has nothing to choose, and pairs: simulate() finds its motion element by "
                "element. phase.initialize(phase.simulate()) makes it the initial guess."
            )
